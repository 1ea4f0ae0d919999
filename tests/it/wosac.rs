//! The realism metrics of the Sim Agents challenge as a user computes them: from submissions and from runs.

use std::collections::BTreeSet;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use reactsim::evaluation::realism::LogFiles;
use reactsim::formats::wosac::{SubmissionReader, WosacLogs};
use serde_json::{Value, json};

use crate::program::{json_of, lines_of, refused, result, said, text, words};
use crate::shared;
use reactsim_test_support::proto::{Proto, records};

/// The metadata that the server requires.
pub(crate) const METADATA: &str = "
account_name = \"somebody@example.org\"
unique_method_name = \"Constant velocity\"
num_model_parameters = \"0\"
uses_lidar_data = false
uses_camera_data = false
uses_public_model_pretraining = false
";

fn unpacked(path: &Path) -> Vec<u8> {
    zstd::decode_all(fs::File::open(path).unwrap()).unwrap()
}

/// The recordings of WOMD.
fn recordings() -> Option<PathBuf> {
    shared("data/womd")
}

#[test]
fn rollouts_of_others_have_the_official_scores() {
    let (Some(golden), Some(recordings)) = (shared("wosac_golden"), recordings()) else { return };
    for id in ["2a1e44d405a6833f", "ee519cf571686d19"] {
        let expected = unpacked(&golden.join(format!("{id}.expected.json.zst")));
        let expected: Value = serde_json::from_slice(&expected).unwrap();
        let rollouts = golden.join(format!("{id}.rollouts.binproto.zst"));
        let raw = golden.join(format!("{id}.scenario.binproto.zst"));
        let scenarios = if raw.exists() { raw } else { recordings.clone() };
        let configs = "2025,2024,2023,2024_challenge_code";
        let begin = ["score", text(&rollouts), "--wosac", "--partial", "--scenarios", text(&scenarios)];
        let found = result(&[&begin[..], &["--wosac-config", configs]].concat());
        for config in configs.split(',') {
            for kind in ["metrics", "buckets"] {
                let found = found["configs"][config][kind].as_object().unwrap();
                for (name, value) in found {
                    let expected = expected[config][kind][name].as_f64().unwrap();
                    let difference = (value.as_f64().unwrap() - expected).abs();
                    assert!(difference < 1e-6, "{id} {config} {name}: {value} is not {expected}");
                }
            }
        }
    }
}

#[test]
fn runs_become_submissions_with_the_same_scores() {
    let Some(recordings) = recordings() else { return };
    let home = tempfile::tempdir().unwrap();
    let file = recordings.join("val/womd-val-00000-of-00002.tfrecord.zst");
    let (run, archive) = (home.path().join("run"), home.path().join("cv.tar.gz"));
    let metadata = home.path().join("cv.toml");
    fs::write(&metadata, METADATA).unwrap();
    let realism = |rollouts: &str, out: &Path, more: &[&str]| {
        let begin = ["run", text(&file), "--models", "constant-velocity", "--protocol", "realism"];
        let rest = ["--rollouts", rollouts, "--keep-rollouts", "--out", text(out)];
        said(&[&begin[..], &rest, more].concat(), 0);
    };
    realism("32", &run, &["--all-agents", "--limit", "3"]);
    let export = |run: &Path, code| {
        let begin = ["export", "wosac", text(run), "--scenarios", text(&file), "--metadata", text(&metadata)];
        said(&[&begin[..], &["--out", text(&archive), "--shards", "2"]].concat(), code).1
    };
    // The recordings have more than three scenarios.
    let warned = export(&run, 1);
    assert!(warned.contains("are not in the run"), "{warned}");

    let scores = |path: &Path, out: &str| {
        let out = home.path().join(out);
        let begin = ["score", text(path), "--wosac", "--partial", "--scenarios", text(&file)];
        assert_eq!(result(&[&begin[..], &["--out", text(&out)]].concat())["scenarios"], 3);
        let mut rows = lines_of(&out.join("wosac.jsonl"));
        rows.iter_mut().for_each(|row| drop(row.as_object_mut().unwrap().remove("method").unwrap()));
        rows
    };
    assert_eq!(scores(&run, "of-run"), scores(&archive, "of-archive"));
    let (_, complete) = said(&["score", text(&archive), "--wosac", "--scenarios", text(&file)], 1);
    assert!(complete.contains("scenarios without rollouts"), "{complete}");

    // Runs that the challenge would not accept.
    let logs = WosacLogs::open(&file).unwrap().map(Result::unwrap);
    let crowded = logs.into_iter().find(|log| log.simulated().count() > 64).unwrap().scenario_id;
    for (name, rollouts, more, fault) in [
        (
            "few",
            "2",
            &["--all-agents", "--limit", "1"][..],
            "has 2 rollouts per scenario: run with --rollouts 32",
        ),
        ("slow", "32", &["--all-agents", "--limit", "1", "--replan", "20steps"], "at least 1 Hz"),
        ("some", "32", &["--id", &crowded], "run with `all-agents`"),
        ("coming", "32", &["--all-agents", "--limit", "1", "--entering", "log"], "run with `entering` off"),
    ] {
        let run = home.path().join(name);
        realism(rollouts, &run, more);
        let error = export(&run, 2);
        assert!(error.contains(fault), "{name}: {error}");
    }
}

