//! Messages that both families fill alike.

use super::estimator::Belief;
use super::frames::{single, whole, wire_quaternion};
use super::stub::Sensors;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use nalgebra::Vector3;
use stockpilot::time::{Boot, Stamp};
use stockpilot::units::GRAVITY_MPS2;

/// Metres per degree of latitude on the WGS 84 ellipsoid, near enough for a hall.
const M_PER_DEG: f64 = 111_319.49;

/// Milliseconds since the boot; wraps after 49.7 days, as on the wire.
pub(super) fn boot_ms(now: Stamp<Boot>) -> u32 {
    u32::try_from((now.nanos() / 1_000_000).rem_euclid(1 << 32)).unwrap_or(0)
}

/// Microseconds since the boot.
pub(super) fn boot_us(now: Stamp<Boot>) -> u64 {
    u64::try_from(now.nanos() / 1_000).unwrap_or(0)
}

pub(super) fn attitude(belief: &Belief, time_boot_ms: u32) -> MavMessage {
    let (roll, pitch, yaw) = belief.attitude.euler_angles();
    let rate = &belief.rate_radps;
    MavMessage::ATTITUDE(m::ATTITUDE_DATA {
        time_boot_ms,
        roll: single(roll),
        pitch: single(pitch),
        yaw: single(yaw),
        rollspeed: single(rate.x),
        pitchspeed: single(rate.y),
        yawspeed: single(rate.z),
    })
}

pub(super) fn attitude_quaternion(belief: &Belief, time_boot_ms: u32) -> MavMessage {
    let [q1, q2, q3, q4] = wire_quaternion(&belief.attitude);
    let rate = &belief.rate_radps;
    MavMessage::ATTITUDE_QUATERNION(m::ATTITUDE_QUATERNION_DATA {
        time_boot_ms,
        q1,
        q2,
        q3,
        q4,
        rollspeed: single(rate.x),
        pitchspeed: single(rate.y),
        yawspeed: single(rate.z),
        repr_offset_q: [0.0; 4],
    })
}

pub(super) fn local_position(belief: &Belief, time_boot_ms: u32) -> MavMessage {
    let [x, y, z] = <[f64; 3]>::from(belief.position_m).map(single);
    let [vx, vy, vz] = <[f64; 3]>::from(belief.velocity_mps).map(single);
    MavMessage::LOCAL_POSITION_NED(m::LOCAL_POSITION_NED_DATA { time_boot_ms, x, y, z, vx, vy, vz })
}

pub(super) fn global_position(
    belief: &Belief,
    origin: &m::GPS_GLOBAL_ORIGIN_DATA,
    home_m: &Vector3<f64>,
    time_boot_ms: u32,
) -> MavMessage {
    let p = &belief.position_m;
    let latitude_deg = f64::from(origin.latitude) * 1e-7;
    let per_deg_east = M_PER_DEG * latitude_deg.to_radians().cos().max(1e-3);
    let cmps = |v: f64| i16::try_from(whole(v * 1e2)).unwrap_or(0);
    let v = &belief.velocity_mps;
    let heading_cdeg = belief.yaw_rad.to_degrees().rem_euclid(360.0) * 1e2;
    MavMessage::GLOBAL_POSITION_INT(m::GLOBAL_POSITION_INT_DATA {
        time_boot_ms,
        lat: origin.latitude.saturating_add(small_int(p.x / M_PER_DEG * 1e7)),
        lon: origin.longitude.saturating_add(small_int(p.y / per_deg_east * 1e7)),
        alt: small_int(f64::from(origin.altitude) - p.z * 1e3),
        relative_alt: small_int((home_m.z - p.z) * 1e3),
        vx: cmps(v.x),
        vy: cmps(v.y),
        vz: cmps(v.z),
        hdg: u16::try_from(whole(heading_cdeg)).unwrap_or(u16::MAX),
    })
}

/// What the inertial sensors and the barometer feel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Felt {
    pub(super) accel_frd_mps2: Vector3<f64>,
    pub(super) gyro_frd_radps: Vector3<f64>,
    pub(super) pressure_height_m: f64,
}

