"""A whole flight with MAVProxy as the ground station and pymavlink behind it.

    stub ◀─ UDP ─▶ MAVProxy ◀─ UDP ─▶ pymavlink

The flight is the real service with emulated devices; only these two say when it starts and ends.
"""
import json
import os
import re
import subprocess
import sys
import tempfile
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from programs import program, running, until  # noqa: E402

COMPANION = 191
ACCEPTED, UNSUPPORTED = 0, 3
SLOWEST_FLIGHT_S = 400.0


class Behind:
    """pymavlink on MAVProxy's second link; keeps what component 191 says."""

    def __init__(self):
        self.link = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=254,
                                               source_component=190)
        self.port = self.link.port.getsockname()[1]
        self.values, self.texts, self.acks, self.params, self.beats = {}, [], [], {}, []
        self._pieces = {}

    def hear(self):
        """Takes in the next message; its name if it is of the companion."""
        message = self.link.recv_match(blocking=True, timeout=0.5)
        if message is None or message.get_srcComponent() != COMPANION:
            return None
        name = message.get_type()
        if name == "HEARTBEAT":
            self.beats.append((time.monotonic(), message))
        elif name == "NAMED_VALUE_FLOAT":
            self.values.setdefault(message.name, []).append(message.value)
        elif name == "STATUSTEXT":
            self._join(message)
        elif name == "PARAM_VALUE":
            self.params[message.param_id] = message
        elif name == "COMMAND_ACK" and message.target_system == 254:
            self.acks.append((message.command, message.result))
        return name

    def _join(self, message):
        whole = self._pieces.pop(message.id, "") + message.text
        if message.id and len(message.text) == 50:
            self._pieces[message.id] = whole
        else:
            self.texts.append(whole)

    def until(self, happened, within_s=60.0, what="it"):
        def look():
            self.hear()
            return True if happened() else None
        until(look, within_s, what)

    def command(self, number, confirmation=0):
        self.link.mav.command_long_send(1, COMPANION, number, confirmation, 0, 0, 0, 0, 0, 0, 0)


def answered(behind, number, result, confirmation=0):
    """Sends a command and waits for its answer."""
    n_before = len(behind.acks)
    behind.command(number, confirmation)
    behind.until(lambda: len(behind.acks) > n_before, what=f"an answer to {number}")
    assert behind.acks[-1] == (number, result), behind.acks


def check_identity(behind):
    behind.until(lambda: len(behind.beats) >= 4, what="four heartbeats of the companion")
    beat = behind.beats[-1][1]
    assert beat.get_srcSystem() == 1
    assert beat.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert beat.autopilot == mavlink.MAV_AUTOPILOT_INVALID


def check_parameters(behind):
    behind.link.mav.param_request_list_send(1, COMPANION)
    behind.until(lambda: behind.params and
                 len(behind.params) == next(iter(behind.params.values())).param_count,
                 what="the companion's parameters")
    assert all(name.startswith("SP_") for name in behind.params), behind.params
    height = behind.params["SP_HEIGHT_M"].param_value
    assert behind.params["SP_STEPS"].param_value == 4.0
    behind.params.clear()
    behind.link.mav.param_set_send(1, COMPANION, b"SP_HEIGHT_M", 99.0,
                                   mavlink.MAV_PARAM_TYPE_REAL32)
    behind.until(lambda: "SP_HEIGHT_M" in behind.params, what="an answer to PARAM_SET")
    assert behind.params["SP_HEIGHT_M"].param_value == height


def check_commands(behind):
    # Nothing but the five is taken: not arming, not a mode, not a reboot.
    for number in (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE,
                   mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN):
        answered(behind, number, UNSUPPORTED)
    # Start, and start again as if the answer had been lost.
    for confirmation in range(3):
        answered(behind, mavlink.MAV_CMD_USER_1, ACCEPTED, confirmation)


def check_display(behind, proxy):
    """MAVProxy shows the volume, in numbers and in words, as they were sent."""
    shown = proxy.next_line(lambda line: re.search(r"NAMED_VALUE_FLOAT.*name : VOLUME", line),
                            SLOWEST_FLIGHT_S)
    number = float(re.search(r"value : ([-0-9.e]+)", shown).group(1))
    text = proxy.next_line(lambda line: re.search(r"volume [0-9.]+ \+- [0-9.]+ m3", line), 60.0)
    print(f"mavproxy shows: {number:.1f} m3, and {text.strip()!r}")
    return number


def main():
    behind = Behind()
    with tempfile.TemporaryDirectory() as folder:
        flight = running(program("stockpilot-sim"), "fly", "--ground", "127.0.0.1:0", "--steps", "4",
                         "--speed", "2", "--json", "--log", folder)
        with flight as fly:
            line = fly.next_line(lambda line: line.startswith('{"ground"'))
            ground = json.loads(line)["ground"]
            # --non-interactive would read no commands; the modules are those that are needed.
            with running(sys.executable, os.path.join(os.path.dirname(sys.executable), "mavproxy.py"),
                         "--master", f"udpout:{ground}", "--out", f"127.0.0.1:{behind.port}",
                         "--default-modules", "link,cmdlong,param,misc,output",
                         "--state-basedir", folder, stdin=subprocess.PIPE, cwd=folder) as proxy:
                check_identity(behind)
                check_parameters(behind)
                proxy.say("set target_component 191")
                proxy.say("watch NAMED_VALUE_FLOAT")
                check_commands(behind)
                print("pymavlink: heartbeat, parameters, commands of the companion ok")
                number = None
                behind.until(lambda: "VOLUME" in behind.values, SLOWEST_FLIGHT_S, "a volume")
                number = check_display(behind, proxy)
                behind.until(lambda: any(abs(v - number) < 1e-3 for v in behind.values["VOLUME"]),
                             what="the number that MAVProxy showed")
                behind.until(lambda: {"VOL_U", "COVERAGE", "POS_SIGMA", "FIX_Q"} <=
                             behind.values.keys(), what="U, coverage and fix quality")
                behind.until(lambda: any("final volume" in text for text in behind.texts),
                             SLOWEST_FLIGHT_S, "the final text")
                assert max(behind.values["FIX_Q"]) <= 100.0
                assert fly.process.wait(60) == 0, fly.tail()
                fly.drain()
        report = json.loads(fly.lines[-1])
        final = behind.values["VOLUME"][-1]
        assert abs(report["volume_m3"] - final) < 0.01 * final, (report["volume_m3"], final)
        print(f"pymavlink: {final:.1f} m3 at the end, the flight's report says the same")


if __name__ == "__main__":
    main()
