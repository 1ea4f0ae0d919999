//! Decisions applied to a file, in a new file.

use reactsim::curation::apply::{ApplyReport, RefusedPick, apply};
use reactsim::curation::decisions::{Decisions, ReviewLine};
use reactsim::curation::{Application, Decision, InputFile, ScenarioRecord, candidate_digest, store};

use super::hand::{scenario, write};

fn decided(id: &str, decision: Decision, candidate: Option<u32>) -> ReviewLine {
    ReviewLine {
        scenario_id: id.into(),
        scenario_digest: scenario(id, 0).scenario_digest,
        candidate,
        candidate_digest: None,
        decision,
        reviewer: "ben".into(),
        at: "2026-02-02T08:00:00.000Z".into(),
        note: None,
        undo: false,
    }
}

fn application(allow_rejected: bool) -> Application {
    Application {
        version: "9.9.9".into(),
        commit: "abc".into(),
        file: InputFile { name: "a.parquet".into(), digest: "22".into() },
        reviews: vec![InputFile { name: "a.parquet.decisions.jsonl".into(), digest: "11".into() }],
        allow_rejected,
    }
}

/// Applies decisions to scenarios of five candidates, of which the second is chosen.
fn applied(allow_rejected: bool, lines: &[ReviewLine]) -> (ApplyReport, Vec<ScenarioRecord>, store::Reader) {
    let folder = tempfile::tempdir().unwrap();
    let (from, out) = (folder.path().join("a.parquet"), folder.path().join("b.parquet"));
    write(&from, &["a", "b", "c"].map(|id| scenario(id, 5)));
    let mut decisions = Decisions::default();
    lines.iter().for_each(|line| decisions.add(line.clone()));
    let done = apply(&from, &out, application(allow_rejected), &decisions).unwrap();
    let records = store::read(&out).unwrap().map(|r| r.unwrap()).collect();
    (done, records, store::read(&out).unwrap())
}

/// Returns the number of the chosen candidate, and the numbers of those with ben's mark.
fn state(record: &ScenarioRecord) -> (Option<u32>, Vec<u32>) {
    let marked = record.candidates.iter().filter(|c| c.review.as_ref().is_some_and(|r| r.reviewer == "ben"));
    (record.chosen().map(|c| c.candidate.number), marked.map(|c| c.candidate.number).collect())
}

#[test]
fn picks_rejections_and_flags() {
    let (done, records, file) = applied(
        false,
        &[
            decided("a", Decision::Pick, Some(3)),
            decided("b", Decision::Reject, Some(1)),
            decided("c", Decision::Flag, Some(1)),
            decided("unknown", Decision::Pick, Some(0)),
        ],
    );
    assert_eq!(
        records.iter().map(state).collect::<Vec<_>>(),
        [(Some(3), vec![3]), (None, vec![1]), (Some(1), vec![1]),]
    );
    assert_eq!(records[0].candidates[1].review, None, "the mark of an earlier decision gives way");
    assert_eq!(
        done,
        ApplyReport {
            picked: 1,
            dropped: 1,
            marked: 1,
            chosen: 2,
            scenarios: 3,
            unknown: 1,
            ..ApplyReport::default()
        }
    );
    assert_eq!(file.provenance().funnel.chosen, 2);
    assert_eq!(file.provenance().version, "0.1.0", "of the curation itself");
    assert_eq!(file.provenance().applied, [application(false)]);
}

#[test]
fn a_rejected_candidate_that_is_not_chosen_changes_nothing_else() {
    let (done, records, _) = applied(
        true,
        &[
            decided("a", Decision::Reject, Some(0)),
            decided("b", Decision::Reject, None),
            decided("c", Decision::Pick, Some(2)),
        ],
    );
    assert_eq!(state(&records[0]), (Some(1), vec![0]));
    assert_eq!(state(&records[1]), (None, vec![0, 1, 2, 3, 4]), "none of the scenario belongs into the set");
    assert_eq!(state(&records[2]), (Some(2), vec![2]));
    assert_eq!((done.picked, done.picked_rejected, done.dropped, done.marked), (1, 1, 1, 1));
}

#[test]
fn what_was_decided_about_something_else_is_not_applied() {
    let digest = candidate_digest(&scenario("b", 5).candidates[2].candidate);
    let elsewhere = ReviewLine { candidate_digest: Some(digest), ..decided("b", Decision::Reject, Some(1)) };
    let changed = ReviewLine { scenario_digest: "0".into(), ..decided("d", Decision::Reject, None) };
    let (done, records, _) = applied(
        true,
        &[decided("a", Decision::Pick, Some(9)), elsewhere, decided("c", Decision::Pick, None), changed],
    );
    assert_eq!(done.unknown, 1);
    assert_eq!(done.unfit, ["a", "b", "c"]);
    for record in &records {
        assert_eq!(state(record), (Some(1), vec![]));
        assert_eq!(record.candidates[1].review.as_ref().unwrap().reviewer, "ana", "earlier marks stay");
    }
}

#[test]
fn what_a_filter_rejected_is_not_picked_unless_that_is_wanted() {
    let picks = [
        decided("a", Decision::Pick, Some(2)),
        decided("b", Decision::Pick, Some(3)),
        decided("c", Decision::Clear, None),
    ];
    let (done, records, _) = applied(false, &picks);
    let refused = RefusedPick { scenario_id: "a".into(), candidate: 2, rejected_by: "pressure".into() };
    assert_eq!(
        done,
        ApplyReport { picked: 1, refused: vec![refused], chosen: 3, scenarios: 3, ..ApplyReport::default() }
    );
    assert_eq!(state(&records[0]), (Some(1), vec![]), "what was chosen stays, and its mark");
    assert_eq!(records[0].candidates[1].review.as_ref().unwrap().reviewer, "ana");
    assert_eq!(state(&records[1]), (Some(3), vec![3]));
    assert_eq!(state(&records[2]), (Some(1), vec![]));
    let (done, records, file) = applied(true, &picks);
    assert_eq!(
        done,
        ApplyReport { picked: 2, picked_rejected: 1, chosen: 3, scenarios: 3, ..ApplyReport::default() }
    );
    assert_eq!(state(&records[0]), (Some(2), vec![2]));
    assert!(file.provenance().applied[0].allow_rejected);
}

#[test]
fn every_application_leaves_its_trace() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write(&path("a.parquet"), &[scenario("a", 5)]);
    apply(&path("a.parquet"), &path("b.parquet"), application(false), &Decisions::default()).unwrap();
    apply(&path("b.parquet"), &path("c.parquet"), application(true), &Decisions::default()).unwrap();
    let file = store::read(path("c.parquet")).unwrap();
    assert_eq!(file.provenance().applied, [application(false), application(true)]);
}
