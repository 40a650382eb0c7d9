#!/usr/bin/env python3
"""Reports, exports, audit packs and books, as programs that others wrote read them.

Usage: test_report.py FOLDER     (FOLDER has survey-earlier.mcap and survey-later.mcap, which
                                  `cargo test -p stockpilot-sim --test report` makes)
The seed of what is drawn here is printed.
"""
import csv
import decimal
import hashlib
import json
import os
import pathlib
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time

import laspy
import minisign
import numpy as np
import plyfile
import pypdfium2
import rasterio
import tifffile
from mcap.reader import make_reader

PROGRAM = pathlib.Path(os.environ["STOCKPILOT_PROGRAMS"]) / "stockpilot"
FORBIDDEN = ["astm", "asprs", "certified", "accurate to", "nan", "infinity"]


def stockpilot(*arguments, code=0):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == code, f"{arguments}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


def recorded(log):
    """The accounts that the flight ended with, by another reader of MCAP."""
    last = None
    with open(log, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.topic == "/result/ended":
                last = json.loads(message.data)
    return last["accounts"]


def two_digits(value):
    """A number to two significant digits, and the place of the last one."""
    value = decimal.Decimal(value)
    place = decimal.Decimal(1).scaleb(value.adjusted() - 1)
    rounded = value.quantize(place, decimal.ROUND_HALF_EVEN)
    if rounded.adjusted() > value.adjusted():
        place = place.scaleb(1)
        rounded = value.quantize(place, decimal.ROUND_HALF_EVEN)
    return rounded, place


def two(value):
    return f"{two_digits(value)[0]:f}"


def stated(value, sigma):
    """y ± U with k = 2 by GUM 7.2.6, in decimal arithmetic: U to two digits, y to the same place."""
    rounded, place = two_digits(2.0 * sigma)
    # A value that rounds to nothing has no sign.
    y = decimal.Decimal(value).quantize(place, decimal.ROUND_HALF_EVEN) + 0
    return f"{y:f} ± {rounded:f}".replace("-", "−")


def test_numbers(out, report, log):
    accounts = recorded(log)
    assert len(accounts) == len(report["accounts"]) > 1
    with open(out / "report.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for account, said, row in zip(accounts, report["accounts"], rows, strict=True):
        estimate = account["estimate"]
        assert said["name"] == row["bay"] == account["name"]
        for key in ["volume_m3", "sigma_m3"]:
            assert said[key] == estimate[key], (said["name"], key)
        assert said["mass_t"] == account["mass"]["mass_t"] == float(row["mass_t"])
        assert float(row["volume_m3"]) == estimate["volume_m3"]
        assert float(row["volume_expanded_m3"]) == 2.0 * estimate["sigma_m3"]
        assert said["measured"] == account["shares"]["measured_ratio"]
        variance = sum(v for k, v in said["budget_m6"].items() if k != "density")
        assert abs(variance - estimate["sigma_m3"] ** 2) < 1e-9 * variance
    print(f"numbers: {len(accounts)} volumes equal the log's to the last bit, in JSON and CSV")


def test_pdf(out, report):
    document = pypdfium2.PdfDocument(out / "report.pdf")
    texts = [page.get_textpage().get_text_bounded() for page in document]
    texts = [" ".join(text.replace("\u00a0", " ").split()) for text in texts]
    for account in report["accounts"]:
        for wanted in [
            stated(account["volume_m3"], account["sigma_m3"]),
            stated(account["mass_t"], account["mass_sigma_t"]),
            account["name"],
            f"{100 * account['measured']:.1f} % measured",
        ]:
            assert wanted in texts[0], f"{wanted!r} is not on page 1:\n{texts[0]}"
    for wanted in ["k = 2", "Base", "within noise", "significant", "300 m³", "Test hall"]:
        assert wanted in texts[0], f"{wanted!r} is not on page 1"
    everything = " ".join(texts)
    assert report["log"]["sha256"] in everything and "--verify" in everything
    for word in FORBIDDEN:
        assert not re.search(rf"\b{word}\b", everything.lower()), word
    for number, (page, text) in enumerate(zip(document, texts, strict=True), 1):
        assert "Not a legal-for-trade measurement" in text, f"page {number}"
        assert f"{number} / {len(texts)}" in text
        pixels = page.render(scale=1.0).to_numpy()[..., :3]
        inked = float((pixels.min(axis=2) < 200).mean())
        # A page may hold the last lines of a list and nothing else.
        assert 0.002 < inked < 0.6, f"page {number}: {inked}"
    test_pdf_tables(texts, report)
    print(f"PDF: {len(texts)} pages, the volumes of page 1 as rounded here")


# Sources by their names in the data, as people read them.
SOURCES = {"prior": "gaps", "occlusion": "hollows", "lidar_mounting": "LiDAR mounting"}


def test_pdf_tables(texts, report):
    """Every number of the tables, rounded here from what the log was shown to hold."""
    everything = " ".join(texts)
    n_numbers = 0
    for account in report["accounts"]:
        name, volume = account["name"], stated(account["volume_m3"], account["sigma_m3"])
        share = two(100.0 * account["expanded_m3"] / account["volume_m3"])
        mass = stated(account["mass_t"], account["mass_sigma_t"])
        change, book = account["change"], account["book"]
        judged = {True: "significant", False: "within noise"}
        rows = [
            f"{name} {volume} {share} % {mass} {account['verdict'].replace('_', ' ')}",
            f"{name} {account['base']} {account['area_m2']:.1f} {two(account['base_expanded_m3'])}",
            f"{name} {stated(change['change_m3'], change['sigma_m3'])} {judged[change['is_significant']]}",
            *(f"{100.0 * account[state]:.1f} % {state}" for state in ["measured", "interpolated", "unseen"]),
        ]
        if book:
            difference = stated(book["difference"], book["sigma"])
            rows.append(f"{book['book']:g} {book['unit']} ({difference}) {book['unit']} "
                        f"{judged[book['is_significant']]}")
        for row in rows:
            assert row in texts[0], f"{row!r} is not on page 1:\n{texts[0]}"
        # The budget of this volume: from its heading to the next one.
        budget = everything.split(f"{name}: {volume} m³", 1)[1].split("Tonnes: ", 1)[0]
        of_volume = {source: var for source, var in account["budget_m6"].items() if source != "density"}
        whole = sum(of_volume.values())
        printed = re.findall(r"([A-Za-z][A-Za-z ]*?) ([\d.]+) m³, ([\d.]+) % of the variance", budget)
        assert printed and sum(float(share) for _, _, share in printed) > 99.0, budget
        by_name = {SOURCES.get(source, source.replace("_", " ")): var for source, var in of_volume.items()}
        for source, expanded, share in printed:
            var = by_name[source.strip()]
            assert (expanded, share) == (two(2.0 * var ** 0.5), two(100.0 * var / whole)), (name, source)
        n_numbers += 2 * len(printed) + len(rows)
    beams, survey = report["beams"], report["survey"]
    # The densities as the flights of this test are configured: (1.6 ± 0.03) t/m³, 1σ.
    for wanted in [stated(1.6, 0.03), "Operator: A. Person",
                   f"{beams['received']} received, {beams['used']} of the material",
                   f"{survey['waypoints']} waypoints, {survey['path_length_m']:.1f} m of path"]:
        assert wanted in everything, wanted
    print(f"PDF: {n_numbers} entries of its tables are the log's numbers, rounded")


def test_maps(out, report):
    surface = report["surface"]
    extent = (
        surface["x_min_m"],
        surface["y_min_m"],
        surface["x_min_m"] + surface["n_cols"] * surface["cell_m"],
        surface["y_min_m"] + surface["n_rows"] * surface["cell_m"],
    )
    with rasterio.open(out / "height.tif") as tif:
        assert np.allclose(tuple(tif.bounds), extent, atol=1e-9), tif.bounds
        assert tif.descriptions == ("height", "sigma") and tif.units == ("m", "m")
        assert np.isnan(tif.nodata)
        assert "stockpilot hall" in tif.crs.to_wkt() and not tif.crs.is_geographic
        bands = tif.read()
        places = [(probe["x_m"], probe["y_m"]) for probe in surface["probes"]]
        found = list(tif.sample(places))
    for probe, (height, sigma) in zip(surface["probes"], found, strict=True):
        assert height == probe["height_m"] and sigma == probe["sigma_m"], probe
    assert len(surface["probes"]) > 10
    heights = bands[0][np.isfinite(bands[0])]
    assert heights.size == surface["n_counting_cells"]
    assert heights.max() == surface["highest_m"] and heights.min() == surface["lowest_m"]
    # A second reader of TIFF, which knows nothing of places.
    assert np.array_equal(tifffile.imread(out / "height.tif")[..., 0], bands[0], equal_nan=True)
    for name, band in [("height.asc", bands[0]), ("sigma.asc", bands[1])]:
        with rasterio.open(out / name) as grid:
            assert np.allclose(tuple(grid.bounds), extent, atol=1e-9)
            values = grid.read(1, masked=True).filled(np.nan)
            # GDAL may keep single precision of a text.
            assert np.allclose(values, band, atol=1e-6, equal_nan=True), name
            assert "stockpilot hall" in grid.crs.to_wkt()
    hall = report["accounts"][0]
    volume = float(heights.sum()) * surface["cell_m"] ** 2
    print(f"maps: {heights.size} cells; {volume:.2f} m³ of whole cells, {hall['volume_m3']:.2f} m³ stated")
    return bands[0]


def test_clouds(out, report, heights):
    surface = report["surface"]
    las = laspy.read(out / "hits.laz")
    assert len(las.points) == report["beams"]["hits_exported"] == report["beams"]["used"]
    assert str(las.header.version) == "1.4" and las.header.point_format.id == 6
    crs = las.header.parse_crs()
    assert crs.is_engineering and crs.name == "stockpilot hall", crs
    x, y, z = np.asarray(las.x), np.asarray(las.y), np.asarray(las.z)
    cols = ((x - surface["x_min_m"]) / surface["cell_m"]).astype(int)
    rows = ((y - surface["y_min_m"]) / surface["cell_m"]).astype(int)
    assert cols.min() >= 0 and cols.max() < surface["n_cols"]
    assert rows.min() >= 0 and rows.max() < surface["n_rows"]
    off = np.abs(z - heights[surface["n_rows"] - 1 - rows, cols])
    off = off[np.isfinite(off)]
    # Half a cell of a slope of 45° and the noise of a beam.
    assert np.median(off) < 0.05 and np.quantile(off, 0.99) < 0.25, np.median(off)
    sigma = np.asarray(las["height_sigma"])
    assert 0.0 < sigma.min() and sigma.max() < 0.5
    span = np.ptp(np.asarray(las.gps_time))
    assert 20.0 < span < 300.0, span
    vertices = plyfile.PlyData.read(out / "hits.ply")["vertex"]
    assert len(vertices) == len(x)
    for axis, values in zip("xyz", (x, y, z), strict=True):
        assert np.allclose(vertices[axis], values, atol=0.51e-4), axis
    assert np.allclose(vertices["height_sigma"], sigma)
    lines = (out / "surface.obj").read_text().splitlines()
    corners = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    assert len(corners) == surface["n_counting_cells"]
    assert corners[:, 2].max() == surface["highest_m"]
    print(f"clouds: {len(x)} hits, {np.median(off):.3f} m from the surface in the middle; OBJ has {len(corners)} vertices")


def test_sums(out):
    lines = (out / "SHA256SUMS").read_text().splitlines()
    for line in lines:
        sum_, name = line.split("  ")
        assert hashlib.sha256((out / name).read_bytes()).hexdigest() == sum_, name
    assert {line.split("  ")[1] for line in lines} | {"SHA256SUMS"} == {f.name for f in out.iterdir()}


def test_audit(folder, log, drawn):
    key, pack = folder / "audit.key", folder / "pack"
    stockpilot("audit", "key", key)
    assert key.stat().st_mode & 0o777 == 0o600
    stockpilot("audit", "pack", log, "--site", "Test hall", "--out", pack, "--key", key)
    said = stockpilot("audit", "verify", pack, "--public-key", folder / "audit.pub")
    # The pack's own key says nothing of the signer.
    assert "NOT VERIFIED" in stockpilot("audit", "verify", pack, code=2)
    stockpilot("audit", "verify", pack, "--packed-key")
    for account in recorded(log):
        volume = json.dumps(account["estimate"]["volume_m3"])
        assert f"{account['name']}: {volume} m³, computed again to the last bit" in said, said
    public = minisign.PublicKey.from_file(folder / "audit.pub")
    signature = minisign.Signature.from_file(pack / "SHA256SUMS.minisig")
    public.verify((pack / "SHA256SUMS").read_bytes(), signature)
    # The same from elsewhere: nothing in it depends on its place.
    moved = folder / "elsewhere" / "moved"
    shutil.copytree(pack, moved)
    names = sorted(path.name for path in moved.iterdir())
    n_found = 0
    for name in names:
        path = moved / name
        before = path.read_bytes()
        for _ in range(3):
            changed = bytearray(before)
            place = drawn.randrange(len(changed))
            changed[place] ^= 1 << drawn.randrange(8)
            path.write_bytes(changed)
            found = subprocess.run(
                [PROGRAM, "audit", "verify", moved, "--public-key", folder / "audit.pub"],
                capture_output=True, text=True, check=False)
            # The comment above a signature is not signed, and says so.
            if name == "SHA256SUMS.minisig" and place < before.index(b"\n"):
                continue
            assert found.returncode == 1 or "Error" in found.stderr, f"{name}, byte {place}: {found.stdout}"
            n_found += 1
        path.write_bytes(before)
    (moved / "config.toml").unlink()
    assert "config.toml is missing" in stockpilot(
        "audit", "verify", moved, "--public-key", folder / "audit.pub", code=1)
    (pack / "more.txt").write_text("more")
    assert "more.txt was not packed" in stockpilot(
        "audit", "verify", pack, "--public-key", folder / "audit.pub", code=1)
    print(f"audit: {len(names)} files, the signature holds for minisign's own; {n_found} flipped bits found")


def surveys_in(books):
    with sqlite3.connect(f"file:{books}?mode=rw", uri=True) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        return dict(database.execute(
            "SELECT log_sha256, (SELECT COUNT(*) FROM volume WHERE survey_id = id) FROM survey"))


def test_books(folder, earlier, later, report, drawn):
    books = folder / "books.sqlite"
    for log in [earlier, later, later]:
        stockpilot("inventory", "--books", books, "add", log, "--hall", "Test hall")
    lines = json.loads(stockpilot("inventory", "--books", books, "history", "--form", "json"))
    rows = list(csv.DictReader(stockpilot("inventory", "--books", books, "history", "--form", "csv").splitlines()))
    n_bays = len(report["accounts"])
    assert len(lines) == len(rows) == 2 * n_bays
    newest = [line for line in lines if line["log_sha256"] == report["log"]["sha256"]]
    for line, account in zip(newest, report["accounts"], strict=True):
        assert line["bay"] == account["name"] and line["volume_m3"] == account["volume_m3"]
        assert line["change_m3"] == account["change"]["change_m3"]
        assert line["p_value"] == account["change"]["p_value"]
    assert sum(survey == n_bays for survey in surveys_in(books).values()) == 2
    n_killed, n_tries = killed(folder, books, later, drawn)
    print(f"books: {len(lines)} lines equal the report's; {n_killed} of {n_tries} killed, nothing lost or half there")


def killed(folder, books, later, drawn, n_tries=60):
    """Killed at any moment: what was there stays, and a survey is there whole or not at all."""
    small = folder / "merged.mcap"
    stockpilot("merge", later, "--out", small)
    sum_ = hashlib.sha256(small.read_bytes()).hexdigest()
    kept = surveys_in(books)
    began = time.monotonic()
    stockpilot("inventory", "--books", folder / "timed.sqlite", "add", small, "--hall", "Test hall")
    span = time.monotonic() - began
    n_killed = 0
    for number in range(n_tries):
        target = folder / f"killed-{number}.sqlite"
        shutil.copy(books, target)
        adding = subprocess.Popen([PROGRAM, "inventory", "--books", target, "add", small, "--hall", "Test hall"],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            adding.wait(timeout=drawn.uniform(0.3, 1.1) * span)
        except subprocess.TimeoutExpired:
            adding.send_signal(signal.SIGKILL)
            adding.wait()
            n_killed += 1
        found = surveys_in(target)
        assert {key: found[key] for key in kept} == kept, found
        assert found == kept or found[sum_] == len(recorded(later)), found
        stockpilot("inventory", "--books", target, "add", small, "--hall", "Test hall")
        assert len(surveys_in(target)) == len(kept) + 1
    assert n_killed > n_tries // 4, n_killed
    return n_killed, n_tries


def main():
    surveys = pathlib.Path(sys.argv[1])
    earlier, later = surveys / "survey-earlier.mcap", surveys / "survey-later.mcap"
    seed = int(os.environ.get("SEED", random.SystemRandom().randrange(2**32)))
    print(f"SEED={seed}")
    drawn = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        out = folder / "report"
        stockpilot("report", later, "--out", out, "--against", earlier, "--site", "Test hall",
                   "--operator", "A. Person", "--book-of", "hall=300m3")
        report = json.loads((out / "report.json").read_text())
        assert report["log"]["reproduction"] == "identical" and report["log"]["complete"]
        assert report["log"]["sha256"] == hashlib.sha256(later.read_bytes()).hexdigest()
        stockpilot("replay", later, "--verify")
        test_numbers(out, report, later)
        test_pdf(out, report)
        heights = test_maps(out, report)
        test_clouds(out, report, heights)
        test_sums(out)
        test_books(folder, earlier, later, report, drawn)
        test_audit(folder, later, drawn)
    return 0


if __name__ == "__main__":
    sys.exit(main())
