use std::fs;

use super::*;

fn line(
    scenario: &str,
    decision: Decision,
    candidate: Option<u32>,
    reviewer: &str,
    second: u32,
) -> ReviewLine {
    ReviewLine {
        scenario_id: scenario.into(),
        scenario_digest: "d".into(),
        candidate,
        candidate_digest: None,
        decision,
        reviewer: reviewer.into(),
        at: at(second),
        note: None,
        undo: false,
    }
}

fn at(second: u32) -> String {
    format!("2026-03-01T12:00:{second:02}.000Z")
}

fn verdict(journal: &Journal, scenario: &str) -> Option<(Decision, Option<u32>, String)> {
    let opinions = journal.opinions(scenario);
    assert_eq!(journal.decisions().get(scenario).cloned().unwrap_or_default(), opinions);
    opinions.verdict("d").map(|l| (l.decision, l.candidate, l.reviewer.clone()))
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = Journal::path_for(&folder.path().join("set.parquet"));
    assert!(path.ends_with("set.parquet.reviews.jsonl"));
    (folder, path)
}

#[test]
fn the_last_line_holds_and_survives() {
    let (_folder, path) = folder();
    let mut journal = Journal::open(&path).unwrap();
    journal.append(line("a", Decision::Flag, Some(1), "anna", 1)).unwrap();
    journal.append(line("a", Decision::Pick, Some(3), "anna", 2)).unwrap();
    journal.append(line("b", Decision::Reject, None, "anna", 3)).unwrap();
    drop(journal);
    let journal = Journal::open(&path).unwrap();
    assert!(journal.warnings().is_empty());
    assert_eq!(verdict(&journal, "a"), Some((Decision::Pick, Some(3), "anna".into())));
    assert_eq!(verdict(&journal, "b"), Some((Decision::Reject, None, "anna".into())));
    assert_eq!(verdict(&journal, "c"), None);
    assert_eq!(journal.opinions("a").verdict("another digest"), None);
    assert_eq!(journal.last_reviewer(), Some("anna"));
    let text = fs::read_to_string(&path).unwrap();
    let first = r#"{"scenario_id":"a","scenario_digest":"d","candidate":1,"decision":"flag","reviewer":"anna","at":"2026-03-01T12:00:01.000Z"}"#;
    assert_eq!(text.lines().next(), Some(first));
}

#[test]
fn a_torn_last_line_is_dropped_with_a_warning() {
    let (_folder, path) = folder();
    let mut journal = Journal::open(&path).unwrap();
    journal.append(line("a", Decision::Pick, Some(3), "anna", 1)).unwrap();
    journal.append(line("b", Decision::Pick, Some(4), "anna", 2)).unwrap();
    drop(journal);
    let whole = fs::read(&path).unwrap();
    let first = whole.iter().position(|&b| b == b'\n').unwrap() + 1;
    for cut in first..=whole.len() {
        fs::write(&path, &whole[..cut]).unwrap();
        let mut journal = Journal::open(&path).unwrap();
        let kept = cut + 1 >= whole.len();
        assert_eq!(journal.warnings().len(), usize::from(cut > first && !kept), "cut at {cut}");
        assert_eq!(verdict(&journal, "a"), Some((Decision::Pick, Some(3), "anna".into())));
        assert_eq!(verdict(&journal, "b").is_some(), kept, "cut at {cut}");
        journal.append(line("c", Decision::Flag, None, "anna", 3)).unwrap();
        drop(journal);
        let journal = Journal::open(&path).unwrap();
        assert!(journal.warnings().is_empty());
        assert!(verdict(&journal, "c").is_some());
        assert_eq!(verdict(&journal, "b").is_some(), kept);
    }
}

#[test]
fn a_corrupt_line_in_the_middle_is_an_error_that_names_it() {
    let (_folder, path) = folder();
    let mut journal = Journal::open(&path).unwrap();
    for i in 0..3 {
        journal.append(line("a", Decision::Pick, Some(i), "anna", i)).unwrap();
    }
    drop(journal);
    let text = fs::read_to_string(&path).unwrap();
    for (bad, what) in [
        ("{\"scenario_id\":", "not a decision"),
        ("{}", "scenario_id"),
        (
            r#"{"scenario_id":"a","scenario_digest":"d","candidate":null,"decision":"pick","reviewer":"x","at":"2026-03-01T12:00:01.000Z"}"#,
            "`candidate`",
        ),
        (
            r#"{"scenario_id":"a","scenario_digest":"d","candidate":1,"decision":"pick","reviewer":"x","at":"noon"}"#,
            "`at`",
        ),
    ] {
        let mut lines: Vec<&str> = text.lines().collect();
        lines[1] = bad;
        let damaged = lines.join("\n") + "\n";
        fs::write(&path, &damaged).unwrap();
        for error in [Journal::open(&path).unwrap_err(), Journal::read_all(&[&path]).unwrap_err()] {
            let error = error.to_string();
            assert!(error.contains(", line 2: ") && error.contains(what), "{error}");
        }
        // Nothing was cut off or changed.
        assert_eq!(fs::read_to_string(&path).unwrap(), damaged);
    }
}