#[test]
fn objects_of_size_zero_are_simulated_scored_and_submitted() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let (file, run, archive, metadata) =
        (at("v.tfrecord"), at("run"), at("submission.tar.gz"), at("method.toml"));
    let mut message = Proto::default();
    message.tracks[0].4 = 0.0;
    message.edges = true;
    fs::write(&file, records(&[message])).unwrap();
    fs::write(&metadata, METADATA).unwrap();
    let begin = ["run", text(&file), "--models", "idm", "--protocol", "realism", "--keep-rollouts"];
    let rest = ["--rollouts", "32", "--all-agents", "--out", text(&run)];
    said(&[&begin[..], &rest].concat(), 0);
    let scenarios = ["--scenarios", text(&file)];
    let found = result(&[&["score", text(&run), "--wosac"][..], &scenarios].concat());
    assert_eq!(found["scenarios"], 1, "{found}");
    let out = ["--metadata", text(&metadata), "--out", text(&archive)];
    said(&[&["export", "wosac", text(&run)][..], &scenarios, &out].concat(), 0);
    let submitted = SubmissionReader::open(&archive).unwrap().next().unwrap().unwrap().rollouts;
    let objects: BTreeSet<i32> = submitted.joint_scenes[0].trajectories.iter().map(|t| t.object_id).collect();
    assert_eq!(objects, [7, 8, 9].into());
    // A plain archive is scored, and the server would refuse it.
    let mut plain = Vec::new();
    flate2::read::GzDecoder::new(fs::File::open(&archive).unwrap()).read_to_end(&mut plain).unwrap();
    let tar = at("plain.tar");
    fs::write(&tar, plain).unwrap();
    let (_, warned) = said(&[&["score", text(&tar), "--wosac"][..], &scenarios].concat(), 0);
    assert!(warned.contains("the server would refuse the submission"), "{warned}");
    let (_, refused) = said(&["score", text(&at("none")), "--wosac", "--simulator", "idm"], 2);
    assert!(refused.contains("could not find"), "{refused}");
}

