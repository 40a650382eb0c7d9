//! A comparison for people.

use super::{ComparedRun, Comparison};

/// One line for each planner.
pub(super) fn text(comparison: &Comparison) -> String {
    let mut text = format!(
        "to σ/V = {:.2} % ({}), medians; a flight that never gets there is infinitely long\n\
         {:<12} {:>8} {:>8} {:>8} {:>8} {:>8} {:>9} {:>7} {:>8} {:>6} {:>8} {:>8}\n",
        100.0 * comparison.target_sigma_over_volume,
        comparison.surface,
        "planner",
        "reached",
        "path m",
        "time s",
        "Wh",
        "σ/V %",
        "rms err %",
        "cover",
        "collided",
        "left",
        "charge %",
        "plan ms",
    );
    for (name, planner) in &comparison.planners {
        let reached = format!("{}/{}", planner.n_reached, planner.n_runs);
        text.push_str(&format!(
            "{name:<12} {reached:>8} {:>8} {:>8} {:>8} {:>8} {:>9} {:>7} {:>8} {:>6} {:>8} {:>8.1}\n",
            number(planner.median_path_to_target_m, 1.0, 1),
            number(planner.median_time_to_target_s, 1.0, 1),
            number(planner.median_energy_to_target_wh, 1.0, 2),
            number(planner.final_sigma_over_volume, 100.0, 3),
            number(planner.rms_relative_error, 100.0, 3),
            number(planner.coverage_95, 1.0, 2),
            planner.collisions,
            planner.left_free_space,
            number(planner.least_charge_ratio, 100.0, 0),
            planner.plan_ms_median,
        ));
    }
    text
}

/// A number with its decimals; ∞ where there is none.
fn number(value: Option<f64>, times: f64, decimals: usize) -> String {
    value.map_or_else(|| "∞".to_owned(), |v| format!("{:.decimals$}", times * v))
}

#[expect(clippy::print_stderr, reason = "the program's output")]
pub(super) fn print_progress(run: &ComparedRun) {
    eprintln!(
        "{} seed {} {}: target after {} m, {} s; σ/V {} %, error {} % after {:.1} m{}{}{}",
        run.world,
        run.seed,
        run.planner,
        number(run.path_to_target_m, 1.0, 1),
        number(run.time_to_target_s, 1.0, 1),
        number(run.final_sigma_over_volume, 100.0, 3),
        number(run.relative_error, 100.0, 3),
        run.path_m,
        if run.has_collided { ", COLLIDED" } else { "" },
        if run.has_left_free_space { ", LEFT FREE SPACE" } else { "" },
        if run.has_ended { "" } else { ", NO END" },
    );
}
