//! Tables on a terminal: they fit its width, and highlight what is best among comparable runs.

use std::path::Path;

use reactsim::evaluation::{Summary, read_summary};
use reactsim::report::terminal::{self, TerminalStyle};
use reactsim::report::{Division, Run, TableStyle};

use crate::program::{MINI, ended, refused, said, text};

const PLAIN: TableStyle<'_> = TableStyle { columns: &[], also: &[], bold: false, caption: None, label: None };

const STYLE: TerminalStyle<'_> = TerminalStyle { width: 80, coloured: false, by: None, table: PLAIN };

fn run(folder: &Path, name: &str, more: &[&str]) -> Summary {
    let out = folder.join(name);
    let models = "log-replay,constant-velocity,stop,idm";
    let base = ["run", MINI, "--models", models, "--out", text(&out)];
    ended(&[&base[..], more].concat(), 0);
    read_summary(&out).unwrap()
}

fn table(runs: &[Run<'_>], style: TerminalStyle<'_>) -> String {
    let mut out = Vec::new();
    terminal::write(runs, style, &mut out).unwrap();
    String::from_utf8(out).unwrap()
}

#[test]
fn tables_fit_the_window_and_highlight_the_best() {
    let folder = tempfile::tempdir().unwrap();
    let (deviated, braking) = (run(folder.path(), "a", &[]), run(folder.path(), "b", &["--av", "brake:4"]));
    let one = [Run { name: "", summary: &deviated }];
    let widest = |text: &str| text.lines().map(|line| line.chars().count()).max().unwrap();

    let narrow = table(&one, STYLE);
    assert!(widest(&narrow) <= 80, "{narrow}");
    // No column is dropped: those that do not fit follow below.
    let count = |text: &str| text.lines().filter(|line| line.starts_with("Stop")).count();
    assert!(count(&narrow) > 1 && narrow.contains('±'), "{narrow}");
    let endless = table(&one, TerminalStyle { width: 1000, ..STYLE });
    assert_eq!(count(&endless), 1, "{endless}");
    let values = |text: &str| text.matches('±').count();
    assert_eq!(values(&narrow), values(&endless), "{narrow}");
    let wide = table(&one, TerminalStyle { width: 160, ..STYLE });
    assert!(wide.contains('±') && widest(&wide) <= 160, "{wide}");
    let parts = table(&one, TerminalStyle { by: Some(Division::Category), ..STYLE });
    assert!(parts.contains("\nLateral deviations (") && !narrow.contains("Lateral"), "{parts}");

    let highlighted = |text: &str| text.matches("\x1b[1;32m").count();
    assert_eq!(highlighted(&narrow), 0);
    let coloured = table(&one, TerminalStyle { coloured: true, ..STYLE });
    assert!(highlighted(&coloured) >= 7, "{coloured}");
    let replay = coloured.lines().find(|line| line.starts_with("Log Replay")).unwrap();
    assert_eq!(highlighted(replay), 0, "oracles are not ranked: {replay}");

    // Runs with other AVs are ranked separately. A window that is too narrow gets a table per column.
    let narrow = TerminalStyle { coloured: true, width: 20, ..STYLE };
    let of = |summary| highlighted(&table(&[Run { name: "", summary }], narrow));
    let runs = [Run { name: "a", summary: &deviated }, Run { name: "b", summary: &braking }];
    let both = table(&runs, narrow);
    assert_eq!(highlighted(&both), of(&deviated) + of(&braking), "{both}");
    let twice = [Run { name: "a", summary: &deviated }, Run { name: "b", summary: &deviated }];
    let twice = table(&twice, narrow);
    assert_eq!(highlighted(&twice), 2 * of(&deviated), "equal numbers tie: {twice}");
}

#[test]
fn columns_bold_numbers_caption_and_label_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "a", &[]);
    let a = folder.path().join("a");
    let report = |more: &[&str]| said(&[&["report", text(&a)][..], more].concat(), 0).0;
    let chosen = ["--columns", "aav-ttc,ade", "--bold"];
    let latex = report(
        &[&chosen[..], &["--format", "latex", "--caption", "50 % & more", "--label", "tab:x_1"]].concat(),
    );
    for part in ["Method & A-AV risky", "ADE", "\\caption{50 \\% \\& more}", "\\label{tab:x_1}", "\\textbf{"]
    {
        assert!(latex.contains(part), "{part} is not in\n{latex}");
    }
    assert!(!latex.contains("A-AV Coll"), "{latex}");
    let usual = report(&["--format", "latex"]);
    assert!(usual.contains("$^\\dagger$") && !usual.contains("\\textbf"), "{usual}");
    let markdown = report(&chosen);
    assert!(markdown.contains("| **") && !markdown.contains("A-AV Coll"), "{markdown}");
    let csv = report(&[&chosen[..2], &["--format", "csv"]].concat());
    assert!(csv.lines().skip(1).all(|line| line.contains(",aav-ttc,") || line.contains(",ade,")), "{csv}");
    // Devices are written to, not replaced.
    report(&["--out", "/dev/null"]);
    assert!(!Path::new("/dev/null").is_file());
    // Options without effect on a format are refused, not ignored.
    for (options, option) in [
        (&["--bold", "--format", "csv"][..], "--bold"),
        (&["--label", "tab:x"], "--label"),
        (&["--columns", "ade", "--format", "json"], "--columns"),
        (&["--all"], "--all"),
    ] {
        let error = refused(&[&["report", text(&a)][..], options].concat());
        assert!(error.contains(&format!("error: {option} ")), "{options:?}: {error}");
    }
}