#[test]
fn recordings_without_a_future_become_submissions() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let (file, run, archive, metadata) =
        (at("testing.tfrecord"), at("run"), at("submission.tar.gz"), at("method.toml"));
    let withheld = |id: &str| Proto { id: id.into(), frames: 11, ..Proto::default() };
    fs::write(&file, records(&[withheld("one"), withheld("two")])).unwrap();
    fs::write(&metadata, METADATA).unwrap();
    let begin = ["run", text(&file), "--models", "constant-velocity", "--protocol", "realism"];
    let rest = ["--rollouts", "32", "--all-agents", "--keep-rollouts", "--out", text(&run)];
    said(&[&begin[..], &rest].concat(), 0);
    // Nothing can be compared with the log.
    let summary = json_of(&run.join("summary.json"));
    let metrics = &summary["simulators"]["constant-velocity"]["metrics"];
    assert_eq!(metrics["ade"]["mean"], Value::Null);
    assert_eq!(metrics["aa-collision"]["scenarios"], 2);

    let scenarios = ["--scenarios", text(&file)];
    let out = ["--metadata", text(&metadata), "--out", text(&archive)];
    said(&[&["export", "wosac", text(&run)][..], &scenarios, &out].concat(), 0);
    let rollouts: Vec<_> = SubmissionReader::open(&archive).unwrap().map(|r| r.unwrap().rollouts).collect();
    assert_eq!(rollouts.iter().map(|r| r.scenario_id.as_str()).collect::<Vec<_>>(), ["one", "two"]);
    for scenario in &rollouts {
        assert_eq!(scenario.joint_scenes.len(), 32);
        let objects: BTreeSet<i32> =
            scenario.joint_scenes[0].trajectories.iter().map(|t| t.object_id).collect();
        assert_eq!(objects, [7, 8, 9].into());
    }
    let (_, refused) = said(&[&["score", text(&archive), "--wosac"][..], &scenarios].concat(), 2);
    assert!(refused.contains("the log ends at the current frame"), "{refused}");
    // The AV cannot follow a log that it does not have.
    let reactive = ["run", text(&file), "--models", "constant-velocity", "--av", "log"];
    let (_, refused) = said(&reactive, 2);
    assert!(refused.contains("absent"), "{refused}");
}

#[test]
fn runs_on_shipped_scenarios_have_realism_scores() {
    let home = tempfile::tempdir().unwrap();
    let run = home.path().join("run");
    let arguments = ["run", "--models", "log-replay,constant-velocity", "--protocol", "realism"];
    let rest = ["--limit", "6", "--keep-rollouts", "--out", text(&run)];
    said(&[&arguments[..], &rest].concat(), 0);
    let of = |simulator: &str| {
        let found = result(&["score", text(&run), "--wosac", "--partial", "--simulator", simulator]);
        assert_eq!(found["method"], simulator);
        found["configs"]["2025"]["metrics"].clone()
    };
    let (replay, constant) = (of("log-replay"), of("constant-velocity"));
    assert!(replay["average_displacement_error"].as_f64().unwrap() < 1e-4, "{replay}");
    assert!(replay["metametric"].as_f64() > constant["metametric"].as_f64(), "{replay} {constant}");
    let (_, error) = said(&["score", text(&run), "--wosac"], 2);
    assert!(error.contains("log-replay, constant-velocity: choose one"), "{error}");
    let coming = home.path().join("coming");
    let rest = ["--entering", "log", "--limit", "1", "--keep-rollouts", "--out", text(&coming)];
    said(&[&arguments[..], &rest].concat(), 0);
    let (_, error) = said(&["score", text(&coming), "--wosac", "--simulator", "log-replay"], 2);
    assert!(error.contains("with `entering` log") && error.contains("`entering` off"), "{error}");
}

#[test]
fn shares_of_rollouts_are_differences_of_scores() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: String| home.path().join(name);
    let simulated = ["run", "--models", "mix:idm=0.5+stop=0.5", "--protocol", "realism", "--limit", "2"];
    let scored = |rollouts: &str| {
        let (run, out) = (at(format!("run-{rollouts}")), at(format!("scores-{rollouts}")));
        let rest = ["--rollouts", rollouts, "--keep-rollouts", "--out", text(&run)];
        said(&[&simulated[..], &rest].concat(), 0);
        let begin = ["score", text(&run), "--wosac", "--partial", "--out", text(&out)];
        let found = result(&[&begin[..], &["--wosac-config", "2025,2024_challenge_code"]].concat());
        assert_eq!(json_of(&out.join("wosac.json")), found);
        (found["shares"].as_array().unwrap().clone(), lines_of(&out.join("wosac.jsonl")))
    };
    let [(_, two), (shares, three), (single, _)] = ["2", "3", "1"].map(scored);
    assert_eq!((shares.len(), three.len(), two.len()), (4, 4, 4));
    for ((shares, all), others) in shares.iter().zip(&three).zip(&two) {
        assert_eq!((&shares["scenario_id"], &shares["config"]), (&all["scenario_id"], &all["config"]));
        let metrics = all.as_object().unwrap().keys();
        for metric in metrics.filter(|name| *name == "metametric" || name.ends_with("_likelihood")) {
            let found = shares[metric].as_array().unwrap();
            assert_eq!(found.len(), 3, "{metric}");
            // The last of three rollouts is the one that the run of two lacks.
            let difference = all[metric].as_f64().unwrap() - others[metric].as_f64().unwrap();
            assert_eq!(found[2].as_f64(), Some(difference), "{metric}");
        }
        let has_lights = shares.get("traffic_light_violation_likelihood").is_some();
        assert_eq!(has_lights, shares["config"] == "2025");
    }
    let differs = |shares: &Value| shares["metametric"][0] != shares["metametric"][1];
    assert!(shares.iter().any(differs), "{shares:?}");
    // Without the only rollout there is no score.
    assert!(single.iter().all(|shares| shares["metametric"] == json!([null])), "{single:?}");

    let (run, out) = (at("run-3".to_owned()), at("markdown".to_owned()));
    said(&["score", text(&run), "--wosac", "--partial", "--out", text(&out)], 0);
    assert_eq!(json_of(&out.join("wosac.json")).get("shares"), None);
}