impl Felt {
    pub(super) fn highres_imu(&self, time_usec: u64) -> MavMessage {
        let [xacc, yacc, zacc] = <[f64; 3]>::from(self.accel_frd_mps2).map(single);
        let [xgyro, ygyro, zgyro] = <[f64; 3]>::from(self.gyro_frd_radps).map(single);
        MavMessage::HIGHRES_IMU(m::HIGHRES_IMU_DATA {
            time_usec,
            xacc,
            yacc,
            zacc,
            xgyro,
            ygyro,
            zgyro,
            pressure_alt: single(self.pressure_height_m),
            abs_pressure: single(1013.25 - 0.12 * self.pressure_height_m),
            temperature: 35.0,
            // Accelerometer, gyroscope, absolute pressure, pressure altitude, temperature.
            fields_updated: m::HighresImuUpdatedFlags::from_bits_retain(0x1A3F),
            ..m::HIGHRES_IMU_DATA::DEFAULT
        })
    }

    /// Thousandths of g and of rad/s, cut towards zero as a C cast does.
    pub(super) fn raw_imu(&self, time_usec: u64) -> MavMessage {
        #[expect(clippy::cast_possible_truncation, reason = "as the firmware's own cast")]
        let cut = |value: f64| value.clamp(-32_768.0, 32_767.0) as i16;
        let [xacc, yacc, zacc] =
            <[f64; 3]>::from(self.accel_frd_mps2).map(|a| cut(a * 1e3 / GRAVITY_MPS2));
        let [xgyro, ygyro, zgyro] = <[f64; 3]>::from(self.gyro_frd_radps).map(|w| cut(w * 1e3));
        MavMessage::RAW_IMU(m::RAW_IMU_DATA {
            time_usec,
            xacc,
            yacc,
            zacc,
            xgyro,
            ygyro,
            zgyro,
            ..m::RAW_IMU_DATA::DEFAULT
        })
    }
}

pub(super) fn battery_status(
    sensors: &Sensors,
    charge_state: m::MavBatteryChargeState,
) -> MavMessage {
    let cell_mv = u16::try_from(whole(sensors.battery_voltage_v * 250.0)).unwrap_or(u16::MAX);
    let mut voltages = [u16::MAX; 10];
    voltages[..4].fill(cell_mv);
    MavMessage::BATTERY_STATUS(m::BATTERY_STATUS_DATA {
        current_consumed: -1,
        energy_consumed: -1,
        temperature: i16::MAX,
        voltages,
        current_battery: i16::try_from(whole(sensors.battery_current_a * 1e2)).unwrap_or(-1),
        battery_function: m::MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL,
        mavtype: m::MavBatteryType::MAV_BATTERY_TYPE_LIPO,
        battery_remaining: percent(sensors.battery_charge_ratio),
        charge_state,
        ..m::BATTERY_STATUS_DATA::DEFAULT
    })
}

pub(super) fn small_int(value: f64) -> i32 {
    i32::try_from(whole(value)).unwrap_or(i32::MAX)
}

pub(super) fn percent(ratio: f64) -> i8 {
    i8::try_from(whole((ratio * 100.0).clamp(0.0, 100.0))).unwrap_or(-1)
}

/// What `SYS_STATUS` says beside the battery's numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Health {
    pub(super) has_position: bool,
    pub(super) has_charge: bool,
    /// The checks for the present mode pass.
    pub(super) is_armable: bool,
}

/// Gyroscopes, accelerometers and barometer are always there and well.
const ALWAYS_WELL: u32 = 0x0000_000b;
const AHRS: u32 = 0x0020_0000;
const BATTERY: u32 = 0x0200_0000;
const PREARM: u32 = 0x1000_0000;

pub(super) fn sys_status(sensors: &Sensors, health: Health) -> MavMessage {
    let bits = |bits| m::MavSysStatusSensor::from_bits_retain(bits);
    let present = bits(ALWAYS_WELL | AHRS | BATTERY | PREARM);
    let well =
        [(health.has_position, AHRS), (health.has_charge, BATTERY), (health.is_armable, PREARM)]
            .iter()
            .filter(|(is_well, _)| *is_well)
            .fold(ALWAYS_WELL, |well, (_, bit)| well | bit);
    MavMessage::SYS_STATUS(m::SYS_STATUS_DATA {
        onboard_control_sensors_present: present,
        onboard_control_sensors_enabled: present,
        onboard_control_sensors_health: bits(well),
        load: 300,
        voltage_battery: u16::try_from(whole(sensors.battery_voltage_v * 1e3)).unwrap_or(0),
        current_battery: i16::try_from(whole(sensors.battery_current_a * 1e2)).unwrap_or(-1),
        battery_remaining: percent(sensors.battery_charge_ratio),
        ..m::SYS_STATUS_DATA::DEFAULT
    })
}
