//! nuPlan's scenario filters, the paper's numbers and rollouts in the files of ReactSim-Bench, as commands.

use std::fs;
use std::path::Path;
use std::process::Command;

use reactsim::evaluation::paper::{Agreement, PaperNumber};
use reactsim::evaluation::{Estimate, read_summary};
use reactsim_test_support::nuplan::{Fixture, ORIGIN, bench_name};
use reactsim_test_support::pickle::{Py, pickle};

use crate::program::{copy, said, stderr, stdout, text};
use crate::reference::{edit_both, run};

const PAPER: &str = "reactsim-bench-paper";

#[test]
fn numbers_agree_as_they_are_printed_or_within_the_interval() {
    let numbers: Vec<PaperNumber> = PaperNumber::all().collect();
    let estimate = |mean, low, high| Estimate { mean: Some(mean), low, high, scenarios: 9 };
    let (collisions, steering) = (numbers[0], numbers[6]);
    assert_eq!((collisions.printed, steering.printed, numbers.len()), ("0.9829", "2.51", 9));
    for (number, found, expected) in [
        (collisions, estimate(0.982_94, None, None), Agreement::Equal),
        (collisions, estimate(0.983, None, None), Agreement::Unknown),
        (collisions, estimate(0.9, Some(0.8), Some(0.982_86)), Agreement::Within),
        (collisions, estimate(0.9, Some(0.8), Some(0.982_84)), Agreement::Differs),
        (collisions, Estimate::default(), Agreement::Unknown),
        (steering, estimate(0.025_12, None, None), Agreement::Equal),
        (steering, estimate(0.026, Some(0.025_14), Some(0.03)), Agreement::Within),
        (steering, estimate(0.026, Some(0.025_16), Some(0.03)), Agreement::Differs),
        (numbers[7], estimate(0.834_61, None, None), Agreement::Equal),
        (numbers[8], estimate(0.981_3, None, None), Agreement::Unknown),
    ] {
        assert_eq!(number.agreement(&found), expected, "{number:?} {found:?}");
    }
}

/// Returns the cells of the row of a table that begins with these.
fn row<'a>(table: &'a str, begin: &[&str]) -> Vec<&'a str> {
    let cells = |line: &'a str| line.trim_matches('|').split('|').map(str::trim).collect::<Vec<_>>();
    let found = table.lines().map(cells).find(|cells| cells.starts_with(begin));
    found.unwrap_or_else(|| panic!("no row {begin:?}:\n{table}"))
}

#[test]
fn log_replay_is_compared_with_the_paper() {
    let (table, _) = said(&["verify", PAPER, "--run", text(run())], 1);
    let summary = read_summary(run()).unwrap();
    let found = &summary.simulators["log-replay"].metrics["aav-collision"];
    let interval = format!("{:.4} to {:.4}", found.low.unwrap(), found.high.unwrap());
    let expected = ["A-AV Coll.", "0.9829", &format!("{:.4}", found.mean.unwrap()), &interval, "differs"];
    assert_eq!(row(&table, &["A-AV Coll.", "0.9829"]), expected);
    assert!(table.contains("Here: 150 scenarios.") && table.contains("need not be equal"), "{table}");
    assert!(!table.contains("Metric options of the run"), "{table}");
    // Variants have the numbers of a run that is scored with the option.
    let home = tempfile::tempdir().unwrap();
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/bench.parquet");
    let rollouts = run().join("rollouts.parquet");
    for (title, metric, option, digits) in [
        ("A-AV Coll.", "aav-collision", "corner_rounding=0", 4),
        ("A-AV risky", "aav-ttc", "corner_rounding=0", 4),
    ] {
        let scored = home.path().join(metric);
        let begin = ["score", text(&rollouts), "--scenarios", shipped, "--metric-option", option];
        said(&[&begin[..], &["--out", text(&scored)]].concat(), 0);
        let mean = read_summary(&scored).unwrap().simulators["log-replay"].metrics[metric].mean.unwrap();
        let cells = row(&table, &[title, &format!("`{option}`")]);
        assert_eq!(cells[3], format!("{mean:.digits$}"), "{cells:?}");
    }
    assert!(!table.contains("fault_order"), "it changes nothing here: {table}");
    let steering = summary.simulators["log-replay"].metrics["curvature-velocity"].mean.unwrap();
    assert_eq!(row(&table, &["Steer. (%)", "`curvature-velocity`"])[3], format!("{:.2}", 100.0 * steering));
}

