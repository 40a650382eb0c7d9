//! What the supported sensors are like.

use std::ops::RangeInclusive;
use std::time::Duration;

/// Who makes a sensor, and so which protocol it speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// LDROBOT: 47-byte frames, one way.
    Ldrobot,
    /// Slamtec RPLIDAR: requests, then nodes or capsules.
    Rplidar,
    /// YDLIDAR: `AA 55` packets, with or without commands.
    Ydlidar,
    /// Hokuyo: lines of text, SCIP 2.0.
    Hokuyo,
}

/// A supported sensor; [`Model::spec`] has its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Model {
    /// LDROBOT LD06.
    Ld06,
    /// LDROBOT LD19.
    Ld19,
    /// LDROBOT STL-19P.
    Stl19p,
    /// LDROBOT STL-27L.
    Stl27l,
    /// Slamtec RPLIDAR A1.
    RplidarA1,
    /// Slamtec RPLIDAR A2M8.
    RplidarA2,
    /// Slamtec RPLIDAR A2M12 (and A2M7).
    RplidarA2m12,
    /// Slamtec RPLIDAR A3.
    RplidarA3,
    /// Slamtec RPLIDAR S1.
    RplidarS1,
    /// Slamtec RPLIDAR S2.
    RplidarS2,
    /// Slamtec RPLIDAR S3.
    RplidarS3,
    /// Slamtec RPLIDAR C1.
    RplidarC1,
    /// YDLIDAR X2.
    YdlidarX2,
    /// YDLIDAR X4.
    YdlidarX4,
    /// YDLIDAR G4.
    YdlidarG4,
    /// YDLIDAR TG15.
    YdlidarTg15,
    /// YDLIDAR TG30.
    YdlidarTg30,
    /// YDLIDAR TG50.
    YdlidarTg50,
    /// YDLIDAR T-mini Pro.
    YdlidarTminiPro,
    /// Hokuyo URG-04LX and URG-04LX-UG01.
    HokuyoUrg04lx,
    /// Hokuyo UTM-30LX.
    HokuyoUtm30lx,
    /// Any other Hokuyo that speaks SCIP 2.0 on a serial line or USB.
    HokuyoScip2,
}

/// The numbers of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spec {
    /// Its name in configuration files.
    pub name: &'static str,
    /// The maker's name for it.
    pub full_name: &'static str,
    /// Its maker.
    pub family: Family,
    /// Range measurements per second in its usual mode, with or without a return. A sensor that
    /// tells its rate is believed instead.
    pub samples_per_s: u32,
    /// The line speed that the sensor talks at, bit/s.
    pub baud: u32,
    /// Distances that the maker vouches for, m.
    pub range_m: (f64, f64),
    /// Standard deviation of one distance, m.
    pub range_sigma_m: f64,
    /// Step of the transmitted distance where it is finest, m.
    pub range_step_m: f64,
    /// Step of the transmitted angles, °; angles between are interpolated.
    pub angle_step_deg: f64,
}

impl Model {
    /// Every supported model.
    pub const ALL: [Self; 22] = [
        Self::Ld06,
        Self::Ld19,
        Self::Stl19p,
        Self::Stl27l,
        Self::RplidarA1,
        Self::RplidarA2,
        Self::RplidarA2m12,
        Self::RplidarA3,
        Self::RplidarS1,
        Self::RplidarS2,
        Self::RplidarS3,
        Self::RplidarC1,
        Self::YdlidarX2,
        Self::YdlidarX4,
        Self::YdlidarG4,
        Self::YdlidarTg15,
        Self::YdlidarTg30,
        Self::YdlidarTg50,
        Self::YdlidarTminiPro,
        Self::HokuyoUrg04lx,
        Self::HokuyoUtm30lx,
        Self::HokuyoScip2,
    ];

