//! Planners that drive the AV of a run, and the metrics that judge it.

use std::path::Path;

use reactsim::Benchmark;
use reactsim::evaluation::{AvChoice, FinishedRun, Row, Value, read_rows, read_summary};

use crate::reference::said;
use crate::small_scenarios;

/// Ids of the metrics of the AV.
const PARTS: [&str; 8] = [
    "av-at-fault-collisions",
    "av-drivable-area",
    "av-driving-direction",
    "av-making-progress",
    "av-expert-progress",
    "av-time-to-collision",
    "av-speed-limit",
    "av-comfort",
];

/// Runs `idm` and `log-replay` on shipped scenarios with this AV. Returns what is printed.
fn run(av: &str, out: &Path, more: &[&str]) -> String {
    let out = out.to_str().unwrap();
    let command = ["run", "--limit", "2", "--models", "log-replay,idm", "--av", av, "--out", out];
    said(&[&command[..], more].concat(), 0).0
}

/// Returns a value of a row.
fn value(row: &Row, metric: &str) -> Option<f64> {
    row.metrics[metric].map(|value| match value {
        Value::Value(value) => value,
        other => panic!("{metric}: {other:?}"),
    })
}

#[test]
fn a_planner_is_judged_next_to_the_agents() {
    let home = tempfile::tempdir().unwrap();
    let (one, two) = (home.path().join("one"), home.path().join("two"));
    let av = "planner:pdm-closed,every=5";
    let printed = run(av, &one, &["--jobs", "1", "--batch", "1"]);
    run(av, &two, &["--jobs", "2", "--batch", "2"]);
    assert!(printed.contains("judged by nuPlan's closed-loop metrics"), "{printed}");
    assert!(printed.contains("AV planner:pdm-closed,every=5"), "{printed}");
    let (rows, again) = (read_rows(&one).unwrap(), read_rows(&two).unwrap());
    assert_eq!(rows, again, "threads and batches change nothing");
    let judged: Vec<&Row> = rows.iter().filter(|row| row.rollout.is_some()).collect();
    assert_eq!(judged.len(), 4);
    for row in judged {
        let parts = PARTS.map(|part| value(row, part));
        assert!(parts.iter().flatten().all(|part| (0.0..=1.0).contains(part)), "{parts:?}");
        let (score, partial) = (value(row, "av-score"), value(row, "av-score-partial"));
        assert!(score.is_some() != partial.is_some(), "{row:?}");
        assert_eq!(score.is_some(), parts.iter().all(Option::is_some), "{row:?}");
        // Generated maps have everything that the metrics need.
        let [a, b, c, d, progress, ttc, limit, comfort] = parts.map(Option::unwrap);
        let expected = a * b * c * d * (5.0 * progress + 5.0 * ttc + 4.0 * limit + 2.0 * comfort) / 16.0;
        assert!((score.unwrap() - expected).abs() < 1e-12, "{row:?}");
        // What the metrics had to substitute is counted.
        assert_eq!(row.outcomes["av route: neighbour-groups"], 1);
    }
    // Every value below 1, except for progress, has its events.
    let run = FinishedRun::open(&one).unwrap();
    for (place, entry) in &run.tally().entries {
        for (simulator, id) in run.tally().simulators.iter().enumerate() {
            let row = rows
                .iter()
                .find(|r| r.scenario == entry.scenario && r.simulator == *id && r.rollout == Some(0));
            for part in PARTS.iter().filter(|part| !part.ends_with("progress")) {
                let is_perfect = value(row.unwrap(), part) == Some(1.0);
                assert_eq!(
                    run.counted(*place, simulator, part) == 0,
                    is_perfect,
                    "{part} of {}",
                    entry.scenario
                );
            }
        }
    }
    let summary = read_summary(&one).unwrap();
    assert!(summary.simulators["idm"].metrics["av-score"].mean.is_some());
}

#[test]
fn the_logged_av_is_judged_without_a_change_for_the_agents() {
    let home = tempfile::tempdir().unwrap();
    let (judged, plain) = (home.path().join("judged"), home.path().join("plain"));
    run("planner:log", &judged, &[]);
    let printed = run("log", &plain, &[]);
    assert!(!printed.contains("nuPlan"), "{printed}");
    let of_agents = |mut row: Row| {
        row.metrics.retain(|metric, _| !metric.starts_with("av-"));
        row.outcomes.retain(|outcome, _| !outcome.starts_with("av "));
        row
    };
    let (judged, plain) = (read_rows(&judged).unwrap(), read_rows(&plain).unwrap());
    assert!(judged.iter().any(|row| row.rollout.is_some() && value(row, "av-expert-progress") == Some(1.0)));
    assert!(plain.iter().all(|row| !row.metrics.contains_key("av-score")));
    assert_eq!(judged.into_iter().map(of_agents).collect::<Vec<_>>(), plain);
    let summary = read_summary(&home.path().join("plain")).unwrap();
    assert!(!summary.simulators["idm"].metrics.contains_key("av-score"), "not judged");
}

#[test]
fn a_map_without_lanes_is_a_failure_with_its_reason() {
    let mut scenario = small_scenarios::deviating(0, false);
    scenario.start.map.lanes.clear();
    let av: AvChoice = "planner:idm".parse().unwrap();
    let error = Benchmark::scenarios([scenario]).baseline("stop").av(av).run().unwrap_err().to_string();
    let reason = "record 0: scenario `road-000`: the map has no lanes for motor vehicles";
    assert!(error.contains(reason), "{error}");
}

#[test]
fn wrong_planners_are_refused_with_the_mend() {
    let refused = |av: &str, more: &[&str]| {
        let command = ["run", "--limit", "1", "--models", "stop", "--av", av];
        said(&[&command[..], more].concat(), 2).1
    };
    assert!(
        refused("planner:pdm", &[])
            .contains("choose log, pdm-closed, idm, diffusion-planner, simulator:<id>")
    );
    assert!(refused("planner:pdm-closed,tracker=perfect", &[]).contains("use tracker=lqr"));
    assert!(refused("planner:idm,every=81", &[]).contains("1 to 80 steps"));
    let realism = refused("planner:idm", &["--protocol", "realism"]);
    assert!(realism.contains("--av"), "{realism}");
}
