"""`stockpilot params` against the stub: ten mistakes, found, shown, and mended."""
import json
import os
import re
import subprocess
import tempfile

from programs import program, stub

HERE = os.path.dirname(os.path.abspath(__file__))
FILE = os.path.join(HERE, "..", "..", "firmware-params", "px4-indoor-vision.params")
# The value that the file wants, as a float, taken for the bits of a whole number: a tool that does
# not know PX4's encoding wrote it.
FIFTEEN_AS_BITS = 1097859072
MISTAKES = {
    "EKF2_EV_CTRL": FIFTEEN_AS_BITS,
    "EKF2_HGT_REF": 1,
    "EKF2_EV_DELAY": 0.0,
    "EKF2_GPS_CTRL": 7,
    "SYS_HAS_GPS": 1,
    "COM_OBL_RC_ACT": 0,
    "COM_RC_IN_MODE": 4,
    "COM_RCL_EXCEPT": 4,
    "COM_RC_OVERRIDE": 1,
    "NAV_RCL_ACT": 2,
}


def wanted():
    with open(FILE, encoding="utf-8") as file:
        rows = [line.split("\t") for line in file if not line.startswith("#")]
    return {row[2]: float(row[3]) for row in rows}


def params(verb, file, ends, *options):
    words = [program("stockpilot"), "params", verb, file, "--link", f"udpout:{ends['listen']}",
             "--json", *options]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout)


def seeded(values):
    return [word for name, value in values.items() for word in ("--param", f"{name}={value}")]


# ArduCopter's own defaults, which a vehicle that was set up for outdoors has.
ARDUPILOT_FILE = os.path.join(HERE, "..", "..", "firmware-params", "ardupilot-indoor-vision.parm")
ARDUPILOT_MISTAKES = {
    "VISO_TYPE": 0,
    "EK3_SRC1_POSXY": 3,
    "EK3_SRC1_POSZ": 1,
    "EK3_SRC1_VELXY": 3,
    "EK3_SRC1_YAW": 1,
    "GPS1_TYPE": 1,
    "COMPASS_ENABLE": 1,
    "GUID_TIMEOUT": 3.0,
    "FS_DR_ENABLE": 2,
    "FS_THR_ENABLE": 1,
}


def ardupilot():
    with open(ARDUPILOT_FILE, encoding="utf-8") as file:
        right = dict(line.split() for line in file if not line.startswith("#"))
    good = ["--flavour", "ardupilot", *seeded(right)]
    with stub(*good) as ends:
        code, report = params("check", ARDUPILOT_FILE, ends)
        assert (code, report["parameters"]) == (0, []), report
    for name, value in ARDUPILOT_MISTAKES.items():
        with stub(*good, *seeded({name: value})) as ends:
            code, report = params("check", ARDUPILOT_FILE, ends)
            found = [row["name"] for row in report["parameters"]]
            assert code == 1 and found == [name], (name, report)
    with stub(*good, *seeded(ARDUPILOT_MISTAKES)) as ends:
        code, report = params("write", ARDUPILOT_FILE, ends)
        assert (code, report["written"], report["wrong"]) == (0, len(ARDUPILOT_MISTAKES), 0), report
    print(f"params: each of {len(ARDUPILOT_MISTAKES)} mistakes on ArduCopter too, and all written")


def main():
    ardupilot()
    right = wanted()
    good = seeded({name: int(v) if name != "EKF2_EV_DELAY" else v for name, v in right.items()})
    with stub(*good) as ends:
        code, report = params("check", FILE, ends)
        assert (code, report["parameters"]) == (0, []), report
    print("params: a right autopilot passes")
    for name, value in MISTAKES.items():
        with stub(*good, *seeded({name: value})) as ends:
            code, report = params("check", FILE, ends)
            found = [row["name"] for row in report["parameters"]]
            assert code == 1 and found == [name], (name, report)
    print(f"params: each of {len(MISTAKES)} mistakes is found alone")
    with stub(*good, *seeded(MISTAKES)) as ends:
        code, report = params("check", FILE, ends)
        found = {row["name"]: row["problem"] for row in report["parameters"]}
        assert code == 1 and found.keys() == MISTAKES.keys(), found
        assert "bits" in found["EKF2_EV_CTRL"], found
    with stub(*good, *seeded(MISTAKES)) as ends:
        code, report = params("diff", FILE, ends)
        assert code == 0 and len(report["parameters"]) == len(right), report
    with stub(*good, *seeded(MISTAKES)) as ends:
        code, report = params("write", FILE, ends)
        assert (code, report["written"], report["wrong"]) == (0, len(MISTAKES), 0), report
    print("params: all ten together are found, shown, written and read back")
    with tempfile.TemporaryDirectory() as folder, stub(*good) as ends:
        path = os.path.join(folder, "foreign.params")
        with open(FILE, encoding="utf-8") as file:
            text = file.read()
        # A name of another firmware, and another type than the autopilot's.
        text = re.sub(r"\t10\.0+\t9", "\t10\t6", text) + "1\t1\tVISO_TYPE\t1\t2\n"
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
        code, report = params("check", path, ends)
        problems = {row["name"]: row["problem"] for row in report["parameters"]}
        assert problems.keys() == {"EKF2_EV_DELAY", "VISO_TYPE"}, problems
        assert "type" in problems["EKF2_EV_DELAY"] and "unknown" in problems["VISO_TYPE"], problems
    with tempfile.TemporaryDirectory() as folder:
        key = os.path.join(folder, "key")
        with open(key, "w", encoding="ascii") as file:
            file.write(bytes(range(32)).hex())
        os.chmod(key, 0o600)
        with stub(*good, "--signing-key", key) as ends:
            signed = ["--signing-key", key, "--signing-stamp", os.path.join(folder, "stamp")]
            code, report = params("check", FILE, ends, *signed)
            assert (code, report["parameters"]) == (0, []), report
    print("params: the same over a signed link")


if __name__ == "__main__":
    main()
