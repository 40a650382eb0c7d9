"""pymavlink flies the stub of ArduCopter in GUIDED, as ArduPilot's own examples do."""
import os
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: E402

from programs import stub, until  # noqa: E402
from test_stub import acks, connect  # noqa: E402

ACCEPTED, FAILED = 0, 4
GUIDED, LAND = 4, 9
POSITION_ONLY = 0xDF8
# Zurich, altitude 0.
ORIGIN = (473977418, 85455939, 0)


def place(link):
    """The next LOCAL_POSITION_NED, if one comes."""
    return link.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=0.5)


def is_near(link, north, east, down, within=0.3):
    p = place(link)
    near = p and max(abs(p.x - north), abs(p.y - east), abs(p.z - down)) < within
    return p if near else None


def go_to(link, north, east, down):
    link.mav.set_position_target_local_ned_send(
        0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, POSITION_ONLY, north, east, down,
        0, 0, 0, 0, 0, 0, 0, 0)


def heartbeat_of(link):
    beat = link.recv_match(type="HEARTBEAT", blocking=True, timeout=2.0,
                           condition="HEARTBEAT.autopilot==3")
    return beat


def prepare(link):
    """Streams, origin, mode: nothing of it is there by default."""
    assert acks(link, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 1, 32, 1e5) == [ACCEPTED]
    # Without an origin the vehicle does not arm, and says why.
    assert acks(link, mavlink.MAV_CMD_DO_SET_MODE, 1, 1, GUIDED) == [ACCEPTED]
    assert acks(link, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 1) == [FAILED]
    link.mav.set_gps_global_origin_send(1, *ORIGIN)
    until(lambda: place(link), 30.0, "a position")


def arm(link):
    """The checks need some seconds after the origin; then arming is accepted."""
    def armed():
        result = acks(link, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 1)
        return True if result == [ACCEPTED] else None
    until(armed, 60.0, "arming")


def main():
    with stub("--flavour", "ardupilot", "--vision", "tracking") as ends:
        link = connect(ends["listen"])
        beat = heartbeat_of(link)
        assert (beat.type, beat.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
        prepare(link)
        arm(link)
        began = time.monotonic()
        assert acks(link, mavlink.MAV_CMD_NAV_TAKEOFF, 1, 0, 0, 0, 0, 0, 0, 3) == [ACCEPTED]
        until(lambda: is_near(link, 0, 0, -3), 30.0, "the take-off")
        print("guided: took off")
        # One position is enough, and is held.
        go_to(link, 3, -2, -4)
        until(lambda: is_near(link, 3, -2, -4), 30.0, "the flight to a place")
        held_until = time.monotonic() + 4.0
        while time.monotonic() < held_until:
            p = place(link)
            assert p is None or abs(p.x - 3) < 0.5, p
        print("guided: flew to a place and held it")
        assert acks(link, mavlink.MAV_CMD_DO_SET_MODE, 1, 1, LAND) == [ACCEPTED]
        until(lambda: (b := heartbeat_of(link)) and
              (None if b.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED else b), 60.0, "the landing")
        print(f"guided: landed and disarmed {time.monotonic() - began:.0f} s after the take-off")


if __name__ == "__main__":
    main()
