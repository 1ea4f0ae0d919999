//! Texts of others: control characters, markup, formulas, and any length.

use std::fs;

use reactsim::external::Command;

use crate::external;
use crate::program::{reactsim, said, text};

fn is_unsafe(c: char) -> bool {
    c.is_control() && c != '\n' || c == '\u{202e}'
}

#[test]
fn texts_of_a_simulator_do_not_control_the_terminal() {
    let Some(child) = external::Child::new() else { return };
    let out = child.path("run");
    let Command::Shell(line) = child.command("failed-loudly plan 0") else { unreachable!() };
    let run = ["run", "--limit", "1", "--models", "stop", "--out", text(&out)];
    let (_, said) = said(&[&run[..], &["--external", &format!("mine={line}")]].concat(), 1);
    assert!(said.contains("\\u{1b}[2J") && !said.contains(is_unsafe), "{said}");
    assert!(!said.contains("\nwarning: all is well"), "another message cannot be forged: {said}");
    assert!(said.len() < 10_000, "{} bytes", said.len());
    let table = fs::read_to_string(out.join("summary.md")).unwrap();
    assert!(table.contains("\\<b\\>") && !table.contains(is_unsafe), "{table}");
}

#[test]
fn names_of_folders_and_ids_do_not_control_the_terminal() {
    let home = tempfile::tempdir().unwrap();
    let name = home.path().join("a\u{1b}[31m\u{202e}");
    let out = name.to_str().unwrap();
    let run = ["run", "--limit", "1", "--models", "stop", "--out", out];
    said(&run, 0);
    // A changed id, as another program may write it.
    let rows = name.join("rows.jsonl");
    let text = fs::read_to_string(&rows).unwrap();
    let id = text.split("\"scenario\":\"").nth(1).unwrap().split('"').next().unwrap().to_owned();
    fs::write(&rows, text.replace(&format!("\"scenario\":\"{id}\""), "\"scenario\":\"=1\\u001b[2J\""))
        .unwrap();
    for arguments in [
        &["report", out][..],
        &["report", out, out, "--format", "terminal"],
        &["report", out, out, "--format", "csv"],
        &["report", out, "--format", "latex"],
        &["compare", out, out],
        &run,
        &["report", "none\u{1b}[31m"],
        &["run", out],
    ] {
        let output = reactsim(arguments);
        for text in [output.stdout, output.stderr] {
            let text = String::from_utf8(text).unwrap();
            assert!(!text.contains(is_unsafe), "{arguments:?}: {text}");
        }
    }
}
