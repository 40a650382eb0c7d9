//! The results as files: CSV for each setting over time, CSV of all settings, pictures.

use super::GROUPS;
use super::band::{Band, mean_band};
use super::flight::{FlownFlight, LOOK_EVERY};
use super::plot;
use super::summary::{SettingReport, count};
use anyhow::Context;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Mean over the flights at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Instant {
    /// s since the simulation's start.
    pub(super) at_s: f64,
    pub(super) n_runs: usize,
    /// NEES of each group.
    pub(super) nees: [f64; 4],
    /// The 95 % bands of these means over `n_runs` independent flights.
    pub(super) bands: [Band; 4],
    /// NIS over its degrees of freedom, of all attempts since the instant before; NaN without one.
    pub(super) nis_per_dof: f64,
}

/// The means over the flights at each instant at which at least half of them are in the air.
pub(super) fn series(flights: &[FlownFlight]) -> Vec<Instant> {
    #[derive(Default)]
    struct Bin {
        nees: [f64; 4],
        n: usize,
        nis: f64,
        dof: f64,
    }
    let bin_of = |at_s: f64| (at_s / LOOK_EVERY.as_secs_f64()).round();
    let mut bins = BTreeMap::<u64, Bin>::new();
    for flight in flights {
        let flying = flight.looks.iter().filter(|look| look.is_flying);
        for look in flying.filter(|look| look.nees.iter().all(|nees| nees.is_finite())) {
            let bin = bins.entry(index(bin_of(look.at_s))).or_default();
            bin.n += 1;
            for (sum, nees) in std::iter::zip(&mut bin.nees, look.nees) {
                *sum += nees;
            }
        }
        for fix in flight.fixes.iter().filter(|fix| fix.is_flying && !fix.is_gated) {
            let bin = bins.entry(index(bin_of(fix.at_s))).or_default();
            bin.nis += fix.nis;
            bin.dof += fix.dof;
        }
    }
    let with_half = bins.into_iter().filter(|(_, bin)| 2 * bin.n >= flights.len().max(1));
    with_half
        .map(|(index, bin)| {
            let n = count(bin.n);
            Instant {
                at_s: count(usize::try_from(index).unwrap_or(usize::MAX))
                    * LOOK_EVERY.as_secs_f64(),
                n_runs: bin.n,
                nees: bin.nees.map(|sum| sum / n),
                bands: GROUPS.map(|(_, states)| mean_band(states, n)),
                nis_per_dof: bin.nis / bin.dof,
            }
        })
        .collect()
}

#[expect(clippy::cast_possible_truncation, reason = "a few minutes of fifths of seconds")]
#[expect(clippy::cast_sign_loss, reason = "times are positive")]
const fn index(bin: f64) -> u64 {
    bin as u64
}

/// Writes the time series and the picture of one setting.
///
/// # Errors
/// A directory that cannot be written to.
pub(super) fn write_setting(
    directory: &Path,
    report: &SettingReport,
    flights: &[FlownFlight],
) -> anyhow::Result<()> {
    let series = series(flights);
    let stem = format!("{}-{}ms", report.update, report.latency_ms);
    write(&directory.join(format!("nees-{stem}.csv")), &series_csv(&series))?;
    let title = format!(
        "NEES over {} flights, {} update, {} ms latency",
        report.n_runs, report.update, report.latency_ms
    );
    let svg = plot::svg(&title, report, &series)?;
    write(&directory.join(format!("nees-{stem}.svg")), &svg)
}

/// Writes one line per setting and group.
///
/// # Errors
/// A directory that cannot be written to.
pub(super) fn write_summary(directory: &Path, reports: &[SettingReport]) -> anyhow::Result<()> {
    write(&directory.join("summary.csv"), &summary_csv(reports))
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

fn series_csv(series: &[Instant]) -> String {
    let mut csv = String::from("time_s,n_runs");
    for (name, _) in GROUPS {
        let _infallible = write!(csv, ",{name}_nees,{name}_band_low,{name}_band_high");
    }
    csv.push_str(",nis_per_dof\n");
    for instant in series {
        let _infallible = write!(csv, "{:.1},{}", instant.at_s, instant.n_runs);
        for (nees, band) in std::iter::zip(instant.nees, instant.bands) {
            let _infallible = write!(csv, ",{nees:.4},{:.4},{:.4}", band.low, band.high);
        }
        let _infallible = writeln!(csv, ",{:.4}", instant.nis_per_dof);
    }
    csv
}

fn summary_csv(reports: &[SettingReport]) -> String {
    let mut csv = String::from(
        "update,latency_ms,n_runs,group,nees_mean,band_low,band_high,is_inside,n_effective\n",
    );
    for report in reports {
        let head = format!("{},{},{}", report.update, report.latency_ms, report.n_runs);
        for (name, group) in report.by_name() {
            let _infallible = writeln!(
                csv,
                "{head},{name},{:.4},{:.4},{:.4},{},{:.1}",
                group.nees_mean,
                group.band_low,
                group.band_high,
                group.is_inside,
                group.n_effective
            );
        }
        let nis = report.nis;
        let is_inside = (nis.band_low..=nis.band_high).contains(&nis.per_dof_mean);
        let _infallible = writeln!(
            csv,
            "{head},nis_per_dof,{:.4},{:.4},{:.4},{is_inside},",
            nis.per_dof_mean, nis.band_low, nis.band_high
        );
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consistency::flight::Look;

    fn flight(nees: f64, n_looks: usize) -> FlownFlight {
        let looks = (0..n_looks)
            .map(|k| Look {
                at_s: 0.2 * count(k) + 0.003,
                is_flying: true,
                nees: [nees; 4],
                position_error_m: 0.0,
                yaw_error_rad: 0.0,
                n_tags: 9,
            })
            .collect();
        FlownFlight { seed: 0, looks, fixes: Vec::new() }
    }

    #[test]
    fn instants_hold_the_mean_of_the_flights_in_the_air() {
        let series = series(&[flight(2.0, 3), flight(5.0, 3), flight(8.0, 1)]);
        let rows: Vec<(usize, f64)> = series.iter().map(|i| (i.n_runs, i.nees[0])).collect();
        assert_eq!(rows, [(3, 5.0), (2, 3.5), (2, 3.5)]);
        let csv = series_csv(&series);
        let columns = |line: &str| line.split(',').count();
        assert!(csv.lines().all(|line| columns(line) == 15), "{csv}");
        assert_eq!(csv.lines().count(), 4);
    }
}
