//! Links between the documents of this repository, and the pages of the book.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use reactsim_test_support::documents::{ROOT, all};

/// Returns the lines of a document outside code blocks.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut in_code = false;
    text.lines().enumerate().filter(move |(_, line)| {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        !in_code && !is_fence
    })
}

/// Returns the targets of the links of a line; code between backticks has none.
fn links(line: &str) -> Vec<String> {
    let visible: String = line.split('`').step_by(2).collect();
    let mut parts = visible.split("](");
    parts.next();
    parts.filter_map(|rest| Some(rest.split_once(')')?.0.split(' ').next()?.to_owned())).collect()
}

/// Returns the anchors of the headings of a document, as repository hosts and mdBook make them.
fn anchors(text: &str) -> Vec<String> {
    let mut number = BTreeMap::new();
    let headings = prose(text).filter(|(_, line)| line.starts_with('#'));
    let anchor = |(_, line): (usize, &str)| {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        let anchor: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect();
        let times = number.entry(anchor.clone()).and_modify(|n| *n += 1).or_insert(0);
        if *times == 0 { anchor } else { format!("{anchor}-{times}") }
    };
    headings.map(anchor).collect()
}

#[test]
fn links_lead_to_files_and_headings() {
    let mut broken = Vec::new();
    for path in all() {
        let text = fs::read_to_string(&path).unwrap();
        for (number, line) in prose(&text) {
            for link in links(line) {
                if link.contains("://") || link.starts_with("mailto:") {
                    continue;
                }
                let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
                let target = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
                let is_heading =
                    || anchors(&fs::read_to_string(&target).unwrap()).contains(&anchor.to_owned());
                let leads_to_heading = anchor.is_empty() || !file_is_markdown(&target) || is_heading();
                if !target.exists() || !leads_to_heading {
                    broken.push(format!("{}:{}: {link}", path.display(), number + 1));
                }
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

fn file_is_markdown(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "md") && path.exists()
}

#[test]
fn every_page_is_in_the_book() {
    let book = Path::new(ROOT).join("docs");
    let summary = fs::read_to_string(book.join("SUMMARY.md")).unwrap();
    for path in all() {
        let Ok(page) = path.strip_prefix(&book) else { continue };
        let page = page.to_str().unwrap().replace('\\', "/");
        if page == "SUMMARY.md" {
            continue;
        }
        assert!(summary.contains(&format!("]({page})")), "{page} is not in docs/SUMMARY.md");
        let text = fs::read_to_string(&path).unwrap();
        // Repository hosts show such lines as they are.
        assert!(!text.contains("{{#"), "{page} includes another file");
    }
}
