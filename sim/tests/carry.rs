//! A carried survey of the markers: recovered from its log, against where they hang.

#![expect(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use clap::Parser;
use stockpilot::markers::{Constraints, SurveyRequest, survey};
use stockpilot_sim::carry::{PRINTER_SIGMA, carry};
use stockpilot_sim::scenario::{Scenario, ScenarioArgs};

#[derive(Debug, Parser)]
struct Args {
    #[command(flatten)]
    scenario: ScenarioArgs,
}

fn alps(seed: u64) -> Scenario {
    Args::parse_from(["test", "--world", "alps"]).scenario.scenario(seed).unwrap()
}

/// The places of the corners are not known to the survey; they are compared one by one.
#[test]
fn all_tags_are_found_within_a_centimetre_and_within_what_is_claimed() {
    let (mut n_axes, mut n_within, mut nees, mut n_tags) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..1 {
        let folder = tempfile::tempdir().unwrap();
        let (log, file) = (folder.path().join("carry.mcap"), folder.path().join("tapes.toml"));
        let scenario = alps(seed);
        let carried = carry(&scenario, &log).unwrap();
        std::fs::write(&file, &carried.constraints_toml).unwrap();
        let request = SurveyRequest {
            fixed: Vec::new(),
            fixed_sigma_m: 0.003,
            edge_m: None,
            scale_sigma: PRINTER_SIGMA,
            every_s: 0.3,
            corner_sigma_px: None,
            constraints: Constraints::read(&file).unwrap(),
        };
        let report = survey(&log, &request).unwrap();
        // What was seen from one place only is named and left out.
        println!("not tied: {:?}", report.not_tied);
        assert!(report.not_tied.len() <= 3, "{:?}", report.not_tied);
        assert!(report.tags.len() + 6 >= carried.truth.len(), "{}", report.tags.len());
        let mut squares = 0.0;
        for tag in &report.tags {
            let truth = carried.truth.iter().find(|t| t.id == tag.name.id).unwrap();
            let centre = truth.centre().coords;
            for axis in 0..3 {
                let off = tag.place_m[axis] - centre[axis];
                squares += off * off;
                n_axes += 1.0;
                n_within += f64::from(u8::from(off.abs() <= 2.0 * tag.sigma_m[axis]));
                nees += (off / tag.sigma_m[axis]).powi(2);
            }
            n_tags += 1.0;
        }
        let rms_m = (squares / report.tags.len() as f64).sqrt();
        let held_out = report.held_out.unwrap();
        println!(
            "seed {seed}: {} tags, {} frames, rms {:.1} mm, largest σ {:.1} mm, {} outliers, factor {:.2}, \
             held out {held_out:?}, edges {:.5} ± {:.5}",
            report.tags.len(),
            report.n_frames_used,
            1e3 * rms_m,
            1e3 * report.tags.iter().flat_map(|t| t.sigma_m).fold(0.0, f64::max),
            report.n_outliers,
            report.variance_factor,
            report.edge_factor,
            report.edge_factor_sigma,
        );
        for tape in &report.tapes {
            println!("{tape:?}");
        }
        assert!(rms_m < 0.01, "{rms_m} m");
        assert!(held_out.agrees, "{held_out:?}");
        assert!(report.tapes.len() == 6 && report.tapes.iter().filter(|t| t.agrees).count() >= 5);
    }
    println!(
        "{n_tags} tags: {:.3} of the axes within 2σ, mean square of error/σ {:.2}",
        n_within / n_axes,
        nees / n_axes
    );
    // A normal error is within 2σ in 95 of 100; the tags of one survey err together, so few are independent.
    assert!(n_within / n_axes > 0.9, "{}", n_within / n_axes);
    assert!(nees / n_axes < 2.0, "{}", nees / n_axes);
}