#[test]
fn runs_that_cannot_be_compared_with_the_paper_are_refused() {
    let home = tempfile::tempdir().unwrap();
    let other = copy(run(), &home.path().join("other"));
    assert!(said(&["verify", PAPER], 2).1.contains("give the run to compare with --run"));
    assert!(said(&["verify", "--run", text(run())], 2).1.contains("with reactsim-bench-paper only"));
    assert!(said(&["verify", PAPER, "--run", text(run()), "--quick"], 2).1.contains("leave --quick out"));
    fs::remove_file(other.join("rollouts.parquet")).unwrap();
    let (table, _) = said(&["verify", PAPER, "--run", text(&other)], 1);
    assert!(table.contains("not computed: the run did not keep its rollouts"), "{table}");
    assert!(row(&table, &["Steer. (%)", "`curvature-velocity`"]).len() == 6);
    // Scenarios that are not there.
    let moved = copy(run(), &home.path().join("moved"));
    edit_both(&moved, |provenance| provenance["inputs"][0]["blake3"] = "00".repeat(32).into());
    let (table, _) = said(&["verify", PAPER, "--run", text(&moved)], 1);
    assert!(table.contains("not computed: the scenarios of the run are not there"), "{table}");
    let idm = home.path().join("stop");
    said(&["run", "--limit", "1", "--models", "stop", "--out", text(&idm)], 0);
    assert!(said(&["verify", PAPER, "--run", text(&idm)], 2).1.contains("no simulator `log-replay`"));
}

/// Prints what a pickle has, if there is numpy.
const SHOW: &str = "
import pickle, sys
try: import numpy
except ImportError: sys.exit(3)
it = pickle.load(open(sys.argv[1], 'rb'))
x = it['trajectories']
x += 0
print(sorted(it), it['format'], it['scenario'], it['simulator'], it['first_frame'], it['agent_ids'][0], it['columns'])
print(x.shape, x.dtype, it['valid'].shape, it['valid'].dtype, it['valid'].all(), numpy.isnan(x).any())
print([round(float(v), 3) for v in x[0, 0, 0]])
";

