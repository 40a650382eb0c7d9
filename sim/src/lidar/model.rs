//! What a LiDAR is like.

use super::Firmware;
use stockpilot::geometry::{Body, Lidar, Point, Rotation, Transform};
use stockpilot::lidar::Model;

/// The numbers of one sensor and where it is mounted.
#[derive(Debug, Clone, PartialEq)]
pub struct LidarModel {
    /// What the maker calls it.
    pub name: &'static str,
    /// What runs in it.
    pub firmware: Firmware,
    /// Range samples per second.
    pub samples_per_s: u32,
    /// Turns of the head per second.
    pub turns_per_s: f64,
    /// Standard deviation of the head's speed, as a ratio.
    pub speed_jitter_ratio: f64,
    /// Nearest range that is measured, m.
    pub range_min_m: f64,
    /// Farthest range that is measured, m.
    pub range_max_m: f64,
    /// Standard deviation of a range, m.
    pub range_sigma_m: f64,
    /// Every range is reported longer by this, m.
    pub range_bias_m: f64,
    /// Every range is reported longer by this times itself.
    pub range_scale: f64,
    /// Samples are stamped later than they were measured by this, s.
    pub stamp_offset_s: f64,
    /// Share of samples without a return even near and square on.
    pub dropout_ratio: f64,
    /// Share of beams that dust in the air sends back before they reach a surface.
    pub dust_ratio: f64,
    /// Half the angle of the beam's cone in the scan plane, rad; where the cone meets two surfaces,
    /// the range lies between them. 0 for a beam without width.
    pub half_width_rad: f64,
    /// Speed of the serial line, bit/s.
    pub baud: u32,
    /// True mounting of the sensor on the body.
    pub body_from_lidar: Transform<Body, Lidar>,
}

impl LidarModel {
    /// LDROBOT LD19: 4 500 samples/s to 12 m.
    ///
    /// Source: data sheet (range, standard deviation of 10 mm, 230 400 bit/s).
    #[must_use]
    pub fn ld19() -> Self {
        Self::of(Model::Ld19)
    }

    /// LDROBOT STL-27L: 21 600 samples/s to 25 m.
    #[must_use]
    pub fn stl27l() -> Self {
        Self::of(Model::Stl27l)
    }

    /// The sensor that the service knows by this name.
    ///
    /// Rates, line speed and reach are the data sheet's, which the service has too; everything
    /// else is the simulator's own.
    #[must_use]
    pub fn of(model: Model) -> Self {
        let spec = model.spec();
        let plain = Self {
            name: spec.full_name,
            firmware: firmware(model),
            samples_per_s: spec.samples_per_s,
            turns_per_s: 10.0,
            speed_jitter_ratio: 0.002,
            range_min_m: spec.range_m.0,
            range_max_m: spec.range_m.1,
            range_sigma_m: 0.010,
            range_bias_m: 0.0,
            range_scale: 0.0,
            stamp_offset_s: 0.0,
            dropout_ratio: 0.005,
            dust_ratio: 0.0,
            half_width_rad: 0.0,
            baud: spec.baud,
            body_from_lidar: hanging_mount(),
        };
        match model {
            Model::Ld19 => Self { name: "LD19", ..plain },
            Model::Stl27l => Self { name: "STL-27L", ..plain },
            // USB: the speed that is set on the port means nothing.
            Model::HokuyoUtm30lx => Self { turns_per_s: 40.0, ..plain },
            _ => plain,
        }
    }
}

const fn firmware(model: Model) -> Firmware {
    match model {
        Model::Ld06 | Model::Ld19 | Model::Stl19p | Model::Stl27l => Firmware::Ldrobot,
        Model::RplidarA1 => Firmware::Rplidar(0x18),
        Model::RplidarA2 => Firmware::Rplidar(0x28),
        Model::RplidarA2m12 => Firmware::Rplidar(0x2C),
        Model::RplidarA3 => Firmware::Rplidar(0x31),
        Model::RplidarS1 => Firmware::Rplidar(0x61),
        Model::RplidarS2 => Firmware::Rplidar(0x71),
        Model::RplidarS3 => Firmware::Rplidar(0x81),
        Model::RplidarC1 => Firmware::Rplidar(0x41),
        Model::YdlidarX2 => Firmware::Ydlidar(0),
        Model::YdlidarX4 => Firmware::Ydlidar(6),
        Model::YdlidarG4 => Firmware::Ydlidar(5),
        Model::YdlidarTg15 => Firmware::Ydlidar(100),
        Model::YdlidarTg30 => Firmware::Ydlidar(101),
        Model::YdlidarTg50 => Firmware::Ydlidar(102),
        Model::YdlidarTminiPro => Firmware::Ydlidar(150),
        Model::HokuyoUrg04lx => Firmware::Hokuyo(1024),
        Model::HokuyoUtm30lx => Firmware::Hokuyo(1440),
    }
}

/// Below the body, with the scan plane across the flight and x pointing down.
fn hanging_mount() -> Transform<Body, Lidar> {
    let pitched_down = Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0);
    Transform::new(pitched_down, Point::new(0.0, 0.0, -0.08))
}
