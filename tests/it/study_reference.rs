//! References of studies: made, refused after changes, verified member by member, and their tables.

use std::fs;
use std::path::{Path, PathBuf};

use reactsim::evaluation::reference::StudyReference;

use crate::program::{MINI, said, text};
use crate::reference::{as_if_committed, edit_file};

/// Makes a study of two members on the mini scenarios, and a reference from it.
fn made(home: &Path) -> (PathBuf, PathBuf) {
    let (study, reference) = (home.join("study"), home.join("reference"));
    let models = ["--models", "idm,stop", "--intervals", "5,40"];
    said(&[&["study", "replan", MINI, "--out", text(&study)], &models[..]].concat(), 0);
    ["steps-05", "steps-40"].iter().for_each(|member| as_if_committed(&study.join(member)));
    let make = ["reference", "make", text(&study), "--name", "test", "--aggregates-only"];
    said(&[&make[..], &["--out", text(&reference)]].concat(), 0);
    (study, reference)
}

fn refused(reference: &Path) -> String {
    StudyReference::open(reference).unwrap_err().to_string()
}

#[test]
fn every_member_is_a_reference() {
    let home = tempfile::tempdir().unwrap();
    let (study, reference) = made(home.path());
    let opened = StudyReference::open(&reference).unwrap();
    let names: Vec<&str> = opened.members.iter().map(|m| m.record.name.as_str()).collect();
    assert_eq!(names, ["test.steps-05", "test.steps-40"]);
    assert_eq!(opened.members[0].record.title, "test: every 5 steps (2 Hz)");
    // The tables of a document are those of the study.
    let page = home.path().join("page.md");
    fs::write(&page, format!("<!-- table {} -->\n<!-- end -->\n", text(&reference))).unwrap();
    said(&["reference", "tables", text(&page)], 0);
    let told = fs::read_to_string(study.join("study.md")).unwrap();
    let tables = told.split("\n- `steps-05`").next().unwrap();
    let written = fs::read_to_string(&page).unwrap();
    assert!(
        written.contains(tables) && written.contains("12 scenarios, reactsim 0.1.0 (012345678)."),
        "{written}"
    );
    assert_eq!(said(&["reference", "tables", text(&page), "--check"], 0).1, "");
    // A block may choose columns, but neither simulators nor scenarios.
    let block = |keys: &str| {
        fs::write(&page, format!("<!-- table {} {keys} -->\n<!-- end -->\n", text(&reference))).unwrap();
    };
    block("columns=aav-ttc");
    said(&["reference", "tables", text(&page)], 0);
    let chosen = fs::read_to_string(&page).unwrap();
    let table = tables.split("A-AV risky").nth(1).unwrap().split("\n\n").nth(1).unwrap();
    assert!(chosen.contains(table) && !chosen.contains("A-AV Coll."), "{chosen}");
    block("models=idm");
    assert!(said(&["reference", "tables", text(&page)], 2).1.contains("leave out models"));
}

#[test]
fn every_member_is_verified() {
    let home = tempfile::tempdir().unwrap();
    let (_, reference) = made(home.path());
    let verify = |code| said(&["verify", text(&reference), "--scenarios", MINI], code);
    let (table, told) = verify(0);
    assert!(told.contains("1 of 2: test: every 5 steps (2 Hz)") && told.contains("2 of 2"), "{told}");
    assert_eq!(table.matches("idm").count() % 2, 0, "{table}");
    // Aggregates of the second member that cannot be reproduced.
    edit_file(&reference.join("steps-40"), "summary.json", |summary| {
        summary["simulators"]["stop"]["metrics"]["ade"]["mean"] = 1.0.into();
    });
    let (table, _) = verify(1);
    assert!(
        table.contains("ade.mean") && table.contains("test.steps-05: 594 values compared.\n\n| Simulator"),
        "{table}"
    );
}

#[test]
fn what_was_changed_is_refused() {
    let home = tempfile::tempdir().unwrap();
    let (study_folder, reference) = made(home.path());
    let stated = fs::read_to_string(reference.join("study.json")).unwrap();
    let study = |text: &str| fs::write(reference.join("study.json"), text).unwrap();
    study(&stated.replace("\"replan_steps\": 40", "\"replan_steps\": 20"));
    assert!(refused(&reference).contains("`replan_steps` is 40 here and 20 in study.json"));
    study(&stated.replace("\"folder\": \"steps-40\"", "\"folder\": \"steps-20\""));
    assert!(refused(&reference).contains("steps-20"), "{}", refused(&reference));
    study(&stated);
    fs::write(reference.join("notes.txt"), "").unwrap();
    assert!(refused(&reference).contains("notes.txt does not belong to the study"));
    fs::remove_file(reference.join("notes.txt")).unwrap();
    fs::remove_dir_all(reference.join("steps-40")).unwrap();
    assert!(refused(&reference).contains("steps-40"), "{}", refused(&reference));
    // An existing folder is not replaced.
    let again = ["reference", "make", text(&study_folder), "--name", "test", "--aggregates-only"];
    let told = said(&[&again[..], &["--out", text(&reference)]].concat(), 2).1;
    assert!(told.contains("exists and is not empty"), "{told}");
}