    /// The sensor's numbers.
    ///
    /// Sources: LDROBOT `ldlidar_stl_sdk` 3.0.3 and the LD19 data sheet; Slamtec `rplidar_sdk` 2.1.0
    /// and data sheets; `YDLidar-SDK` 1.2.20, `doc/Dataset.md`; Hokuyo's specifications by way of
    /// `urg_library`. Standard deviations are the data sheet's for the LD19 (10 mm) and the usual
    /// value of simulations for the UTM-30LX (10 mm). No maker states one for the others: theirs are
    /// cautious, half of the stated accuracy where there is one.
    #[must_use]
    pub const fn spec(self) -> Spec {
        match self {
            Self::Ld06 => ldrobot("ld06", "LDROBOT LD06", 4_500, (0.02, 12.0)),
            Self::Ld19 => ldrobot("ld19", "LDROBOT LD19", 4_500, (0.02, 12.0)),
            Self::Stl19p => ldrobot("stl19p", "LDROBOT STL-19P", 5_000, (0.03, 12.0)),
            Self::Stl27l => {
                Spec { baud: 921_600, ..ldrobot("stl27l", "LDROBOT STL-27L", 21_600, (0.03, 25.0)) }
            }
            Self::RplidarA1 => {
                rplidar("rplidar-a1", "Slamtec RPLIDAR A1", 7_874, 115_200, (0.15, 12.0))
            }
            Self::RplidarA2 => {
                rplidar("rplidar-a2", "Slamtec RPLIDAR A2", 8_000, 115_200, (0.2, 12.0))
            }
            Self::RplidarA2m12 => {
                rplidar("rplidar-a2m12", "Slamtec RPLIDAR A2M12", 16_000, 256_000, (0.2, 12.0))
            }
            Self::RplidarA3 => {
                rplidar("rplidar-a3", "Slamtec RPLIDAR A3", 16_000, 256_000, (0.2, 25.0))
            }
            Self::RplidarS1 => {
                rplidar("rplidar-s1", "Slamtec RPLIDAR S1", 9_259, 256_000, (0.1, 40.0))
            }
            Self::RplidarS2 => {
                rplidar("rplidar-s2", "Slamtec RPLIDAR S2", 32_000, 1_000_000, (0.05, 30.0))
            }
            Self::RplidarS3 => {
                rplidar("rplidar-s3", "Slamtec RPLIDAR S3", 32_000, 1_000_000, (0.05, 40.0))
            }
            Self::RplidarC1 => {
                rplidar("rplidar-c1", "Slamtec RPLIDAR C1", 5_000, 460_800, (0.05, 12.0))
            }
            Self::YdlidarX2 => ydlidar("ydlidar-x2", "YDLIDAR X2", 3_000, 115_200, (0.1, 8.0)),
            Self::YdlidarX4 => ydlidar("ydlidar-x4", "YDLIDAR X4", 5_000, 128_000, (0.12, 10.0)),
            Self::YdlidarG4 => ydlidar("ydlidar-g4", "YDLIDAR G4", 9_000, 230_400, (0.28, 16.0)),
            Self::YdlidarTg15 => {
                ydlidar_tof("ydlidar-tg15", "YDLIDAR TG15", 20_000, 512_000, (0.05, 15.0))
            }
            Self::YdlidarTg30 => {
                ydlidar_tof("ydlidar-tg30", "YDLIDAR TG30", 20_000, 512_000, (0.05, 30.0))
            }
            Self::YdlidarTg50 => {
                ydlidar_tof("ydlidar-tg50", "YDLIDAR TG50", 20_000, 512_000, (0.05, 50.0))
            }
            Self::YdlidarTminiPro => {
                ydlidar_tof("ydlidar-tmini-pro", "YDLIDAR T-mini Pro", 4_000, 230_400, (0.05, 12.0))
            }
            Self::HokuyoUrg04lx => {
                hokuyo("hokuyo-urg04lx", "Hokuyo URG-04LX", 10_240, (0.02, 5.6), 0.015, 1024.0)
            }
            Self::HokuyoUtm30lx => {
                hokuyo("hokuyo-utm30lx", "Hokuyo UTM-30LX", 57_600, (0.1, 30.0), 0.010, 1440.0)
            }
            // What it tells of itself counts: this is of the coarsest and slowest.
            Self::HokuyoScip2 => {
                hokuyo("hokuyo-scip2", "Hokuyo with SCIP 2.0", 10_240, (0.1, 30.0), 0.015, 1024.0)
            }
        }
    }

