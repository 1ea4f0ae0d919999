//! The review page in a real browser.

use std::fs;
use std::path::{Path, PathBuf};

use reactsim::curation::decisions::Decisions;
use reactsim::curation::{Decision, store};
use serde_json::{Value, json};

use super::hand;
use super::review::{file, records};
use crate::chromium::{Browser, chromium};
use crate::program::{said, text};

/// Access to the scenario that the page shows and to the selected candidate.
trait Reviewed {
    /// Waits until the page shows this scenario.
    fn shows(&mut self, index: usize);

    fn selected(&mut self) -> Value;
}

impl Reviewed for Browser {
    fn shows(&mut self, index: usize) {
        self.until(&format!("document.body?.dataset.scenario === '{index}'"));
    }

    fn selected(&mut self) -> Value {
        self.evaluate("document.querySelector('.candidate.selected').dataset.number")
    }
}

/// Writes the review page of a file; returns its address.
fn page(file: &Path) -> String {
    let page = file.with_extension("html");
    said(&["curate", "review", text(file), "--out", text(&page)], 0);
    format!("file://{}", text(&page))
}

/// Exports the decisions of the page; returns the file.
fn exported(page: &mut Browser, folder: &Path) -> PathBuf {
    page.call("Browser.setDownloadBehavior", json!({"behavior": "allow", "downloadPath": folder}));
    page.press("e");
    let path = folder.join("set.parquet.decisions.jsonl");
    while fs::metadata(&path).map_or(0, |found| found.len()) == 0 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    path
}

#[test]
fn decisions_survive_the_page_and_are_applied() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let (folder, file) = file(5);
    let address = page(&file);
    let mut page = Browser::new(&chromium);
    page.open(&address);
    page.shows(0);
    assert_eq!(page.text("scenario"), records(1)[0].scenario_id);
    assert_eq!(page.text("progress-text"), "0 / 5 decided");

    // Time runs while the scene is played, and stops otherwise.
    assert_eq!(page.text("time"), "0.0 s");
    page.press(" ");
    page.until("parseFloat(document.getElementById('time').textContent) > 0.4");
    page.press("0");
    page.until("document.getElementById('time').textContent === '0.0 s'");

    // The chosen candidate is selected first; survivors are ordered by score.
    assert_eq!(page.selected(), "1");
    page.press("k");
    page.press("k");
    page.press("j");
    assert_eq!(page.selected(), "3");
    assert!(page.text("shown").starts_with("candidate #3: "));
    // The first decision asks for the name.
    page.press("a");
    page.until("document.getElementById('ask').open");
    page.evaluate(
        "document.getElementById('ask-text').value = 'anna'; document.getElementById('ask-ok').click()",
    );
    page.shows(1);
    assert_eq!(page.text("reviewer"), "anna");
    page.press("x");
    page.shows(2);
    page.press("u");
    page.shows(1);
    assert_eq!(page.text("verdict"), "undecided");
    page.press("x");
    page.shows(2);
    // A single candidate is rejected and the scenario stays; then the decision is dropped.
    page.press("X");
    page.until("document.getElementById('verdict').textContent.startsWith('rejected #1')");
    page.press("d");
    page.until("document.getElementById('verdict').textContent === 'undecided'");
    page.press("f");
    page.until("document.getElementById('ask').open");
    page.evaluate(
        "document.getElementById('ask-text').value = 'late?'; document.getElementById('ask-ok').click()",
    );
    page.shows(3);

    // Opened again, the page continues where it was.
    page.open("about:blank");
    page.open(&address);
    page.shows(3);
    assert_eq!(page.text("progress-text"), "2 / 5 decided");
    assert_eq!(page.text("tally"), "✓ 1✗ 1⚑ 1");
    // Only scenarios that match the selection are visited.
    page.evaluate(
        "const s = document.getElementById('state'); s.value = 'pick'; s.dispatchEvent(new Event('change'))",
    );
    page.shows(0);
    assert_eq!(page.text("position"), "1 of 1");
    assert_eq!(page.text("verdict").split(' ').next(), Some("accepted"));

    let lines = exported(&mut page, folder.path());
    let decisions = Decisions::read(&[&lines]).unwrap();
    let decided =
        records(5).iter().map(|r| decisions.about(r).map(|l| (l.decision, l.candidate))).collect::<Vec<_>>();
    let (pick, reject, flag) =
        ((Decision::Pick, Some(3)), (Decision::Reject, None), (Decision::Flag, Some(1)));
    assert_eq!(decided, [Some(pick), Some(reject), Some(flag), None, None]);
    let out = folder.path().join("applied.parquet");
    said(&["curate", "apply", text(&file), text(&lines), "--out", text(&out)], 0);
    let chosen: Vec<Option<u32>> =
        store::read(out).unwrap().map(|r| r.unwrap().chosen().map(|c| c.candidate.number)).collect();
    assert_eq!(chosen, [Some(3), None, Some(1), Some(1), Some(1)]);
    assert_eq!(page.errors, Vec::<String>::new());
    assert!(page.requests.iter().all(|url| !url.starts_with("http")), "{:?}", page.requests);
}

#[test]
fn a_scene_of_another_form_is_not_drawn_and_the_page_says_so() {
    let Some(chromium) = chromium() else { return crate::skipped("no Chromium on this machine") };
    let (_folder, file) = file(2);
    let mut all = records(2);
    all[0].scene = all[0].scene.as_ref().map(|scene| scene.replacen("{\"v\":1,", "{\"v\":7,", 1));
    hand::write(&file, &all);
    let mut shown = Browser::new(&chromium);
    shown.open(&page(&file));
    shown.shows(0);
    let said = shown.text("modes");
    assert!(said.contains("the scene has form 7, this page draws form 1"), "{said}");
    // Candidates are shown.
    shown.press("n");
    shown.shows(1);
    assert_eq!(shown.text("modes"), "");
    assert_eq!(shown.errors, Vec::<String>::new());
}
