//! The program as its user sees it.

mod deviations;
mod generate;
mod interruption;
mod refusals;
mod results;
mod specification;

use std::fs;
use std::path::Path;
use std::process::Output;
use std::sync::OnceLock;

use reactsim::models::{Card, MODELS};

use crate::program::{json_of, reactsim, refused, said, stderr, stdout, text, words};

/// Reads the files of a run that must not depend on how it was executed.
fn results(folder: &Path) -> Vec<Vec<u8>> {
    ["summary.json", "rows.jsonl", "events.jsonl", "failures.jsonl", "summary.md", "provenance.json"]
        .iter()
        .map(|name| fs::read(folder.join(name)).unwrap())
        .collect()
}

/// Returns the output of the program without arguments: its main task, run once for all tests.
fn bare() -> &'static Output {
    static BARE: OnceLock<Output> = OnceLock::new();
    BARE.get_or_init(|| reactsim(&[]))
}

#[test]
fn called_bare_it_runs_the_shipped_scenarios() {
    assert_eq!(bare().status.code(), Some(0), "{}", stderr(bare()));
    let table = stdout(bare());
    let shipped = format!("{} scenarios, reactive protocol", crate::shipped::benchmark().len());
    for part in ["| Log Replay † ", "| Constant Velocity ", "| Stop ", "A-AV Coll. ↓", &shipped] {
        assert!(table.contains(part), "{part} is not in\n{table}");
    }
    // Where stderr is no terminal, a line now and then, with the step of a scenario that takes long.
    let is_rate = |line: &str| line.contains("/s, ") && line.ends_with(" left");
    let is_step = |line: &str| line.contains(" of 150 scenarios, step ") && line.ends_with(" of 80");
    let is_progress = |line: &str| is_rate(line) || is_step(line);
    assert!(stderr(bare()).lines().all(is_progress), "{}", stderr(bare()));
    let limited = ["--limit", "1", "--models", "stop"];
    assert_eq!(stdout(&reactsim(&limited)), "", "flags need a verb");
    assert!(stdout(&reactsim(&[&["run"], &limited[..]].concat())).contains("| Stop "));
}

#[test]
fn the_backend_is_chosen_at_run_time() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let run = |backend: &str, more: &[&str], code| {
        let base = ["run", "--limit", "1", "--models", "ntp-reactive", "--out", text(&out)];
        said(&[&base[..], &["--backend", backend], more].concat(), code).1
    };
    run("ndarray", &[], 0);
    assert_eq!(json_of(&out.join("provenance.json"))["backend"], "ndarray");
    // Rows of two backends are not mixed.
    let resumed = run("flex", &["--resume"], 2);
    assert!(resumed.contains("backend"), "{resumed}");
    assert!(run("tpu", &[], 2).contains("backend `tpu`: this program contains flex, ndarray"));
    assert!(said(&["list", "backends"], 0).0.contains("flex     works"));
}

#[test]
fn the_documents_show_what_the_program_prints() {
    let printed = stdout(bare());
    let table = printed.split("\n\n").next().unwrap();
    let numbers = include_str!("../../docs/reference-numbers.md");
    let networks: Vec<String> = MODELS
        .iter()
        .filter(|m| m.needs_weights && m.is_complete())
        .map(|m| format!("| {} ", Card::read(m.id, m.card).unwrap().title))
        .collect();
    for line in table.lines() {
        // The last bits of a network's output differ between kinds of processors, and sometimes its samples
        // do, too.
        let title = networks.iter().find(|title| line.starts_with(*title));
        let shown = title.and_then(|title| numbers.lines().find(|shown| shown.starts_with(title)));
        let same = numbers.contains(line) || shown.is_some_and(|shown| nearly_the_same(line, shown));
        assert!(same, "put this table into docs/reference-numbers.md:\n{table}");
    }
}

/// Returns whether the cells `mean ±half` of two rows agree within a quarter of the interval.
fn nearly_the_same(a: &str, b: &str) -> bool {
    let cells = |row: &str| -> Vec<(f64, f64)> {
        let cells = row.split('|').filter_map(|cell| cell.split_once('±'));
        cells.map(|(m, h)| (m.trim().parse().unwrap(), h.trim().parse().unwrap())).collect()
    };
    let (a, b) = (cells(a), cells(b));
    a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| (a.0 - b.0).abs() <= 0.25 * a.1.max(b.1) + 0.011)
}

