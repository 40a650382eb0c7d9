//! The mounting of the LiDAR out of the log of a flight in an empty hall.

use crate::support::{record, short_survey};
use nalgebra::Vector3;
use stockpilot::calibration::mount::{AXES, Limits};
use stockpilot::survey::{MountOptions, calibrate_mount};
use stockpilot_sim::calibration::{CalibrationErrors, CalibrationSigmas, ErrorSource};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::{Conditions, Planner, Scenario, Surface};
use stockpilot_sim::world::{GridScale, World};

/// A level floor of 20 m × 20 m.
fn empty_hall() -> World {
    let row = ["0"; 20].join(" ");
    let rows = vec![row; 20].join("\n");
    let head = "ncols 20\nnrows 20\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
    World::from_esri_ascii("empty", &format!("{head}{rows}\n"), GridScale { xy: 1.0, z: 1.0 })
        .expect("a grid")
}

#[test]
fn a_recorded_flight_shows_how_the_lidar_is_mounted() {
    let (shift_m, turn_deg) = (Vector3::new(0.009, -0.006, 0.004), Vector3::new(0.5, -0.35, 0.3));
    let scenario = Scenario {
        world: empty_hall(),
        // The one that turns the scan plane.
        planner: Planner::Horizon,
        surface: Surface::MaternField,
        conditions: Conditions {
            sigmas: CalibrationSigmas::default().only(&[ErrorSource::Mount, ErrorSource::Clock]),
            errors: CalibrationErrors {
                mount_position_m: shift_m,
                mount_rotation_rad: turn_deg.map(f64::to_radians),
                clock_offset_s: 0.003,
                ..CalibrationErrors::default()
            },
            ..Conditions::default()
        },
        ..short_survey(7, 30)
    };
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("flight.mcap");
    let mut config = config(&scenario, Devices::none());
    config.surface.solve_interval_s = Some(20.0);
    // Any path that turns does.
    config.planning.search_effort = 0.1;
    record(&scenario, &config, &log);
    let options = MountOptions {
        hall_is_empty: true,
        wall_sigma_m: 0.002,
        floor_sigma_m: Some(0.001),
        clock_sigma_s: Some(0.05),
        limits: Limits::default(),
    };
    let found = calibrate_mount(&log, &options).expect("a calibration").mount;
    println!("{found:?}");
    for (axis, seen) in found.axes.iter().enumerate() {
        let (expected, limit) = if axis < 3 {
            (shift_m[axis], 0.005)
        } else {
            (turn_deg[axis - 3].to_radians(), 0.1_f64.to_radians())
        };
        let off = seen.change - expected;
        assert!(seen.is_seen, "{}: ± {}", AXES[axis], seen.sigma);
        assert!(off.abs() < limit && off.abs() < 3.5 * seen.sigma, "{}: {off}", AXES[axis]);
        // Six numbers: one beyond 2 σ happens in every fourth flight, beyond 3 σ in every sixtieth.
        assert!(seen.halves_z.abs() < 3.0, "{}: {}", AXES[axis], seen.halves_z);
    }
    let clock = found.clock_offset_s;
    assert!(clock.is_seen, "{clock:?}");
    let off_s = clock.change - 0.003;
    assert!(off_s.abs() < 0.001 && off_s.abs() < 3.5 * clock.sigma, "{clock:?}");
}
