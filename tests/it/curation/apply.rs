//! Decisions folded into a new file.

use std::collections::BTreeMap;

use reactsim::curation::apply::{Applied, Decided, apply};
use reactsim::curation::{InputFile, ReviewMark, ScenarioRecord, store};

use super::hand::{scenario, write};

fn decided(decision: &str, candidate: Option<u32>) -> Decided {
    let mark = ReviewMark {
        reviewer: "ben".into(),
        at: "2026-02-02T08:00:00.000Z".into(),
        decision: decision.into(),
    };
    Decided { mark, candidate, fits: true }
}

/// Applies decisions to scenarios of five candidates, of which the second is chosen.
fn applied(decisions: &[(&str, Decided)]) -> (Applied, Vec<ScenarioRecord>, store::Reader) {
    let folder = tempfile::tempdir().unwrap();
    let (from, out) = (folder.path().join("a.parquet"), folder.path().join("b.parquet"));
    write(&from, &["a", "b", "c"].map(|id| scenario(id, 5)));
    let decisions: BTreeMap<&str, Decided> = decisions.iter().cloned().collect();
    let journal = InputFile { name: "a.parquet.reviews.jsonl".into(), digest: "11".into() };
    let done = apply(&from, &out, &[journal], |r| decisions.get(r.scenario_id.as_str()).cloned()).unwrap();
    let records = store::read(&out).unwrap().map(|r| r.unwrap()).collect();
    (done, records, store::read(&out).unwrap())
}

/// Which candidate is chosen, and which carry ben's mark.
fn state(record: &ScenarioRecord) -> (Option<u32>, Vec<u32>) {
    let marked = record.candidates.iter().filter(|c| c.review.as_ref().is_some_and(|r| r.reviewer == "ben"));
    (record.chosen().map(|c| c.candidate.number), marked.map(|c| c.candidate.number).collect())
}

#[test]
fn picks_rejections_and_flags() {
    let (done, records, file) = applied(&[
        ("a", decided("pick", Some(3))),
        ("b", decided("reject", Some(1))),
        ("c", decided("flag", Some(1))),
        ("unknown", decided("pick", Some(0))),
    ]);
    assert_eq!(
        records.iter().map(state).collect::<Vec<_>>(),
        [(Some(3), vec![3]), (None, vec![1]), (Some(1), vec![1]),]
    );
    assert_eq!(records[0].candidates[1].review, None, "the mark of an earlier decision gives way");
    assert_eq!(done, Applied { picked: 1, dropped: 1, marked: 1, chosen: 2, ..Applied::default() });
    assert_eq!(file.provenance().funnel.chosen, 2);
    assert_eq!(file.provenance().reviews.len(), 1);
    assert!(file.provenance().reviews[0].name.ends_with(".reviews.jsonl"));
}

#[test]
fn a_rejected_candidate_that_is_not_chosen_changes_nothing_else() {
    let (done, records, _) = applied(&[
        ("a", decided("reject", Some(0))),
        ("b", decided("reject", None)),
        ("c", decided("pick", Some(2))),
    ]);
    assert_eq!(state(&records[0]), (Some(1), vec![0]));
    assert_eq!(state(&records[1]), (None, vec![0, 1, 2, 3, 4]), "none of the scenario belongs into the set");
    assert_eq!(state(&records[2]), (Some(2), vec![2]));
    assert_eq!((done.picked, done.picked_rejected, done.dropped, done.marked), (1, 1, 1, 1));
}

#[test]
fn what_was_decided_about_something_else_is_not_applied() {
    let elsewhere = Decided { fits: false, ..decided("reject", Some(1)) };
    let (done, records, _) =
        applied(&[("a", decided("pick", Some(9))), ("b", elsewhere), ("c", decided("pick", None))]);
    assert_eq!(done.unfit, ["a", "b", "c"]);
    for record in &records {
        assert_eq!(state(record), (Some(1), vec![]));
        assert_eq!(record.candidates[1].review.as_ref().unwrap().reviewer, "ana", "earlier marks stay");
    }
}
