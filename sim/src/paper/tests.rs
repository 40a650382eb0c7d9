use super::*;

#[test]
fn the_published_table_stands_beside_the_runs_as_printed_and_no_others() {
    for experiment in EXPERIMENTS {
        let expected = match (experiment.method, experiment.planner) {
            (Method::AsPrinted, Planner::Greedy) => Some((2.26, 2.53)),
            (Method::AsPrinted, Planner::SquareWave) => Some((2.42, 2.30)),
            _ => None,
        };
        let published =
            experiment.published.map(|p| (p.sigma_over_volume_percent, p.error_percent));
        assert_eq!(published, expected, "{}", experiment.name());
    }
    let names: std::collections::BTreeSet<String> =
        EXPERIMENTS.iter().map(Experiment::name).collect();
    assert_eq!(names.len(), EXPERIMENTS.len(), "files would overwrite each other");
}
