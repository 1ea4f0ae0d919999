//! Rollouts of other programs are refused if their numbers would look better than they are.

use std::fs;
use std::path::{Path, PathBuf};

use reactsim::evaluation::{EvaluationError, Pose, RolloutCheck, Scoring, Summary};
use reactsim::formats::rollouts::{RolloutRecord, Writer};
use reactsim::formats::{self, Input};
use reactsim::geometry::Vec2;
use reactsim::metrics::Options;
use serde_json::Value;

use crate::program::{json_of, lines_of, refused, said, text, words};
use crate::small_scenarios::{deviating, write};

struct Fixture {
    home: tempfile::TempDir,
    inputs: Vec<Input>,
    records: Vec<RolloutRecord>,
}

impl Fixture {
    fn new() -> Self {
        Self::at(Vec2::zeros())
    }

    /// Creates scenarios with this origin in the world frame, and rollouts of them.
    fn at(origin: Vec2) -> Self {
        let home = tempfile::tempdir().unwrap();
        let (input, out) = (home.path().join("scenarios.parquet"), home.path().join("run"));
        let moved = |i: usize| {
            let mut scenario = deviating(i, true);
            scenario.origin = origin;
            scenario
        };
        write(&input, (0..3).map(moved));
        said(&["run", text(&input), "--models", "stop", "--out", text(&out), "--keep-rollouts"], 0);
        let records = read_rollouts(&out.join("rollouts.parquet"));
        Self { inputs: formats::find_inputs(&input).unwrap(), home, records }
    }

    fn written(&self, records: &[RolloutRecord]) -> PathBuf {
        let path = self.home.path().join("changed.parquet");
        fs::remove_file(&path).ok();
        let mut writer = Writer::create(&path).unwrap();
        records.iter().for_each(|record| writer.write(record).unwrap());
        writer.finish().unwrap();
        path
    }

    fn score(&self, records: &[RolloutRecord], allowed: &[RolloutCheck]) -> Result<Summary, EvaluationError> {
        let path = self.written(records);
        Scoring::new(&[path], &self.inputs, Options::default(), Pose::Centre)?.run(allowed, None, &())
    }

    fn refusal(&self, change: impl Fn(&mut Vec<RolloutRecord>)) -> (String, Summary) {
        let mut records = self.records.clone();
        change(&mut records);
        let text = self.score(&records, &[]).unwrap_err().to_string();
        (text, self.score(&records, &RolloutCheck::ALL).unwrap())
    }
}

#[test]
fn rollouts_as_the_program_writes_them_pass() {
    let fixture = Fixture::new();
    let summary = fixture.score(&fixture.records, &[]).unwrap();
    assert_eq!((summary.provenance.scenarios, summary.provenance.allowed.len()), (3, 0));
}

#[test]
fn every_difference_is_named_and_can_be_allowed() {
    let fixture = Fixture::new();
    let agents = fixture.records[1].agent_ids.clone();
    let id = fixture.records[1].scenario_id.clone();
    let slot = |record: &RolloutRecord, id: &str| record.agent_ids.iter().position(|a| a == id).unwrap();
    let av = {
        let scenario = fixture.inputs[0].open().unwrap().nth(1).unwrap().unwrap();
        scenario.start.agents[0].id.clone()
    };
    let other = agents.iter().find(|a| **a != av).unwrap();

    let (text, summary) = fixture.refusal(|records| {
        let slot = slot(&records[1], &av);
        records[1].tracks[slot][40].as_mut().unwrap().y += 0.5;
    });
    let place = format!("scenario `{id}`, `stop`, rollout 0");
    assert!(
        text.contains(&format!(
            "1 rollout, the first: {place}: the AV is 0.50 m from the prescribed trajectory at step 41 \
             (`allow` other-av)"
        )),
        "{text}"
    );
    assert_eq!(summary.provenance.allowed, [("other-av".to_owned(), 1)].into());

    // An agent that vanishes collides with nothing.
    let (text, _) = fixture.refusal(|records| {
        let slot = slot(&records[1], other);
        records[1].tracks[slot][30..].fill(None);
    });
    assert!(
        text.contains(&format!("{place}: agent `{other}` is absent at step 31, but not in the log")),
        "{text}"
    );
    let (text, summary) = fixture.refusal(|records| {
        for record in records {
            let av = record.agent_ids.iter().position(|id| *id == av).unwrap();
            record.agent_ids = vec![record.agent_ids[av].clone()];
            record.tracks = vec![record.tracks[av].clone()];
        }
    });
    assert!(text.contains("3 rollouts") && text.contains("(`allow` missing-agents)"), "{text}");
    assert_eq!(summary.provenance.allowed["missing-agents"], 3);

    let (text, _) = fixture.refusal(|records| {
        let slot = slot(&records[1], other);
        records[1].tracks[slot].iter_mut().flatten().for_each(|state| state.x += 3.0);
    });
    let part = format!("{place}: agent `{other}` is 3.");
    assert!(text.contains(&part) && text.contains("(`allow` jumps)"), "{text}");

    let (text, _) = fixture.refusal(|records| _ = records.pop());
    assert!(
        text.contains("1 scenario, the first: scenario `") && text.contains("(`allow` partial)"),
        "{text}"
    );
}

