//! Every sensor that the service has a driver for, as the simulator has it.
//!
//! Only names, rates, line speeds and reaches come from the service's own list; how a sensor
//! measures and what its bytes are is the simulator's.

use crate::lidar::{Fading, Firmware, LidarModel, hanging_mount};
use stockpilot::lidar::Model;

/// How far a beam points beside where its sample says, °: the head does not turn evenly between the marks
/// of its encoder. Data sheets are silent on it; an eighth of the LD19's step between beams.
const ANGLE_SIGMA_DEG: f64 = 0.1;

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
            angle_sigma_rad: ANGLE_SIGMA_DEG.to_radians(),
            range_bias_m: 0.0,
            range_scale: 0.0,
            stamp_offset_s: 0.0,
            dropout_ratio: 0.005,
            fading: Fading::None,
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
            Model::HokuyoScip2 => Self { turns_per_s: 15.0, ..plain },
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
        Model::HokuyoUrg04lx => Firmware::Hokuyo(682),
        Model::HokuyoUtm30lx => Firmware::Hokuyo(1081),
        Model::HokuyoScip2 => Firmware::Hokuyo(769),
    }
}