#[test]
fn help_fits_a_terminal() {
    let (help, _) = said(&["--help"], 0);
    insta::assert_snapshot!(help, @r"
    Do simulated agents respond feasibly when the autonomous vehicle (AV) leaves the log?

    Usage: reactsim [OPTIONS] [COMMAND]

    Look:
      list         List models, parameters, metrics, formats, weights, maps, cases or backends
      inspect      Describe and draw a scenario
      view         Show run folders in a browser: tables, figures, every scene from above
      report       Print the tables of finished runs, or write them as an HTML page
      compare      Compare two runs on the same scenarios, scenario by scenario

    Run:
      run          Run simulators on scenarios and print the table of their metrics
      study        Run studies: any axes, replan interval, reactive against realism protocol, ablations
      score        Score rollouts that any program produced
      session      Answer requests of the Python package over standard input and output

    Data:
      curate       Create AV trajectories that leave the log (deviated AVs), review and analyse them
      generate     Generate scenarios: maps, traffic and, for benchmarks, deviated AVs
      convert      Convert scenarios of any format to native Parquet
      import       Read the deviated AVs of other data sets
      export       Write deviated AVs, scenarios or runs for other programs

    Train:
      train        Train networks, build vocabularies and intention points

    Publish:
      verify       Check that this program reproduces the numbers of a reference
      reference    Create references, and write their tables into documents
      leaderboard  List references and submitted runs in one table

    Scale:
      merge        Join the partitions of a command into the output of the whole

    Shell:
      completions  Print a completion script for a shell
      man          Write manual pages
      help         Print this message or the help of a command

    Options:
      -q, --quiet    Print results, warnings and errors only: no progress and no hints
      -v, --verbose  Also print how plans ended, which run folders contain in any case
      -h, --help     Print help
      -V, --version  Print version

    Exit codes: 0 done; 1 done, but some scenarios failed; 2 wrong input or settings; 130 interrupted.

    Without arguments, the program runs the default baselines on the shipped scenarios.
    ");
    let verbs = "run score curate generate train convert import report compare verify reference leaderboard \
                 view study inspect export merge list";
    let kinds = [
        ["study replan", "study realism", "study guards"],
        ["export av", "export scenes", "export wosac"],
        ["curate stats", "curate apply", "curate review"],
    ];
    for command in verbs.split(' ').chain(kinds.into_iter().flatten()) {
        let (help, _) = said(&[&words(command)[..], &["--help"]].concat(), 0);
        assert!(help.contains(&format!("Usage: reactsim {command}")), "{help}");
        let widest = help.lines().map(|l| l.chars().count()).max().unwrap();
        assert!(widest < 100, "{command}: {widest} columns");
    }
    for old in ["export-av", "scenes"] {
        refused(&[old]);
    }
}

#[test]
fn how_plans_ended_is_in_the_folder_and_printed_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let run = ["run", "--limit", "1", "--models", "idm+qp"];
    let (printed, notes) = said(&[&run[..], &["--out", text(&out)]].concat(), 0);
    assert!(!printed.contains("How plans ended"), "{printed}");
    assert_eq!(notes, "", "nothing to worry about");
    let kept = fs::read_to_string(out.join("summary.md")).unwrap();
    let (verbose, _) = said(&[&run[..], &["--verbose"]].concat(), 0);
    for text in [kept, verbose] {
        assert!(text.contains("\nHow plans ended:\n\n- idm+qp: "), "{text}");
    }
}

#[test]
fn shells_and_man_know_every_command() {
    let home = tempfile::tempdir().unwrap();
    let (script, _) = said(&["completions", "bash"], 0);
    said(&["man", "--out", home.path().to_str().unwrap()], 0);
    let page = |name: &str| home.path().join(format!("reactsim-{name}.1"));
    for command in ["run", "curate", "study", "inspect", "verify", "export", "export-av", "export-scenes"] {
        assert!(script.contains(command.split('-').next().unwrap()), "{command}");
        assert!(std::fs::read_to_string(page(command)).unwrap().contains(".SH"), "{command}");
    }
    assert!(!page("scenes").exists());
}
