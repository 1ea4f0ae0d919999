//! Planners that drive the AV of a run, and the metrics that judge it.

use std::fs;
use std::path::Path;

use reactsim::Benchmark;
use reactsim::evaluation::{
    AvChoice, FinishedRun, PlannerRanks, Row, read_provenance, read_rows, read_study, read_summary,
};
use reactsim::metrics::Score;

use crate::program::{MINI, json_of, said, text};
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

fn value(row: &Row, metric: &str) -> Option<f64> {
    row.metrics[metric].map(|value| match value {
        Score::Value(value) => value,
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
    assert!(printed.contains("driven by planner pdm-closed,every=5"), "{printed}");
    let both = [one.to_str().unwrap(), two.to_str().unwrap()];
    let compared = said(&[&["compare"], &both[..]].concat(), 0).0;
    let head = "idm, AV driven by planner pdm-closed,every=5: 2 scenarios";
    assert!(compared.contains(head) && compared.contains("| AV score ↑ "), "{compared}");
    let table = said(&[&["report"], &both[..]].concat(), 0).0;
    assert!(table.contains("| two | pdm-closed,every=5 | IDM"), "{table}");
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
    scenario.start.map.edit().lanes.clear();
    let av: AvChoice = "planner:idm".parse().unwrap();
    let error = Benchmark::scenarios([scenario]).baseline("stop").av(av).run().unwrap_err().to_string();
    let reason = "record 0: scenario `road-000`: the map has no lanes for motor vehicles";
    assert!(error.contains(reason), "{error}");
}

#[test]
fn planners_are_studied_under_several_simulators() {
    let home = tempfile::tempdir().unwrap();
    let (out, alone) = (home.path().join("study"), home.path().join("alone"));
    let folder = out.to_str().unwrap();
    let study = ["study", "planners", "--limit", "3", "--models", "log-replay,idm", "--planners", "idm"];
    let (printed, _) = said(&[&study[..], &["--out", folder]].concat(), 0);
    for part in [
        "AV score ↑ by planner:",
        "| idm minus log | IDM ",
        "| idm minus log | change, ",
        "Rank of the planners",
        "Kendall's tau",
        "Agents ignored the AV",
    ] {
        assert!(printed.contains(part), "{part}: {printed}");
    }
    let first = printed.find("| idm minus log | IDM ").unwrap();
    assert!(first < printed.find("AV score ↑ by planner:").unwrap(), "the answer comes first: {printed}");
    // The shipped scenarios have deviated AVs, whose run tells whether agents freeze.
    let members = read_study(&out).unwrap().members;
    let names: Vec<&str> = members.iter().map(|member| member.folder.as_str()).collect();
    assert_eq!(names, ["log", "idm", "deviated"]);
    let run = ["run", "--limit", "3", "--models", "log-replay,idm", "--av", "planner:idm", "--out"];
    said(&[&run[..], &[alone.to_str().unwrap()]].concat(), 0);
    let of_member = read_rows(&out.join("idm")).unwrap();
    assert_eq!(of_member, read_rows(&alone).unwrap(), "a member is a run");

    let ranks = PlannerRanks::read(&out).unwrap().unwrap();
    assert_eq!((ranks.score.as_str(), ranks.scenarios), ("av-score", 3));
    assert_eq!(ranks.planners, ["log", "idm"]);
    let summaries = ["log", "idm"].map(|member| read_summary(&out.join(member)).unwrap());
    for simulator in &ranks.simulators {
        for (score, summary) in simulator.scores.iter().zip(&summaries) {
            let mean = summary.simulators[&simulator.id].metrics["av-score"].mean.unwrap();
            assert!((score - mean).abs() < 1e-12, "{}", simulator.id);
        }
        let [a, b] = simulator.scores[..] else { panic!("{simulator:?}") };
        let expected = if a == b {
            [1.5, 1.5]
        } else if a > b {
            [1.0, 2.0]
        } else {
            [2.0, 1.0]
        };
        assert_eq!(simulator.ranks, expected);
        assert!(simulator.ignored.is_some_and(|n| n <= simulator.at_fault), "{simulator:?}");
    }
    // Log replay never over-reacts, and ignores every AV.
    let replay = &ranks.simulators[0];
    assert_eq!((replay.frozen, replay.ignored), (None, Some(replay.at_fault)));
    assert!(ranks.simulators[1].frozen.is_some());
    let agreement = &ranks.agreement[0];
    assert_eq!((ranks.agreement.len(), agreement.low), (1, None), "too few scenarios for an interval");
    assert!(ranks.change.is_some());

    let written = fs::read(out.join("planners.json")).unwrap();
    let (_, messages) = said(&[&study[..], &["--out", folder, "--resume"]].concat(), 0);
    assert!(messages.contains("2 of 3: idm: already finished"), "{messages}");
    assert_eq!(fs::read(out.join("planners.json")).unwrap(), written);
    let latex = said(&["report", folder, "--format", "latex"], 0).0;
    assert!(latex.contains("Kendall's tau") && latex.contains("AV score"), "{latex}");
    assert!(latex.contains("idm minus log & IDM & "), "{latex}");
    // The differences are those of `compare`.
    let json = said(&[&study[..], &["--out", folder, "--resume", "--format", "json"]].concat(), 0).0;
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let pair = &json["planner_pairs"][0];
    let [first, second] = ["log", "idm"].map(|member| out.join(member).display().to_string());
    let compared = ["compare", &first, &second, "--despite", "av,entering", "--format", "json"];
    let compared: serde_json::Value = serde_json::from_str(&said(&compared, 0).0).unwrap();
    for (i, simulator) in ["log-replay", "idm"].into_iter().enumerate() {
        let found = compared.as_array().unwrap().iter().find(|c| c["first"] == simulator).unwrap();
        let paired = &found["metrics"]["av-score"];
        assert_eq!(pair["differences"][i]["mean"], paired["difference"]["mean"], "{simulator}");
        assert_eq!(pair["differences"][i]["p"], paired["p"], "{simulator}");
    }

    // On logs, agents enter whatever drives the AV.
    let of_logs = home.path().join("logs");
    let on_logs = ["study", "planners", MINI, "--limit=1", "--models=log-replay", "--planners=idm", "--out"];
    said(&[&on_logs[..], &[text(&of_logs)]].concat(), 0);
    for member in ["log", "idm", "deviated"] {
        let settings = &json_of(&of_logs.join(member).join("provenance.json"))["settings"];
        assert_eq!(settings["entering"], "log", "{member}");
    }

    let refused = |more: &[&str]| said(&[&study[..6], more, &["--out", "never"]].concat(), 2).1;
    assert!(refused(&["--av", "log"]).contains("`study planners` sets it: leave out --av"));
    assert!(refused(&["--planners", "pdm-closed", "--tracker", "perfect"]).contains("use tracker=lqr"));
    assert!(refused(&["--planners", "external:mine"]).contains("define it with `planner` NAME=COMMAND"));
    assert!(refused(&["--planners", "simulator:log-replay"]).contains("cannot drive the AV"));
}

#[test]
fn a_simulator_and_the_network_drive_the_av() {
    let home = tempfile::tempdir().unwrap();
    for (av, driver) in
        [("planner:simulator:idm", "idm"), ("planner:diffusion-planner,every=40", "diffusion-planner")]
    {
        let out = home.path().join(driver);
        run(av, &out, &["--jobs", "2"]);
        let again = home.path().join(format!("{driver}-again"));
        run(av, &again, &["--jobs", "1", "--batch", "1"]);
        let rows = read_rows(&out).unwrap();
        assert_eq!(rows, read_rows(&again).unwrap(), "{av}: threads and batches change nothing");
        let judged = rows.iter().filter(|row| row.rollout.is_some());
        assert_eq!(
            judged.filter(|row| value(row, "av-score").is_some_and(|score| score > 0.0)).count(),
            4,
            "{av}"
        );
        let provenance = read_provenance(&out).unwrap();
        assert_eq!(provenance.settings.av, av);
        assert_eq!(provenance.driver.unwrap().id, driver);
    }
}