#[test]
fn the_realism_study_has_the_metrics_of_kept_rollouts() {
    let home = tempfile::tempdir().unwrap();
    let study = home.path().join("study");
    let models = "idm,constant-velocity";
    let arguments = ["study", "realism", "--models", models, "--limit", "5", "--rollouts", "2"];
    let (table, _) = said(&[&arguments[..], &["--keep-rollouts", "--out", text(&study)]].concat(), 0);
    let (_, realism) = table.split_once("Realism metrics of the Sim Agents challenge 2025").unwrap();
    let value = |name: &str| {
        let line = realism.lines().find(|line| line.starts_with(&format!("| {name} "))).unwrap();
        let cell = line.split('|').nth(2).unwrap();
        cell.split_whitespace().next().unwrap().parse::<f64>().unwrap()
    };
    assert!(value("IDM") > value("Constant Velocity"), "{realism}");
    assert_eq!(fs::read_to_string(study.join("wosac.jsonl")).unwrap().lines().count(), 10);

    // The study keeps its means: tables show them again, and a damaged file is an error.
    assert_eq!(fs::read_to_string(study.join("study.md")).unwrap(), table);
    assert!(said(&["report", text(&study)], 0).0.contains("| Constant Velocity "));
    let means = study.join("wosac.json");
    let summaries = json_of(&means);
    let mean = &summaries[0]["aggregates"]["realism_meta_metric"]["mean"];
    assert!((mean.as_f64().unwrap() - value(summaries[0]["title"].as_str().unwrap())).abs() < 1e-4);
    fs::write(&means, "[{}]").unwrap();
    assert!(said(&["report", text(&study)], 2).1.contains("wosac.json"));
}

#[test]
fn options_of_the_realism_metrics_go_with_them() {
    for option in ["--wosac-config 2024", "--simulator idm", "--jobs 1"] {
        let error = refused(&words(&format!("score some.parquet {option}")));
        assert!(error.contains("goes with --wosac only"), "{error}");
    }
    let error = refused(&words("score some.binproto --wosac --wosac-config 2022"));
    assert!(error.contains("expected one of 2025, 2024, 2023, 2024_challenge_code"), "{error}");
}

#[test]
fn logs_are_found_in_any_order() {
    let Some(recordings) = recordings() else { return };
    let file = |i: usize| recordings.join(format!("val/womd-val-0000{i}-of-00002.tfrecord.zst"));
    let files = || LogFiles::new(vec![file(1), file(0)]);
    let ids = files().ids();
    let chosen: Vec<&String> = ids.iter().rev().step_by(17).collect();
    assert!(chosen.len() > 3, "{ids:?}");
    // With all places known, and with none.
    let mut known = files();
    known.ids();
    for mut logs in [known, files()] {
        for id in &chosen {
            assert_eq!(logs.get(id).unwrap().unwrap().scenario_id, **id);
        }
        assert!(logs.get("none").unwrap().is_none());
        assert!(logs.take_errors().is_empty());
    }
    let mut missing = LogFiles::new(vec![recordings.join("none.tfrecord")]);
    assert!(missing.get("none").unwrap().is_none());
    assert!(missing.take_errors()[0].to_string().contains("none.tfrecord"));
}