#[test]
fn undo_goes_back_step_by_step_also_after_reopening() {
    let (_folder, path) = folder();
    let mut journal = Journal::open(&path).unwrap();
    assert_eq!(journal.undo("anna", at(0)).unwrap(), None);
    journal.append(line("a", Decision::Flag, Some(1), "anna", 1)).unwrap();
    journal.append(line("a", Decision::Pick, Some(3), "anna", 2)).unwrap();
    journal.append(line("b", Decision::Reject, None, "anna", 3)).unwrap();
    journal.append(line("b", Decision::Pick, Some(2), "ben", 4)).unwrap();
    let undone = journal.undo("anna", at(5)).unwrap().unwrap();
    assert_eq!((undone.scenario_id.as_str(), undone.decision), ("b", Decision::Clear));
    assert_eq!(verdict(&journal, "b"), Some((Decision::Pick, Some(2), "ben".into())));
    drop(journal);
    let mut journal = Journal::open(&path).unwrap();
    let undone = journal.undo("anna", at(6)).unwrap().unwrap();
    assert_eq!(
        (undone.scenario_id.as_str(), undone.decision, undone.candidate),
        ("a", Decision::Flag, Some(1))
    );
    assert_eq!(verdict(&journal, "a"), Some((Decision::Flag, Some(1), "anna".into())));
    assert_eq!(journal.undo("anna", at(7)).unwrap().unwrap().decision, Decision::Clear);
    assert_eq!(verdict(&journal, "a"), None);
    assert_eq!(journal.undo("anna", at(8)).unwrap(), None);
    assert!(verdict(&journal, "b").is_some());
}

#[test]
fn two_reviewers_merge_and_may_disagree() {
    let (_folder, path) = folder();
    let other = path.with_extension("other.jsonl");
    let mut theirs = Journal::open(&other).unwrap();
    theirs.append(line("a", Decision::Pick, Some(1), "ben", 5)).unwrap();
    theirs.append(line("b", Decision::Pick, Some(1), "ben", 1)).unwrap();
    theirs.append(line("c", Decision::Pick, Some(1), "ben", 1)).unwrap();
    theirs.append(line("d", Decision::Pick, Some(9), "anna", 9)).unwrap();
    let mut journal = Journal::open(&path).unwrap();
    journal.append(line("a", Decision::Reject, None, "anna", 2)).unwrap();
    journal.append(line("b", Decision::Reject, None, "anna", 2)).unwrap();
    journal.append(line("c", Decision::Pick, Some(1), "anna", 2)).unwrap();
    journal.append(line("d", Decision::Pick, Some(1), "anna", 2)).unwrap();
    // The other journal is still open for writing: it is only read.
    journal.merge(&[&other]).unwrap();
    assert_eq!(verdict(&journal, "a"), Some((Decision::Pick, Some(1), "ben".into())));
    assert_eq!(verdict(&journal, "b"), Some((Decision::Reject, None, "anna".into())));
    assert_eq!(verdict(&journal, "c"), Some((Decision::Pick, Some(1), "anna".into())));
    assert_eq!(verdict(&journal, "d"), Some((Decision::Pick, Some(9), "anna".into())));
    let disagree: Vec<bool> =
        ["a", "b", "c", "d"].iter().map(|s| journal.opinions(s).disagree("d")).collect();
    assert_eq!(disagree, [true, true, false, false]);
    let (both, warnings) = Journal::read_all(&[&path, &other]).unwrap();
    assert_eq!(both, journal.decisions());
    assert!(warnings.is_empty());
    // Of two there is a majority only if they agree.
    let majority =
        |journal: &Journal, id: &str| journal.opinions(id).majority("d").map(|l| (l.decision, l.candidate));
    assert_eq!(majority(&journal, "a"), None);
    assert_eq!(majority(&journal, "c"), Some((Decision::Pick, Some(1))));
    journal.append(line("a", Decision::Reject, None, "cleo", 3)).unwrap();
    assert_eq!(majority(&journal, "a"), Some((Decision::Reject, None)));
    // A flag is never a disagreement.
    journal.append(line("b", Decision::Flag, None, "anna", 6)).unwrap();
    assert!(!journal.opinions("b").disagree("d"));
}

#[test]
fn a_second_writer_is_refused() {
    let (_folder, path) = folder();
    let first = Journal::open(&path).unwrap();
    let error = Journal::open(&path).unwrap_err();
    assert!(matches!(error, ReviewError::Locked { .. }), "{error}");
    drop(first);
    Journal::open(&path).unwrap();
}

#[test]
fn names_of_reviewers_are_one_printable_line() {
    assert!(is_reviewer("Åsa Öberg") && is_reviewer(&"a".repeat(100)));
    for name in ["", "  ", "a\nb", "\u{1b}[31mred", "a\u{7}", "\u{9b}2J", &"a".repeat(101)] {
        assert!(!is_reviewer(name), "{name:?}");
    }
}