#[test]
fn the_wrong_frame_of_coordinates_is_recognised() {
    let fixture = Fixture::at(Vec2::new(512.0, -256.0));
    // Coordinates in the scenario frame, stated as world coordinates.
    let (text, _) = fixture.refusal(|records| {
        records.iter_mut().for_each(|record| record.origin = Some(Vec2::zeros()));
    });
    assert!(text.contains("the coordinates are in the other frame"), "{text}");
}

#[test]
fn allowances_are_marked_below_the_table() {
    let fixture = Fixture::new();
    let path = fixture.written(&fixture.records[..2]);
    let begin = ["score", text(&path), "--scenarios", text(&fixture.inputs[0].path)];
    refused(&begin);
    let (table, _) = said(&[&begin[..], &["--allow", "partial"]].concat(), 0);
    assert!(table.contains("1 exception allowed as partial"), "{table}");
    let unknown = refused(&[&begin[..], &["--allow", "everything"]].concat());
    assert!(unknown.contains("expected one of other-av, jumps, coordinates,"), "{unknown}");
}

#[test]
fn scored_rollouts_become_a_run_folder() {
    let fixture = Fixture::new();
    let path = |name: &str| fixture.home.path().join(name).to_str().unwrap().to_owned();
    let (input, run, scored) = (path("scenarios.parquet"), path("run"), path("scored"));
    let rollouts = format!("{run}/rollouts.parquet");
    let score = ["score", &rollouts, "--scenarios", &input, "--out", &scored];
    said(&score, 0);
    // The same as the folder of the run, except that the rollouts are the first input.
    for name in ["rows.jsonl", "events.jsonl"] {
        let read = |folder: &str| fs::read_to_string(Path::new(folder).join(name)).unwrap();
        assert_eq!(read(&scored).replace("\"input\":1,", "\"input\":0,"), read(&run), "{name}");
    }
    assert_eq!(read_rollouts(&Path::new(&scored).join("rollouts.parquet")), fixture.records);
    assert!(!Path::new(&scored).join("parts").exists());

    // Every command accepts the folder.
    let (page, svg, id) = (path("page.html"), path("x.svg"), &fixture.records[1].scenario_id);
    for line in [
        format!("report {scored}"),
        format!("report {scored} --scenarios {input} --format html --out {page}"),
        format!("inspect {input} --id {id} --rollout {scored} --simulator stop --svg {svg}"),
        format!("compare {scored} {run}"),
    ] {
        said(&words(&line), 0);
    }
    let full = refused(&score);
    assert!(full.contains("scored") && full.contains("not empty"), "{full}");
}

