"""Writes the licences of everything that is linked into the programs, and of what they bring along.

    python3 notices.py TARGET > THIRD-PARTY-LICENSES

`TARGET` is the triple of the machine they are built for. The texts are those in the sources of the crates that Cargo has
fetched; equal texts stand once.
"""

import hashlib
import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
NAMES = re.compile(r"^(licen[cs]e|copying|notice|unlicense)([-_.].*)?$", re.IGNORECASE)
PROGRAMS = ["stockpilot", "stockpilot-sim"]
# Files in the tree that others wrote.
BROUGHT_ALONG = ["src/web/page/vendor", "src/figure/font", "src/pdf/font"]


def linked(target):
    """The packages that the programs are made of, not those that only build or test them."""
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--filter-platform", target]
    metadata = json.loads(subprocess.check_output(command, cwd=ROOT))
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    roots = {package["id"] for package in packages.values() if package["name"] in PROGRAMS}
    found, waiting = set(), list(roots)
    while waiting:
        node = waiting.pop()
        if node in found:
            continue
        found.add(node)
        for dependency in nodes[node]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                waiting.append(dependency["pkg"])
    return sorted((packages[id] for id in found - roots), key=lambda p: (p["name"], p["version"]))


def texts_below(folder):
    files = sorted(f for f in folder.rglob("*") if f.is_file() and NAMES.match(f.name))
    return [text for f in files if (text := f.read_text(encoding="utf-8", errors="replace").strip())]


def main(target):
    users, contents = {}, {}
    plain = []
    for package in linked(target):
        name = f"{package['name']} {package['version']} ({package['license'] or 'see its text'})"
        texts = texts_below(pathlib.Path(package["manifest_path"]).parent)
        if not texts:
            plain.append(name)
        for text in texts:
            key = hashlib.sha256(" ".join(text.split()).encode()).hexdigest()
            contents.setdefault(key, text)
            users.setdefault(key, []).append(name)
    for place in BROUGHT_ALONG:
        texts = texts_below(ROOT / place)
        assert texts, f"no licence below {place}"
        for text in texts:
            key = hashlib.sha256(" ".join(text.split()).encode()).hexdigest()
            contents.setdefault(key, text)
            users.setdefault(key, []).append(place)
    print("What stockpilot is made of beside its own code, and the licences of that.\n")
    print("Without a text of their own in their sources, under the licences that their names stand for:")
    print("\n".join(f"  {name}" for name in plain))
    for key, names in sorted(users.items(), key=lambda item: item[1]):
        print("\n" + "-" * 100)
        print("\n".join(f"  {name}" for name in dict.fromkeys(names)))
        print("-" * 100 + "\n")
        print(contents[key])


if __name__ == "__main__":
    main(*sys.argv[1:])
