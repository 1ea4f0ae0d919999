//! Leaderboards: entries in one table, with the extent of their verification; entries that are not comparable
//! with the others are refused.

use std::fs;
use std::path::Path;

use reactsim::evaluation::read_summary;
use reactsim::metrics::Score;
use serde_json::json;

use crate::program::{copy, said, text};
use crate::reference::{edit_both, edit_rows, run};

#[test]
fn entries_stand_in_one_table_with_their_status() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let reference = at("reference");
    said(&["reference", "make", text(run()), "--name", "reference", "--out", text(&reference)], 0);
    let verified = copy(run(), &at("theirs"));
    let unverified = copy(run(), &at("others"));
    fs::remove_file(unverified.join("rollouts.parquet")).unwrap();
    let page = at("page.html");
    let folders = [text(&reference), text(&verified), text(&unverified)];
    let board = |more: &[&str]| said(&[&["leaderboard"], &folders[..], more].concat(), 0).0;
    let table = board(&["--html", text(&page)]);
    let cells = |line: &str| line.split('|').map(|c| c.trim().to_owned()).collect::<Vec<_>>();
    let rows = |table: &str| -> Vec<Vec<String>> {
        table.lines().filter(|l| l.starts_with("| ")).skip(1).map(cells).collect()
    };
    let lines = rows(&table);
    // All have the same simulators with the same numbers, which the first entry shows.
    assert!(lines.len() == 3 && lines.iter().all(|l| l[2] == "reference" && l[4] == "reference"), "{table}");
    assert!(table.contains("6 repetitions of another entry left out."), "{table}");
    let alone = |entry: &Path| rows(&said(&["leaderboard", text(entry)], 0).0)[0][4].clone();
    assert_eq!([&verified, &unverified].map(|entry| alone(entry)), ["verified", "unverified"]);
    // Oracles come last, without a rank.
    let ranks: Vec<&str> = lines.iter().map(|l| l[1].as_str()).collect();
    assert_eq!((ranks[0], ranks[2], lines[2][3].as_str()), ("1", "–", "Log Replay †"), "{table}");
    assert!(
        table.contains("\nRank 1: no other method is at least as good in A-AV Coll., ADE, Progress"),
        "{table}"
    );
    assert!(table.contains("reactsim-bench v") && table.contains("reactive protocol"), "{table}");

    let csv = board(&["--format", "csv"]);
    let head =
        "rank,entry,simulator,method,oracle,status,aav-collision,aav-collision-low,aav-collision-high,";
    assert!(csv.starts_with(head) && csv.lines().count() == 4, "{csv}");
    assert!(csv.contains(",reference,stop,Stop,false,reference,"), "{csv}");
    let json: serde_json::Value = serde_json::from_str(&board(&["--format", "json"])).unwrap();
    let line = &json["lines"][0];
    let best = read_summary(run()).unwrap().simulators[line["simulator"].as_str().unwrap()].clone();
    assert_eq!(line["metrics"]["aav-collision"]["mean"].as_f64(), best.metrics["aav-collision"].mean);
    assert_eq!(line["rank"], 1);
    assert_eq!(json["benchmark"]["name"], "reactsim-bench");

    let html = fs::read_to_string(&page).unwrap();
    assert!(
        html.contains("default-src 'none'; script-src 'sha256-") && !html.contains("http://"),
        "no network"
    );
    assert_eq!(html.matches("<tr>").count(), 4);
    assert_eq!(board(&["--html", text(&page)]), table);
    assert_eq!(fs::read_to_string(&page).unwrap(), html, "the same entries give the same page");
}

#[test]
fn entries_that_are_not_alike_are_refused() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let drop_rollouts = |entry: &Path| fs::remove_file(entry.join("rollouts.parquet")).unwrap();
    // Entries without rollouts are not scored again, which takes seconds.
    let first = copy(run(), &at("run"));
    drop_rollouts(&first);
    let mut n = 0;
    let mut refused_with_rollouts = |change: &dyn Fn(&Path)| {
        n += 1;
        let entry = copy(run(), &at(&format!("entry-{n}")));
        change(&entry);
        said(&["leaderboard", text(&first), text(&entry)], 2).1
    };
    let mut refused = |change: &dyn Fn(&Path)| {
        refused_with_rollouts(&|entry| {
            drop_rollouts(entry);
            change(entry);
        })
    };
    let resettled = |key: &'static str, value: serde_json::Value| {
        move |entry: &Path| edit_both(entry, |p| p["settings"][key] = value.clone())
    };
    let replan = refused(&resettled("replan_steps", json!(10)));
    assert!(replan.contains("`replan_steps` is 10, and 5 in run"), "{replan}");
    assert!(
        refused(&resettled("av_lookahead", json!(false)))
            .contains("`av_lookahead` is false, and true in run")
    );
    let benchmark = refused(&|entry| edit_both(entry, |p| p["benchmark"]["blake3"] = "ab".into()));
    assert!(benchmark.contains("does not know the benchmark reactsim-bench"), "{benchmark}");
    let none = refused(&|entry| edit_both(entry, |p| _ = p.as_object_mut().unwrap().remove("benchmark")));
    assert!(none.contains("no known benchmark, or on a part of one"), "{none}");
    let part = refused(&|entry| edit_rows(entry, |rows| rows.retain(|r| r.record != 3)));
    assert!(part.contains("149 of the 150 scenarios"), "{part}");
    let unfinished = refused(&|entry| fs::remove_file(entry.join("summary.json")).unwrap());
    assert!(unfinished.contains("holds no finished run"), "{unfinished}");
    let better = |entry: &Path| {
        edit_rows(entry, |rows| {
            for row in rows.iter_mut().filter(|r| r.simulator == "log-replay") {
                if let Some(Some(value)) = row.metrics.get_mut("aav-collision") {
                    *value = Score::Count(0);
                }
            }
        });
    };
    // A summary that does not follow from the rows.
    let summed = refused(&|entry| {
        let other = at("other");
        better(&copy(run(), &other));
        fs::copy(other.join("summary.json"), entry.join("summary.json")).unwrap();
    });
    assert!(summed.contains("summary.json and the rows do not agree"), "{summed}");
    // Rows that do not follow from the rollouts.
    let edited = refused_with_rollouts(&better);
    assert!(edited.contains("the rollouts do not reproduce the rows: scenario"), "{edited}");
    assert!(edited.contains("`log-replay`: `metrics.aav-collision"), "{edited}");
}
