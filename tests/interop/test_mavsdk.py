"""MAVSDK arms, takes off, flies offboard and lands on the stub, as its examples do."""
import asyncio
import time
import warnings

warnings.filterwarnings("ignore", category=FutureWarning)
from mavsdk import System  # noqa: E402
from mavsdk.offboard import PositionNedYaw, VelocityNedYaw  # noqa: E402

from programs import stub  # noqa: E402

# A survey of the whole sequence, bounded so that a stuck one fails.
WITHIN_S = 120.0


async def first(stream, wanted):
    async for value in stream:
        if wanted(value):
            return value
    raise AssertionError("the stream has ended")


async def fly(address):
    drone = System()
    await drone.connect(system_address=f"udpout://{address}")
    await first(drone.core.connection_state(), lambda state: state.is_connected)
    # Indoors there is no GPS: MAVSDK's flag of the global position stays down, as on a real PX4.
    await first(drone.telemetry.health(),
                lambda health: health.is_local_position_ok and health.is_home_position_ok)
    await drone.action.set_takeoff_altitude(3.0)
    await drone.action.arm()
    await drone.action.takeoff()
    await first(drone.telemetry.position(), lambda p: p.relative_altitude_m > 2.7)
    print("mavsdk: took off")
    await drone.offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -3.0, 0.0))
    await drone.offboard.start()
    await drone.offboard.set_position_ned(PositionNedYaw(3.0, 2.0, -4.0, 90.0))
    await first(drone.telemetry.position_velocity_ned(),
                lambda o: abs(o.position.north_m - 3) < 0.2 and abs(o.position.east_m - 2) < 0.2
                and abs(o.position.down_m + 4) < 0.2)
    await first(drone.telemetry.attitude_euler(), lambda a: abs(a.yaw_deg - 90) < 5)
    print("mavsdk: flew to a place, offboard")
    await drone.offboard.set_velocity_ned(VelocityNedYaw(-1.0, 0.0, 0.0, 90.0))
    await first(drone.telemetry.position_velocity_ned(), lambda o: o.velocity.north_m_s < -0.8)
    print("mavsdk: flew at a velocity, offboard")
    await drone.offboard.stop()
    await drone.action.land()
    await first(drone.telemetry.armed(), lambda armed: not armed)


def main():
    with stub("--vision", "tracking", "--origin") as ends:
        began = time.monotonic()
        asyncio.run(asyncio.wait_for(fly(ends["listen"]), WITHIN_S))
        print(f"mavsdk: landed and disarmed after {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
