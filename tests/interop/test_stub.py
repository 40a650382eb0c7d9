"""pymavlink asks the stub of PX4 what was seen on PX4 v1.16.1 itself."""
import collections
import os
import struct
import tempfile
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from programs import stub, until  # noqa: E402

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
OFFBOARD = 6


def connect(address, system=255, component=190):
    """A client that has been heard and has heard a heartbeat."""
    link = mavutil.mavlink_connection(f"udpout:{address}", source_system=system,
                                      source_component=component, dialect="ardupilotmega")
    beat(link)
    assert link.wait_heartbeat(timeout=10), "no heartbeat"
    return link


def beat(link, kind=mavlink.MAV_TYPE_GCS):
    link.mav.heartbeat_send(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE)


def acks(link, command, n, *params):
    """The results of all answers to a command; fails if there are more or fewer than n."""
    drain(link)
    link.mav.command_long_send(1, 1, command, 0, *(list(params) + [0.0] * 7)[:7])
    results = []
    deadline = time.monotonic() + 1.0
    while time.monotonic() < deadline:
        answer = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=0.2)
        if answer and answer.command == command:
            results.append(answer.result)
    assert len(results) == n, (command, results)
    return results


def drain(link):
    while link.recv_match(blocking=False):
        pass


def heartbeat_and_streams():
    with stub("--vision", "tracking") as ends:
        link = connect(ends["listen"])
        counts = collections.Counter()
        began = time.monotonic()
        last = None
        while time.monotonic() - began < 4.0:
            message = link.recv_match(blocking=True, timeout=1.0)
            if message:
                counts[message.get_type()] += 1
                last = message if message.get_type() == "HEARTBEAT" else last
        assert (last.type, last.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4)
        assert last.custom_mode == 0x03040000, hex(last.custom_mode)
        # Rates of the onboard link, Hz; a busy machine may lose a few.
        for name, rate in {"HEARTBEAT": 1, "ATTITUDE": 100, "HIGHRES_IMU": 50, "ODOMETRY": 30,
                           "LOCAL_POSITION_NED": 30, "TIMESYNC": 10}.items():
            assert 0.7 * rate * 4 - 1 <= counts[name] <= 1.1 * rate * 4 + 1, (name, counts)
        assert not counts["STATUSTEXT"] and not counts["GLOBAL_POSITION_INT"], counts


def parameters():
    with stub("--param", "EKF2_EV_CTRL=15") as ends:
        link = connect(ends["listen"])
        link.mav.param_request_list_send(1, 1)
        seen = {}

        def whole():
            value = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=1.0)
            if value:
                seen[value.param_id] = value
            return seen if "_HASH_CHECK" in seen else None

        until(whole, what="the end of the list")
        count = seen["EKF2_EV_CTRL"].param_count
        assert len(seen) == count + 1, (len(seen), count)
        assert seen["_HASH_CHECK"].param_index == 65535
        control = seen["EKF2_EV_CTRL"]
        assert control.param_type == mavlink.MAV_PARAM_TYPE_INT32
        assert bits(control.param_value) == 15
        assert seen["EKF2_EV_DELAY"].param_type == mavlink.MAV_PARAM_TYPE_REAL32
        # Unknown names and wrong types get no answer; right ones the new value.
        link.mav.param_request_read_send(1, 1, b"NO_SUCH_NAME", -1)
        link.mav.param_set_send(1, 1, b"EKF2_EV_CTRL", 3.0, mavlink.MAV_PARAM_TYPE_REAL32)
        assert link.recv_match(type="PARAM_VALUE", blocking=True, timeout=1.0) is None
        as_float = struct.unpack("<f", struct.pack("<i", 11))[0]
        link.mav.param_set_send(1, 1, b"EKF2_EV_CTRL", as_float, mavlink.MAV_PARAM_TYPE_INT32)
        answer = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=5.0)
        assert bits(answer.param_value) == 11, answer


def bits(value):
    return struct.unpack("<i", struct.pack("<f", value))[0]


def commands():
    with stub("--vision", "tracking") as ends:
        link = connect(ends["listen"])
        set_mode, arm = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
        assert acks(link, mavlink.MAV_CMD_DO_SET_RELAY, 1) == [UNSUPPORTED]
        assert acks(link, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 1, 12345, 1e5) == [FAILED]
        # PX4 chooses the rate of its heartbeat itself.
        assert acks(link, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 1, 0, 33333) == [FAILED]
        assert acks(link, mavlink.MAV_CMD_REQUEST_MESSAGE, 1, 12345) == [DENIED]
        # Disarmed, any mode is accepted, twice; armed it is not without setpoints.
        assert acks(link, set_mode, 2, 1, OFFBOARD) == [ACCEPTED, ACCEPTED]
        assert acks(link, arm, 1, 1) == [TEMPORARILY_REJECTED]
        assert acks(link, arm, 1, 0) == [ACCEPTED]
        drain(link)
        link.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0)
        version = link.recv_match(type="AUTOPILOT_VERSION", blocking=True, timeout=5.0)
        assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        # Another component's command gets silence.
        link.mav.command_long_send(1, 99, arm, 0, 1, 0, 0, 0, 0, 0, 0)
        condition = f"COMMAND_ACK.command=={arm}"
        assert link.recv_match(type="COMMAND_ACK", condition=condition, blocking=True,
                               timeout=1.0) is None


def refusal_without_position():
    with stub("--ground", "udpin:127.0.0.1:0") as ends:
        ground = connect(ends["ground"])
        assert acks(ground, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 1) == [TEMPORARILY_REJECTED]
        # The text goes to the ground station, and 50 characters at a time.
        ground.mav.command_long_send(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
        text = ground.recv_match(type="STATUSTEXT", blocking=True, timeout=5.0)
        assert text.text.startswith("Arming denied: Resolve system health failures firs"), text


def signing():
    with tempfile.TemporaryDirectory() as folder:
        key = bytes(range(7, 39))
        path = os.path.join(folder, "key")
        with open(path, "w", encoding="ascii") as file:
            file.write(key.hex())
        os.chmod(path, 0o600)
        with stub("--signing-key", path) as ends:
            link = mavutil.mavlink_connection(f"udpout:{ends['listen']}", source_system=255,
                                              source_component=190)
            # Unsigned: the stub neither listens nor is believed.
            link.setup_signing(key, sign_outgoing=False, allow_unsigned_callback=lambda *_: False)
            link.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_RELAY, 0, 0, 0, 0, 0, 0, 0, 0)
            assert link.recv_match(type="COMMAND_ACK", blocking=True, timeout=1.0) is None
            link.setup_signing(key, sign_outgoing=True, allow_unsigned_callback=lambda *_: False)
            link.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_RELAY, 0, 0, 0, 0, 0, 0, 0, 0)
            answer = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=5.0)
            assert answer and answer.get_signed() and answer.result == UNSUPPORTED


def main():
    for check in (heartbeat_and_streams, parameters, commands, refusal_without_position, signing):
        check()
        print(f"stub as pymavlink sees it: {check.__name__} ok")


if __name__ == "__main__":
    main()