#[test]
fn rollouts_are_scored_against_logs_as_the_run_read_them() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name);
    let (logs, run, scored) = (path("logs.parquet"), path("run"), path("scored"));
    said(&["generate", "--preset=train", "--count=2", "--future=12s", "--out", text(&logs)], 0);
    let (length, rollouts) = (["--history=5", "--future=10s"], run.join("rollouts.parquet"));
    let begin = ["run", text(&logs), "--av=brake:2", "--models=stop", "--keep-rollouts", "--out", text(&run)];
    said(&[&begin[..], &length].concat(), 0);
    let score = ["score", text(&rollouts), "--scenarios", text(&logs), "--allow=other-av"];
    said(&[&score[..], &length, &["--out", text(&scored)]].concat(), 0);
    let lengths = |folder: &Path| -> Vec<Value> {
        lines_of(&folder.join("rows.jsonl")).into_iter().map(|row: Value| row["length"].clone()).collect()
    };
    assert_eq!(lengths(&scored), lengths(&run));
    assert_eq!(json_of(&scored.join("provenance.json"))["inputs"][1]["future"], 100);
    // The page reads the scenarios as well.
    let page = path("page.html");
    let report = ["report", text(&scored), "--format=html", "--out", text(&page), "--scenarios", text(&logs)];
    let (_, told) = said(&report, 0);
    assert!(!told.contains("logs.parquet"), "{told}");
    let wrong = refused(&["score", text(&logs), "--add-metrics=a.json", "--history=5"]);
    assert!(wrong.contains("leave --history out"), "{wrong}");
}

#[test]
fn refused_rollouts_leave_no_run_folder() {
    let fixture = Fixture::new();
    let (path, out) = (fixture.written(&fixture.records[..2]), fixture.home.path().join("scored"));
    let score = ["score", text(&path), "--scenarios", text(&fixture.inputs[0].path), "--out", text(&out)];
    refused(&score);
    assert_eq!(fs::read_dir(&out).unwrap().count(), 0);
    // The same folder is accepted with an allowance.
    said(&[&score[..], &["--allow", "partial"]].concat(), 0);
    assert_eq!(fs::read_to_string(out.join("rows.jsonl")).unwrap().lines().count(), 4);
}

#[test]
fn every_scenario_has_the_same_number_of_rollouts() {
    let fixture = Fixture::new();
    let numbered = |rollout: u32| RolloutRecord { rollout, ..fixture.records[1].clone() };
    for (added, text) in [
        (numbered(1), "1 rollouts, where others have 2; give the same number for all"),
        (numbered(2), "rollout 1 is missing (there is 2); count from 0"),
        (numbered(0), "rollout 0 occurs twice"),
    ] {
        let summary = fixture.score(&[&fixture.records[..], &[added]].concat(), &[]).unwrap();
        let failures = summary.provenance.failures;
        assert!(failures.iter().any(|failure| failure.error.contains(text)), "{failures:?}");
    }
}

#[test]
fn files_for_others_hold_no_future_and_their_rollouts_can_be_scored() {
    let fixture = Fixture::new();
    let input = fixture.inputs[0].path.to_str().unwrap();
    let path = |name: &str| fixture.home.path().join(name).to_str().unwrap().to_owned();
    let (histories, avs) = (path("histories.parquet"), path("avs.json"));
    said(&["convert", input, "--history-only", "--out", &histories], 0);
    said(&["export", "av", input, "--out", &avs], 0);
    let read = |file: &str| -> Vec<_> {
        let inputs = formats::find_inputs(Path::new(file)).unwrap();
        inputs[0].open().unwrap().map(Result::unwrap).collect()
    };
    for (history, whole) in read(&histories).iter().zip(read(input)) {
        assert_eq!(history.start.history, whole.start.history);
        assert_eq!((&history.start.map, history.origin), (&whole.start.map, whole.origin));
        assert!(history.log_future.tracks.iter().flatten().all(Option::is_none));
        assert!(history.log_future.lights.iter().flatten().all(Option::is_none));
        assert!(history.unselected.iter().all(|a| a.track[11..].iter().all(Option::is_none)));
        assert!(history.deviation.is_none() && history.objects_of_interest.is_empty());
    }
    // Both files together simulate as the whole scenarios, and the rollouts pass every check.
    let out = path("offline");
    let run = ["run", &histories, "--deviations", &avs, "--models", "stop", "--out", &out, "--keep-rollouts"];
    said(&run, 0);
    let rollouts: Vec<RolloutRecord> = read_rollouts(&Path::new(&out).join("rollouts.parquet"));
    assert_eq!(rollouts, fixture.records);
    said(&["score", &format!("{out}/rollouts.parquet"), "--scenarios", input], 0);
}

fn read_rollouts(path: &Path) -> Vec<RolloutRecord> {
    formats::rollouts::read(path).unwrap().map(Result::unwrap).collect()
}
