//! Surveys made by hand: what is shared follows from the configurations, verdicts from the numbers.

use super::*;
use crate::messages::{BudgetRow, VolumeBudget, VolumeShares};
use crate::time::Stamp;

const EXAMPLE: &str = include_str!("../../../deploy/config.example.toml");

const BAYS: &str = "
[[bays]]
name = \"gravel\"
polygon_m = [[0, 0], [8, 0], [8, 10], [0, 10]]
density_t_per_m3 = 1.5
density_sigma_t_per_m3 = 0.1
[[bays]]
name = \"sand\"
polygon_m = [[8, 0], [16, 0], [16, 10], [8, 10]]
base = { kind = \"level\", height_m = 0.1, sigma_m = 0.02 }
";

/// 1 m³ of noise, a range bias, one tag, and a base, in this order 2, 3 and 4 m³ each.
fn account(name: &str, volume_m3: f64) -> VolumeAccount {
    let mut budget = VolumeBudget::default();
    budget.rows.push(BudgetRow { source: BudgetSource::BeamNoise, var_m6: 1.0 });
    budget.push_shared(BudgetSource::RangeBias, &[(200.0, 0.01)]);
    budget.push_shared(BudgetSource::MarkerMap, &[(600.0, 0.005)]);
    budget.push_shared(BudgetSource::Base, &[(-400.0, 0.01)]);
    let sigma_m3 = budget.var_m6().sqrt();
    let mass = (name == "gravel")
        .then(|| Density { mean_t_per_m3: 1.5, sigma_t_per_m3: 0.1 }.mass(volume_m3, sigma_m3));
    VolumeAccount {
        name: name.to_owned(),
        estimate: VolumeEstimate { at: Stamp::ZERO, volume_m3, sigma_m3, coverage_ratio: 1.0 },
        mass,
        budget,
        shares: VolumeShares::default(),
    }
}

fn survey(toml: &str, volumes_m3: [f64; 2]) -> Survey {
    let path = PathBuf::from("flight.mcap");
    let config = Config::from_toml(toml, &path).expect("valid");
    let [gravel, sand] = volumes_m3;
    let accounts =
        vec![account("hall", gravel + sand), account("gravel", gravel), account("sand", sand)];
    Survey { path, config, place: SurveyPlace::default(), accounts, surface: None, is_final: true }
}

fn toml() -> String {
    format!("{EXAMPLE}\n{BAYS}")
}

fn compared(earlier: &str, later: &str, independent: &[Origin]) -> ChangeReport {
    let surveys = (survey(earlier, [100.0, 50.0]), survey(later, [112.0, 51.0]));
    compare(&surveys.0, &surveys.1, 0.05, independent).expect("comparable")
}

#[test]
fn equal_configurations_share_all_constant_errors_and_they_cancel() {
    let report = compared(&toml(), &toml(), &[]);
    assert_eq!(report.shared, Origin::ALL);
    let names: Vec<&str> = report.bays.iter().map(|bay| bay.name.as_str()).collect();
    assert_eq!(names, ["hall", "gravel", "sand"]);
    let gravel = &report.bays[1];
    // Only the noise is left, twice; without sharing it would be 2 (1 + 4 + 9 + 16) = 60.
    assert!((gravel.change.sigma_m3 - 2.0_f64.sqrt()).abs() < 1e-9);
    assert!((gravel.change.unshared_sigma_m3 - 60.0_f64.sqrt()).abs() < 1e-9);
    assert_eq!(gravel.change.verdict, ChangeVerdict::Significant);
    assert_eq!(report.bays[2].change.verdict, ChangeVerdict::Noise);
    // 12 m³ of 1.5 t/m³: (1.5 · √2)² + (12 · 0.1)² + (√2 · 0.1)² = 5.96
    let mass = gravel.mass.expect("a density");
    assert!((mass.mass_t - 18.0).abs() < 1e-9 && (mass.sigma_t.powi(2) - 5.96).abs() < 1e-9);
    let text = gravel.to_string();
    assert!(text.starts_with("gravel: (12.0 ± 2.8) m³ (k = 2), (18.0 ± 4.9) t"), "{text}");
    assert!(text.contains("significant") && text.contains("accepted 5 %"), "{text}");
    assert!(report.bays[2].to_string().contains("noise"), "{}", report.bays[2]);
    assert!(report.bays[2].mass.is_none());
}

#[test]
fn what_differs_in_the_configurations_is_not_shared() {
    let sigma = |later: &str| {
        let report = compared(&toml(), later, &[]);
        (report.shared, report.bays[1].change.sigma_m3.powi(2))
    };
    let remounted = toml().replacen("[0.08, 0.0, -0.06]", "[0.09, 0.0, -0.06]", 1);
    assert_ne!(remounted, toml());
    let (shared, var_m6) = sigma(&remounted);
    assert_eq!(shared, [Origin::Markers, Origin::Base]);
    // 2 · (1 + 4)
    assert!((var_m6 - 10.0).abs() < 1e-9, "{var_m6}");
    // What `lidar check --write` changes, by the last bit that it writes.
    for [was, is] in [
        ["range_bias_m = 0.0", "range_bias_m = 0.00001"],
        ["range_scale = 0.0", "range_scale = 0.000001"],
    ] {
        let recalibrated = toml().replacen(was, is, 1);
        assert_ne!(recalibrated, toml());
        let (shared, var_m6) = sigma(&recalibrated);
        assert_eq!(shared, [Origin::Markers, Origin::Base], "{is}");
        assert!((var_m6 - 10.0).abs() < 1e-9, "{var_m6}");
    }
    let new_base = toml().replace("height_m = 0.1, sigma_m = 0.02", "height_m = 0.2");
    let (shared, var_m6) = sigma(&new_base);
    assert_eq!(shared, [Origin::Lidar, Origin::Markers]);
    assert!((var_m6 - 34.0).abs() < 1e-9, "{var_m6}");
    // The user knows better than the files.
    let report = compared(&toml(), &toml(), &[Origin::Lidar, Origin::Markers]);
    assert!((report.bays[1].change.sigma_m3.powi(2) - 28.0).abs() < 1e-9);
    assert_eq!(report.shared, [Origin::Base]);
}

#[test]
fn surveys_of_different_ground_are_refused() {
    let refusal = |later: &str| {
        let surveys = (survey(&toml(), [1.0, 2.0]), survey(later, [1.0, 2.0]));
        compare(&surveys.0, &surveys.1, 0.05, &[]).expect_err("differs").to_string()
    };
    let moved = toml().replace("[16, 10], [8, 10]", "[16, 11], [8, 11]");
    assert!(refusal(&moved).contains("outline of bay \"sand\""));
    let blocked = format!("{}\n[[exclusions]]\npolygon_m = [[1, 1], [2, 1], [2, 2]]\n", toml());
    assert!(refusal(&blocked).contains("exclusions"));
    // A pillar that stands on the floor takes ground away; a lamp does not.
    let obstacle = |from_m: f64| {
        let corners = "[[3, 3], [4, 3], [4, 4], [3, 4]]";
        let heights = format!("[{from_m:?}, 3.0]");
        format!(
            "{}\n[[obstacles]]\nkind = \"prism\"\npolygon_m = {corners}\nheights_m = {heights}\n",
            toml()
        )
    };
    assert!(refusal(&obstacle(0.0)).contains("obstacles"));
    let with_lamp = survey(&obstacle(2.5), [1.0, 2.0]);
    assert!(compare(&survey(&toml(), [1.0, 2.0]), &with_lamp, 0.05, &[]).is_ok());
    let wider = toml().replacen("exclusion_margin_m = 0.12", "exclusion_margin_m = 0.13", 1);
    assert!(refusal(&wider).contains("hall.exclusion_margin_m"));
    let finer = toml().replacen("cell_m = 0.25", "cell_m = 0.2", 1);
    assert!(refusal(&finer).contains("surface.cell_m"));
    let error = compare(&survey(&toml(), [1.0, 2.0]), &survey(&toml(), [1.0, 2.0]), 0.0, &[]);
    assert!(error.expect_err("no risk").to_string().contains("risk"));
}

#[test]
fn a_bay_of_one_survey_only_is_named_and_the_hall_is_left_out() {
    let with_salt = toml().replace("name = \"sand\"", "name = \"salt\"");
    let shorter = with_salt.replacen("[16, 10], [8, 10]", "[16, 9], [8, 9]", 1);
    let compared_with = |toml: &str| {
        let mut later = survey(toml, [1.0, 2.0]);
        later.accounts[2].name = "salt".to_owned();
        compare(&survey(&self::toml(), [1.0, 2.0]), &later, 0.05, &[]).expect("comparable")
    };
    let names = |report: &ChangeReport| -> Vec<String> {
        report.bays.iter().map(|bay| bay.name.clone()).collect()
    };
    // By another name the ground of the hall is the same.
    let renamed = compared_with(&with_salt);
    assert_eq!(
        (renamed.only_earlier.as_slice(), renamed.only_later.as_slice()),
        (["sand".to_owned()].as_slice(), ["salt".to_owned()].as_slice())
    );
    assert_eq!(names(&renamed), ["hall", "gravel"]);
    assert!(!renamed.is_hall_left_out);
    // 8 m² less are in its sum: what lies there would be a change.
    let other = compared_with(&shorter);
    assert_eq!(names(&other), ["gravel"]);
    assert!(other.is_hall_left_out);
}
