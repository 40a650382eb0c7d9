"""pymavlink and MAVProxy join the pieces of the lines that the Rust tests wrote.

Usage: test_texts.py FOLDER     (with texts.tlog and texts.txt of `cargo test --test wire`)
"""
import os
import socket
import subprocess
import sys
import tempfile

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from programs import running  # noqa: E402


def frames(path):
    log = mavutil.mavlink_connection(path)
    while (message := log.recv_match()) is not None:
        yield message


def joined(messages):
    """As QGroundControl does: complete at the first piece shorter than 50."""
    lines, pending = [], ""
    for message in messages:
        assert message.get_srcComponent() == 191 and len(message.text) <= 50, message
        pending += message.text
        if len(message.text) < 50:
            lines.append(pending)
            pending = ""
    assert not pending, pending
    return lines


def shown_by_mavproxy(messages):
    """What MAVProxy prints of them."""
    vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    vehicle.bind(("127.0.0.1", 0))
    vehicle.settimeout(20)
    own = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = own.heartbeat_encode(2, 12, 29, 0x03040000, 3).pack(own)
    with tempfile.TemporaryDirectory() as folder:
        with running(sys.executable, os.path.join(os.path.dirname(sys.executable), "mavproxy.py"),
                     "--master", f"udpout:127.0.0.1:{vehicle.getsockname()[1]}",
                     "--default-modules", "link", "--state-basedir", folder,
                     stdin=subprocess.PIPE, cwd=folder) as proxy:
            _, peer = vehicle.recvfrom(2048)
            vehicle.sendto(beat, peer)
            proxy.next_line(lambda line: "Detected vehicle" in line)
            # It shows the texts of one component; the answer to the second line says that it does so now.
            proxy.say("set target_component 191")
            proxy.say("set target_component")
            proxy.next_line(lambda line: "target_component" in line and "191" in line)
            for message in messages:
                vehicle.sendto(bytes(message.get_msgbuf()), peer)
            lines = []
            while len(lines) < EXPECTED:
                line = proxy.next_line(lambda line: "AP: " in line)
                lines.append(line.split("AP: ", 1)[1])
            return lines


def main():
    global EXPECTED
    folder = sys.argv[1]
    with open(os.path.join(folder, "texts.txt"), encoding="utf-8") as file:
        wanted = file.read().splitlines()
    EXPECTED = len(wanted)
    messages = list(frames(os.path.join(folder, "texts.tlog")))
    assert joined(messages) == wanted, joined(messages)
    print(f"pymavlink: {len(messages)} pieces make {len(wanted)} lines, 50 and 100 bytes among them")
    shown = shown_by_mavproxy(messages)
    assert shown == wanted, shown
    print("mavproxy: shows every one of them whole")


if __name__ == "__main__":
    main()