    /// The name in configuration files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.spec().name
    }

    /// The maker's name for it.
    #[must_use]
    pub const fn full_name(self) -> &'static str {
        self.spec().full_name
    }

    /// The protocol that it speaks.
    #[must_use]
    pub const fn family(self) -> Family {
        self.spec().family
    }

    /// The model with this name, in any case and with or without hyphens; a family's name alone
    /// stands for its usual member.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let plain = |name: &str| name.to_ascii_lowercase().replace(['-', '_', ' '], "");
        let name = plain(name);
        let usual = match name.as_str() {
            "rplidar" | "rplidara3m1" => Some(Self::RplidarA3),
            "rplidara1m8" => Some(Self::RplidarA1),
            "rplidara2m8" => Some(Self::RplidarA2),
            "rplidara2m7" => Some(Self::RplidarA2m12),
            "ydlidar" => Some(Self::YdlidarX4),
            "hokuyo" => Some(Self::HokuyoUtm30lx),
            "hokuyourg04lxug01" => Some(Self::HokuyoUrg04lx),
            _ => None,
        };
        usual.or_else(|| Self::ALL.into_iter().find(|model| plain(model.name()) == name))
    }

    /// Range measurements per second, with or without a return.
    #[must_use]
    pub const fn samples_per_s(self) -> u32 {
        self.spec().samples_per_s
    }

    /// Time between two samples.
    #[must_use]
    pub fn sample_period(self) -> Duration {
        Duration::from_secs(1) / self.samples_per_s()
    }

    /// The line speed that the sensor talks at, bit/s.
    #[must_use]
    pub const fn default_baud(self) -> u32 {
        self.spec().baud
    }

    /// Distances that the maker vouches for, m.
    #[must_use]
    pub const fn trusted_range_m(self) -> RangeInclusive<f64> {
        let (nearest_m, farthest_m) = self.spec().range_m;
        nearest_m..=farthest_m
    }
}

const fn ldrobot(
    name: &'static str,
    full_name: &'static str,
    samples_per_s: u32,
    range_m: (f64, f64),
) -> Spec {
    Spec {
        name,
        full_name,
        family: Family::Ldrobot,
        samples_per_s,
        baud: 230_400,
        range_m,
        range_sigma_m: 0.010,
        range_step_m: 0.001,
        angle_step_deg: 0.01,
    }
}

const fn rplidar(
    name: &'static str,
    full_name: &'static str,
    samples_per_s: u32,
    baud: u32,
    range_m: (f64, f64),
) -> Spec {
    Spec {
        name,
        full_name,
        family: Family::Rplidar,
        samples_per_s,
        baud,
        range_m,
        range_sigma_m: 0.015,
        range_step_m: 0.001,
        angle_step_deg: 1.0 / 64.0,
    }
}

const fn ydlidar(
    name: &'static str,
    full_name: &'static str,
    samples_per_s: u32,
    baud: u32,
    range_m: (f64, f64),
) -> Spec {
    Spec {
        name,
        full_name,
        family: Family::Ydlidar,
        samples_per_s,
        baud,
        range_m,
        range_sigma_m: 0.015,
        range_step_m: 0.000_25,
        angle_step_deg: 1.0 / 64.0,
    }
}

const fn ydlidar_tof(
    name: &'static str,
    full_name: &'static str,
    samples_per_s: u32,
    baud: u32,
    range_m: (f64, f64),
) -> Spec {
    Spec { range_step_m: 0.001, ..ydlidar(name, full_name, samples_per_s, baud, range_m) }
}

const fn hokuyo(
    name: &'static str,
    full_name: &'static str,
    samples_per_s: u32,
    range_m: (f64, f64),
    range_sigma_m: f64,
    steps_per_turn: f64,
) -> Spec {
    Spec {
        name,
        full_name,
        family: Family::Hokuyo,
        samples_per_s,
        baud: 115_200,
        range_m,
        range_sigma_m,
        range_step_m: 0.001,
        angle_step_deg: 360.0 / steps_per_turn,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_the_model() {
        for model in Model::ALL {
            assert_eq!(Model::from_name(model.name()), Some(model));
            assert_eq!(Model::from_name(&model.name().to_uppercase()), Some(model));
        }
        assert_eq!(Model::from_name("STL-27L"), Some(Model::Stl27l));
        assert_eq!(Model::from_name("RPLIDAR A2M8"), Some(Model::RplidarA2));
        assert_eq!(Model::from_name("a1"), None);
    }

    #[test]
    fn every_list_is_complete_and_without_doubles() {
        let mut names: Vec<_> = Model::ALL.iter().map(|model| model.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Model::ALL.len());
    }
}