#[test]
fn filters_select_the_scenarios_of_runs_and_pages() {
    let made = Fixture::write();
    let logs = made.log.parent().unwrap();
    let at = |name: &str| logs.join(name);
    fs::write(at("inner.yaml"), "scenario_types: [inner]\nscenario_tokens: null\n").unwrap();
    let (filter, out, html_file) = (at("inner.yaml"), at("run"), at("page.html"));
    let selection = ["--nuplan", text(logs), "--filter", text(&filter)];
    let models = ["--models", "log-replay,stop", "--av", "brake:1", "--keep-rollouts", "--out", text(&out)];
    said(&[&["run"], &selection[..], &models].concat(), 0);
    let summary = read_summary(&out).unwrap();
    assert_eq!((summary.provenance.scenarios, summary.simulators.len()), (2, 2));
    let input = &summary.provenance.run.inputs[0];
    let companions: Vec<&str> = input.companions.iter().map(|file| file.name.as_str()).collect();
    assert_eq!((input.name.as_str(), companions), ("inner.yaml", vec!["made.db", "map.gpkg"]));
    let listed = said(&[&["list", "scenarios"], &selection[..]].concat(), 0).0;
    assert!(listed.contains("700000000000001e") && listed.contains("700000000000001f"), "{listed}");
    said(&[&["inspect"], &selection[..]].concat(), 0);
    said(&[&["convert"], &selection[..], &["--out", text(&at("inner.parquet"))]].concat(), 0);
    let page = ["report", text(&out), "--format", "html", "--out", text(&html_file)];
    assert_eq!(said(&[&page, &selection[..]].concat(), 0).1, "");
    // Beside deviated AVs on nuPlan, the page shows the paper's table.
    let html = || fs::read_to_string(&html_file).unwrap();
    assert!(html().contains(r#""paper":null"#));
    edit_both(&out, |provenance| provenance["deviations"] = provenance["inputs"][0].clone());
    said(&[&page, &selection[..]].concat(), 0);
    assert!(html().contains(r#"["TrajTok",["0.1407","0.4173","2.23","0.61","1.03","3.23","3.93"]]"#));
    for wrong in [&selection[..2], &selection[2..]] {
        said(&[&["run"], wrong].concat(), 2);
    }
}

#[test]
fn rollouts_are_exported_with_the_names_of_the_imported_files() {
    let made = Fixture::write();
    let home = made.log.parent().unwrap();
    let at = |name: &str| home.join(name);
    let data = at("data");
    fs::create_dir(&data).unwrap();
    let rows = [22, 31, 36, 43, 50, 57];
    for row in rows {
        let x = |step: u32| ORIGIN.0 - 40.0 + 0.25 * f64::from(row) + 0.4 * f64::from(step);
        let poses = (1..=80).flat_map(|step| [x(step), ORIGIN.1, 0.0]).collect();
        fs::write(data.join(bench_name(0, row)), pickle(&Py::Array(vec![80, 3], poses), 4, 2)).unwrap();
    }
    let (file, out, files) = (at("official.parquet"), at("run"), at("files"));
    said(&["import", "reactsim-bench", text(&data), "--nuplan", text(&made.log), "--out", text(&file)], 0);
    let with = ["--deviations", text(&file)];
    let selection = at("official.selection.json");
    let models = ["--models", "log-replay,stop", "--keep-rollouts", "--out", text(&out)];
    said(&[&["run", text(&selection)], &with[..], &models].concat(), 0);
    let export = ["export", "reactsim-bench", text(&out), "--simulator", "stop", "--out", text(&files)];
    let (_, note) = said(&[&export, &with[..]].concat(), 0);
    assert!(note.contains("6 scenarios of `stop`"), "{note}");
    for row in rows {
        assert!(files.join(bench_name(0, row)).exists());
    }
    shows_its_content(&files.join(bench_name(0, 31)));
    // Official files have these names: nothing that exists is replaced.
    let full = said(&[&export[..6], &[text(&data)], &with[..]].concat(), 2).1;
    assert!(full.contains("the folder has files; give a new one"), "{full}");
    let several = said(&[&export[..3], &["--out", text(&at("other"))], &with[..]].concat(), 2).1;
    assert!(several.contains("give --simulator one of those of the run: log-replay, stop"), "{several}");
    let fresh = at("other");
    let other = [&export[..6], &[text(&fresh), "--deviations", text(&selection)]].concat();
    assert!(said(&other, 2).1.contains("it is not the file of"));
}

fn shows_its_content(file: &Path) {
    let shown = Command::new("python3").args(["-c", SHOW, text(file)]).output();
    let Ok(shown) =
        shown.map_err(|_| ()).and_then(|o| if o.status.code() == Some(3) { Err(()) } else { Ok(o) })
    else {
        return crate::skipped("no Python with numpy");
    };
    let lines = stdout(&shown);
    let lines: Vec<&str> = lines.lines().collect();
    assert_eq!(lines.len(), 3, "{}", stderr(&shown));
    let keys =
        "['agent_ids', 'columns', 'first_frame', 'format', 'scenario', 'simulator', 'trajectories', 'valid']";
    let head = "reactsim-bench-rollouts-v1 700000000000001f stop 11 ego ['x', 'y', 'heading', 'vx', 'vy']";
    assert_eq!(lines[0], format!("{keys} {head}"));
    assert_eq!(lines[1], "(1, 2, 80, 5) float64 (1, 2, 80) bool True False");
    // The AV of row 31, 0.1 s later, at 4 m/s; 1.461 m ahead of its rear axle.
    let x = 500_000.0 - 40.0 + 0.25 * 31.0 + 1.461 + 0.4;
    assert!(lines[2].starts_with(&format!("[{x:.3}, 4982950.4, 0.0, 4.0, 0.0]")), "{}", lines[2]);
}
