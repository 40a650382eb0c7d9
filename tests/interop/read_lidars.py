"""Reads the emulated LiDARs with clients of other people and compares with the emulators' room.

Usage: read_lidars.py STOCKPILOT_SIM
"""

import errno
import itertools
import math
import os
import select
import socket
import statistics
import subprocess
import sys
import tempfile
import termios
import threading
import tty
from pathlib import Path

import lds2d
import serial
from hokuyolx import HokuyoLX
from pyrplidar import PyRPlidar
from rplidar import RPLidar

# The emulators stand in the middle of a room of 6 m by 4 m.
HALF_LENGTH_MM, HALF_WIDTH_MM = 3000.0, 2000.0
# Clients are asked for so many measurements.
N_MEASUREMENTS = 4000


def without_modem_lines(update):
    """Pseudo-terminals have no modem lines, which pySerial takes for fatal."""

    def patched(self):
        try:
            update(self)
        except OSError as error:
            if error.errno != errno.ENOTTY:
                raise

    return patched


for name in ("_update_dtr_state", "_update_rts_state"):
    setattr(serial.Serial, name, without_modem_lines(getattr(serial.Serial, name)))


class Emulator:
    """One emulated sensor while the block lasts; gives the path of its port."""

    def __init__(self, program, model):
        self.folder = tempfile.TemporaryDirectory()
        self.port = Path(self.folder.name) / "lidar"
        command = [program, "lidar", "--model", model, "--pty", self.port, "--exact"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def __enter__(self):
        line = self.process.stdout.readline()
        assert line.startswith("ready: "), line
        return str(self.port)

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.folder.cleanup()


def wall_mm(angle_deg):
    """Distance to the wall at a clockwise angle."""
    angle = math.radians(angle_deg)
    ahead = HALF_LENGTH_MM / max(abs(math.cos(angle)), 1e-9)
    aside = HALF_WIDTH_MM / max(abs(math.sin(angle)), 1e-9)
    return min(ahead, aside)


def judge(client, model, pairs, limit_mm, n_sectors=36):
    """Pairs of angle (degrees) and distance (mm) against the walls; seen in so many sectors of 10°."""
    returns = [(angle, dist) for angle, dist in pairs if dist > 0]
    errors = [abs(dist - wall_mm(angle)) for angle, dist in returns]
    median = statistics.median(errors)
    most = sorted(errors)[int(0.99 * (len(errors) - 1))]
    covered = len({int(angle) // 10 % 36 for angle, _ in returns})
    print(f"{client:18} {model:20} {len(returns):6} returns, median {median:.2f} mm, 99 % {most:.2f} mm")
    assert len(returns) > 0.9 * len(pairs), f"{client} got {len(returns)} returns of {len(pairs)}"
    assert covered >= n_sectors, f"{client} has seen {covered} of {n_sectors} directions"
    assert median < limit_mm and most < 5 * limit_mm, f"{client} misreads {model}"


def roboticia(port, baud):
    lidar = RPLidar(port, baudrate=baud, timeout=3)
    try:
        info = lidar.get_info()
        assert lidar.get_health()[0] == "Good"
        assert info["model"] == 0x18 and info["firmware"] == (1, 29), info
        measures = lidar.iter_measures(max_buf_meas=False)
        return [(angle, dist) for _, _, angle, dist in itertools.islice(measures, N_MEASUREMENTS)]
    finally:
        lidar.disconnect()


def pyrplidar(port, baud, mode):
    lidar = PyRPlidar()
    lidar.connect(port=port, baudrate=baud, timeout=3)
    lidar.set_motor_pwm(660)
    lidar.get_info()
    assert lidar.get_health().status == 0
    names = [str(m.name) for m in lidar.get_scan_modes()]
    assert lidar.get_scan_mode_typical() < len(names)
    scan = lidar.start_scan() if mode == 0 else lidar.start_scan_express(mode)
    measures = list(itertools.islice(scan(), N_MEASUREMENTS))
    lidar.stop()
    lidar.disconnect()
    return [(m.angle, m.distance) for m in measures]


def lds(port, model):
    with lds2d.Lidar.open(model, port) as lidar:
        try:
            lidar.start()
        except lds2d.NotSupportedError:
            pass
        points = list(itertools.islice(lidar.points(), N_MEASUREMENTS))
        return [(p.angle_deg, p.dist_mm) for p in points]


def bridge(port, server, baud):
    """Carries bytes between a serial port and the first who connects, until that one leaves."""
    line = os.open(port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    settings = termios.tcgetattr(line)
    settings[4] = settings[5] = baud
    termios.tcsetattr(line, termios.TCSANOW, settings)
    client, _ = server.accept()
    while True:
        for source in select.select([line, client], [], [])[0]:
            if source is line:
                client.sendall(os.read(line, 4096))
                continue
            data = client.recv(4096)
            if not data:
                os.close(line)
                return
            os.write(line, data)


def hokuyolx(port):
    """The client speaks SCIP over TCP only."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        carrier = threading.Thread(target=bridge, args=(port, server, termios.B115200), daemon=True)
        carrier.start()
        lidar = HokuyoLX(addr=server.getsockname(), tsync=False, convert_time=False)
        try:
            scans = [scan for scan, *_ in lidar.iter_dist(scans=5)]
            # Counter-clockwise, radians.
            angles = [-math.degrees(angle) for angle in lidar.get_angles()]
        finally:
            lidar.close()
        carrier.join(3)
        return [(angle, float(dist)) for scan in scans for angle, dist in zip(angles, scan)]


def main(program):
    # lds2d tells whole millimetres; its angles have the sensor's steps.
    for model, name in [
        ("rplidar-a1", "RPLIDAR-A1"),
        ("ld19", "LDROBOT-LD19"),
        ("ld06", "LDROBOT-LD06"),
        ("ydlidar-x4", "YDLIDAR-X4"),
        ("ydlidar-x2", "YDLIDAR-X2"),
    ]:
        with Emulator(program, model) as port:
            judge("lds2d", model, lds(port, name), 2.0)
    with Emulator(program, "rplidar-a1") as port:
        judge("rplidar-roboticia", "rplidar-a1", roboticia(port, 115200), 1.0)
    for model, baud, mode, limit_mm in [
        ("rplidar-a1", 115200, 0, 1.0),
        ("rplidar-a1", 115200, 1, 2.0),
        ("rplidar-a1", 115200, 3, 3.0),
        ("rplidar-a3", 256000, 2, 3.0),
    ]:
        with Emulator(program, model) as port:
            judge("pyrplidar", f"{model} mode {mode}", pyrplidar(port, baud, mode), limit_mm)
    # 270° of view. The client's angles are wrong for sensors whose first step is not 0.
    with Emulator(program, "hokuyo-utm30lx") as port:
        judge("hokuyolx", "hokuyo-utm30lx", hokuyolx(port), 1.0, n_sectors=27)


if __name__ == "__main__":
    main(sys.argv[1])
