//! The review page in a real browser.

use std::io::Read;
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

use reactsim::curation::Decision;
use reactsim::curation::review::Journal;
use serde_json::Value;

use super::hand;
use super::review::{file, records};
use crate::chromium::{Browser, Served, chromium};

/// Access to the scenario that the page shows and to the selected candidate.
trait Reviewed {
    /// Waits until the page shows this scenario.
    fn shows(&mut self, index: usize);

    fn selected(&mut self) -> Value;
}

impl Reviewed for Browser {
    fn shows(&mut self, index: usize) {
        self.until(&format!("document.body.dataset.scenario === '{index}'"));
    }

    fn selected(&mut self) -> Value {
        self.evaluate("document.querySelector('.candidate.selected').dataset.number")
    }
}

/// Serves the review page of a file.
fn reviewing(file: &Path) -> Served {
    Served::new(&["curate", "review", "--reviewer", "anna", file.to_str().unwrap()])
}

/// Returns the decisions in the journal, by number of the scenario.
fn decided(file: &Path) -> Vec<Option<(Decision, Option<u32>)>> {
    let (decisions, warnings) = Journal::read_all(&[Journal::path_for(file)]).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let verdict = |id: &str, digest: &str| {
        decisions.get(id)?.verdict(digest).map(|line| (line.decision, line.candidate))
    };
    records(5).iter().map(|r| verdict(&r.scenario_id, &r.scenario_digest)).collect()
}

#[test]
fn decisions_survive_a_killed_server() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let (_folder, file) = file(5);
    let mut program = reviewing(&file);
    let mut page = Browser::new(&chromium);
    page.open(&program.url);
    page.shows(0);
    assert_eq!(page.text("scenario"), records(1)[0].scenario_id);
    assert_eq!(page.text("reviewer"), "anna");
    assert_eq!(page.text("progress-text"), "0 / 5 decided");

    // Time runs while the scene is played, and stops otherwise.
    assert_eq!(page.text("time"), "0.0 s");
    page.press(" ");
    page.until("parseFloat(document.getElementById('time').textContent) > 0.4");
    page.press(" ");
    let paused = page.text("time");
    thread::sleep(Duration::from_millis(200));
    assert_eq!(page.text("time"), paused);
    page.press("0");
    page.until("document.getElementById('time').textContent === '0.0 s'");

    // The chosen candidate is selected first; survivors are ordered by score.
    assert_eq!(page.selected(), "1");
    page.press("k");
    page.press("k");
    page.press("j");
    assert_eq!(page.selected(), "3");
    page.press("p");
    page.shows(1);
    assert_eq!(decided(&file)[0], Some((Decision::Pick, Some(3))));
    page.press("x");
    page.shows(2);
    assert_eq!(decided(&file)[1], Some((Decision::Reject, None)));
    page.press("u");
    page.shows(1);
    page.until("document.getElementById('verdict').textContent === 'undecided'");
    assert_eq!(decided(&file)[1], None);
    page.press("x");
    page.shows(2);
    page.press("f");
    page.shows(3);
    assert_eq!(page.text("progress-text"), "2 / 5 decided");
    let before = decided(&file);
    let flag = (Decision::Flag, Some(1));
    let expected = [Some((Decision::Pick, Some(3))), Some((Decision::Reject, None)), Some(flag), None, None];
    assert_eq!(before, expected);

    // A decision that cannot be written is reported and does not count.
    program.kill();
    page.press("p");
    page.until("!document.getElementById('alarm').hidden");
    assert!(page.text("alarm").starts_with("NOT written"));
    assert_eq!(page.text("progress-text"), "2 / 5 decided");
    assert_eq!(decided(&file), before);

    // The browser reports only that the server is gone.
    page.errors.retain(|error| !error.contains("ERR_CONNECTION_REFUSED"));

    // Opened again, the page continues where it was.
    let program = reviewing(&file);
    page.open(&program.url);
    page.shows(3);
    assert_eq!(page.text("progress-text"), "2 / 5 decided");
    assert_eq!(page.text("tally"), "✓ 1✗ 1⚑ 1");
    page.press("u");
    page.shows(2);
    page.until("document.getElementById('verdict').textContent === 'undecided'");
    assert_eq!(decided(&file)[2], None);
    // A single candidate is rejected and the scenario stays; then the decision is dropped.
    page.press("X");
    page.until("document.getElementById('verdict').textContent.startsWith('rejected #1')");
    assert_eq!(decided(&file)[2], Some((Decision::Reject, Some(1))));
    page.press("d");
    page.until("document.getElementById('verdict').textContent === 'undecided'");
    assert_eq!(decided(&file)[2], None);
    // Only scenarios that match the selection are visited.
    page.evaluate(
        "const s = document.getElementById('state'); s.value = 'pick'; s.dispatchEvent(new Event('change'))",
    );
    page.shows(0);
    assert_eq!(page.text("position"), "1 of 1");
    assert_eq!(page.errors, Vec::<String>::new());

    let wrong = format!("{}{}/", &program.url[..program.url.len() - 33], "0".repeat(32));
    page.open(&wrong);
    assert!(page.evaluate("document.body.innerText").as_str().unwrap().starts_with("not found"));
}

#[test]
#[cfg(unix)]
fn an_interrupt_ends_the_review() {
    let (_folder, file) = file(1);
    let mut program = reviewing(&file);
    let id = program.process.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    assert_eq!(program.process.wait().unwrap().code(), Some(0));
    let mut said = String::new();
    program.process.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(said.contains("decisions are in ") && said.contains("set.parquet.reviews.jsonl"), "{said}");
}

#[test]
fn a_scene_of_another_form_is_not_drawn_and_the_page_says_so() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let (_folder, file) = file(2);
    let mut all = records(2);
    all[0].scene = all[0].scene.as_ref().map(|scene| scene.replacen("{\"v\":1,", "{\"v\":7,", 1));
    hand::write(&file, &all);
    let program = reviewing(&file);
    let mut page = Browser::new(&chromium);
    page.open(&program.url);
    page.shows(0);
    let said = page.text("modes");
    assert!(said.contains("the scene has form 7, this page draws form 1"), "{said}");
    // Candidates are shown and can be decided on.
    page.press("p");
    page.shows(1);
    assert_eq!(page.text("modes"), "");
    assert_eq!(page.errors, Vec::<String>::new());
}
