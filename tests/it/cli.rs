//! The program as its user sees it.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use reactsim::models::{Card, MODELS};

use crate::generated::{certified, deviating, scenario, write};
use crate::program::{program, reactsim};

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The files of a run that must not depend on how it went.
fn results(folder: &Path) -> Vec<Vec<u8>> {
    ["summary.json", "rows.jsonl", "events.jsonl", "failures.jsonl", "summary.md", "provenance.json"]
        .iter()
        .map(|name| fs::read(folder.join(name)).unwrap())
        .collect()
}

/// What the program says when it is called bare: its main job, done once for all tests.
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
    assert!(stderr(bare()).is_empty(), "no progress where stderr is no terminal");
    let limited = ["--limit", "1", "--models", "stop"];
    assert_eq!(stdout(&reactsim(&limited)), "", "flags need a verb");
    assert!(stdout(&reactsim(&[&["run"], &limited[..]].concat())).contains("| Stop "));
}

#[test]
fn the_backend_is_chosen_at_run_time() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let run = |backend: &str, more: &[&str]| {
        let base = ["run", "--limit", "1", "--models", "ntp-reactive", "--out", text(&out)];
        reactsim(&[&base[..], &["--backend", backend], more].concat())
    };
    let done = run("ndarray", &[]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let provenance = fs::read_to_string(out.join("provenance.json")).unwrap();
    assert!(provenance.contains("\"backend\": \"ndarray\""), "{provenance}");
    // Rows of two backends are not mixed.
    let resumed = run("flex", &["--resume"]);
    assert_eq!(resumed.status.code(), Some(2));
    assert!(stderr(&resumed).contains("backend"), "{}", stderr(&resumed));
    let unknown = run("tpu", &[]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("backend `tpu`: this program contains flex, ndarray"));
    assert!(stdout(&reactsim(&["list", "backends"])).contains("flex     works"));
}

#[test]
fn the_readme_shows_what_the_program_prints() {
    let printed = stdout(bare());
    let table = printed.split("\n\n").next().unwrap();
    let readme = include_str!("../../README.md");
    let networks: Vec<String> = MODELS
        .iter()
        .filter(|m| m.needs_weights && m.is_complete())
        .map(|m| format!("| {} ", Card::read(m.id, m.card).unwrap().title))
        .collect();
    for line in table.lines() {
        // Between kinds of processors the last bits of a network differ, and now and then what it draws.
        let title = networks.iter().find(|title| line.starts_with(*title));
        let shown = title.and_then(|title| readme.lines().find(|shown| shown.starts_with(title)));
        let same = readme.contains(line) || shown.is_some_and(|shown| nearly_the_same(line, shown));
        assert!(same, "put this table into README.md:\n{table}");
    }
}

/// Whether the cells `mean ±half` of two rows agree within a quarter of the interval.
fn nearly_the_same(a: &str, b: &str) -> bool {
    let cells = |row: &str| -> Vec<(f64, f64)> {
        let cells = row.split('|').filter_map(|cell| cell.split_once('±'));
        cells.map(|(m, h)| (m.trim().parse().unwrap(), h.trim().parse().unwrap())).collect()
    };
    let (a, b) = (cells(a), cells(b));
    a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| (a.0 - b.0).abs() <= 0.25 * a.1.max(b.1) + 0.011)
}

/// A finished run of two scenarios that kept its rollouts, and the arguments that resume it.
fn finished(folder: &Path) -> Vec<String> {
    let out = folder.join("run");
    let scenarios = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
    let run = ["run", scenarios, "--limit", "2", "--models", "constant-velocity,stop", "--keep-rollouts"];
    let mut arguments: Vec<String> = run.iter().map(|a| (*a).to_owned()).collect();
    arguments.extend(["--out".to_owned(), text(&out).to_owned()]);
    let done = reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    arguments.push("--resume".to_owned());
    arguments
}

#[test]
fn a_run_killed_while_it_removes_its_parts_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = finished(folder.path());
    let run = folder.path().join("run");
    let rollouts = fs::read(run.join("rollouts.parquet")).unwrap();
    fs::create_dir(run.join("parts")).unwrap();
    fs::copy(run.join("rollouts.parquet"), run.join("parts/000000-00000001-000.parquet")).unwrap();
    let resumed = reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert!(!run.join("parts").exists());
    assert!(fs::read(run.join("rollouts.parquet")).unwrap() == rollouts);
}

#[test]
fn lost_events_are_counted_again_and_damaged_ones_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = finished(folder.path());
    let resume = || reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let path = folder.path().join("run/events.jsonl");
    let events = fs::read_to_string(&path).unwrap();
    assert!(events.contains("\"metric\":\"aav-collision\""), "{events}");
    fs::write(&path, "").unwrap();
    let resumed = resume();
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert_eq!(fs::read_to_string(&path).unwrap(), events);
    fs::write(&path, events.replacen("\"input\"", "\"inp", 1)).unwrap();
    let refused = resume();
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("events.jsonl is damaged in line 1"), "{}", stderr(&refused));
}

#[test]
fn help_fits_a_terminal() {
    let help = stdout(&reactsim(&["--help"]));
    insta::assert_snapshot!(help, @r"
    Do simulated agents respond feasibly when the autonomous vehicle (AV) leaves the log?

    Usage: reactsim [OPTIONS] [COMMAND]

    Commands:
      run          Run simulators on scenarios and print the table of their metrics
      score        Score rollouts that any program produced
      curate       Create AV trajectories that leave the log (deviated AVs), review and analyse them
      generate     Generate scenarios: maps, traffic and, for benchmarks, deviated AVs
      train        Train networks, build vocabularies and intention points
      convert      Convert scenarios of any format to native Parquet
      report       Print the tables of finished runs, or write them as an HTML page
      compare      Compare two runs on the same scenarios, scenario by scenario
      verify       Check that this program reproduces the numbers of a reference
      reference    Create references, and write their tables into documents
      leaderboard  List references and submitted runs in one table
      view         Show run folders in a browser: tables, figures, every scene from above
      study        Run studies: replan interval, reactive against realism protocol, ablations
      inspect      Describe and draw a scenario
      export       Write runs in the formats of others
      export-av    Write the trajectories of deviated AVs without anything of the recorded future
      scenes       Write scenarios as frames that the Python package reads
      list         List models, parameters, metrics, formats, weights, maps, cases or backends
      completions  Print a completion script for a shell
      man          Write manual pages
      help         Print this message or the help of the given subcommand(s)

    Options:
      -q, --quiet    Print results, warnings and errors only: no progress and no hints
      -h, --help     Print help
      -V, --version  Print version

    Exit codes: 0 done; 1 done, but some scenarios failed; 2 wrong input or settings; 130 interrupted.

    Without arguments the program runs every baseline on the shipped scenarios.
    ");
    for verb in [
        "run",
        "score",
        "curate",
        "generate",
        "train",
        "convert",
        "report",
        "compare",
        "verify",
        "reference",
        "leaderboard",
        "view",
        "study",
        "inspect",
        "export-av",
        "scenes",
        "list",
    ] {
        let help = stdout(&reactsim(&[verb, "--help"]));
        assert!(help.contains("Usage: reactsim"), "{verb}");
        let widest = help.lines().map(|l| l.chars().count()).max().unwrap();
        assert!(widest < 100, "{verb}: {widest} columns");
    }
    for kind in ["replan", "realism", "guards"] {
        let help = stdout(&reactsim(&["study", kind, "--help"]));
        let widest = help.lines().map(|l| l.chars().count()).max().unwrap();
        assert!(widest < 100, "study {kind}: {widest} columns");
    }
}

#[test]
fn wrong_input_names_the_mend_and_exits_with_2() {
    let home = tempfile::tempdir().unwrap();
    let plain = home.path().join("plain.parquet");
    write(&plain, (0..2).map(|i| deviating(i, false)));
    let error = |arguments: &[&str]| {
        let output = reactsim(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
        stderr(&output).replace(text(home.path()), "HOME")
    };
    let unknown = error(&["run", "--models", "idmm"]);
    assert!(unknown.starts_with("error: there is no simulator `idmm`; there are: log-replay, "), "{unknown}");
    assert!(unknown.contains("\nhint: did you mean `idm`? `reactsim list models`"), "{unknown}");
    insta::assert_snapshot!(error(&["run", text(&plain)]), @r"error: the scenarios have no deviated AV: give --deviations <file>, or choose a driver with --av: deviated, log, constant-velocity, brake:<m/s²>, retime:<factor>, shift:<m> or file:<path>");
    insta::assert_snapshot!(error(&["run", "--metric-option", "fault_order=mine"]), @r"error: metric option `fault_order` is `mine`, expected `paper` or `nuplan`");
    insta::assert_snapshot!(error(&["run", "--protocol", "realism", "--av", "log"]), @r"error: the simulator moves the AV in the realism protocol: leave --av out");
    insta::assert_snapshot!(error(&["run", "--av", "log", "--deviations", "x.json"]), @r"error: --deviations goes with --av deviated only");
    insta::assert_snapshot!(error(&["run", "--models", "stop,stop"]), @r"error: the simulator `stop` is named twice");
    insta::assert_snapshot!(error(&["report", text(home.path())]), @r"
    error: HOME is not a run folder: it has no provenance.json
    hint: `reactsim run --out FOLDER` writes a run folder
    ");
    assert!(error(&["run", "--av", "brake:9"]).contains("a deceleration above 0 and at most 6 m/s²"));
    assert!(error(&["run", "--replan", "3hz"]).contains("such as `2hz`"));
    assert!(error(&["run", "--rollouts", "0"]).contains("1..=10000"));
    assert!(error(&["run", "--resume"]).contains("--out"));
    assert!(error(&["run", "--jobs", "100000"]).contains("1..=1024"));
    assert!(
        error(&["inspect", text(&plain), "--rollout", "HOME", "--simulator", "idm"]).contains("--svg <FILE>")
    );
    #[cfg(unix)]
    assert!(error(&["convert", text(&plain), "--out", "/dev/null"]).contains("is not a regular file"));
    assert!(error(&["run", "HOME/absent"]).contains("HOME/absent"));
    assert!(error(&["run", text(&plain), "--deviations", "absent.json"]).contains("absent.json"));
    // The folder stands where a file is.
    let taken = home.path().join("plain.parquet/run");
    assert!(error(&["run", "--out", text(&taken)]).contains("could not write HOME/plain.parquet/run"));
}

#[test]
fn failed_scenarios_are_listed_and_the_rest_is_in_the_table() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("some.parquet"), home.path().join("run"));
    write(&input, (0..4).map(|i| deviating(i, i != 2)));
    let output =
        reactsim(&["run", text(&input), "--models", "stop", "--av", "deviated", "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(1));
    insta::assert_snapshot!(stderr(&output), @r"
    warning: failed: some.parquet: record 2: scenario `road-002`: no deviated AV; give --deviations with one for this scenario, or choose another --av
    warning: 1 failed; the others are in the table
    ");
    assert!(stdout(&output).contains("3 scenarios, 1 failure"));
    let failures = fs::read_to_string(out.join("failures.jsonl")).unwrap();
    assert_eq!(failures.lines().count(), 1);
    assert!(failures.contains("road-002"), "{failures}");
    assert!(fs::read_to_string(out.join("summary.md")).unwrap().contains("Failed:"));
    // Where every scenario fails there is nothing to be shown.
    write(&input, [deviating(2, false)]);
    let output = reactsim(&["run", text(&input), "--av", "deviated"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("no scenario could be run"));
}

#[test]
fn files_that_only_look_like_scenarios_are_named() {
    let home = tempfile::tempdir().unwrap();
    write(&home.path().join("a.parquet"), [deviating(0, true)]);
    fs::write(home.path().join("b.json"), "{").unwrap();
    fs::write(home.path().join("notes.txt"), "no scenario, and not named like one").unwrap();
    let output = reactsim(&["run", text(home.path()), "--models", "stop"]);
    assert_eq!(output.status.code(), Some(0));
    let said = stderr(&output);
    assert!(said.contains("b.json is skipped: it is not a scenario file"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

#[test]
fn a_damaged_file_does_not_stop_the_others() {
    let home = tempfile::tempdir().unwrap();
    let (good, bad) = (home.path().join("a.parquet"), home.path().join("b.parquet"));
    write(&good, (0..2).map(scenario));
    let bytes = fs::read(&good).unwrap();
    fs::write(&bad, &bytes[..bytes.len() / 2]).unwrap();
    let output = reactsim(&["run", text(home.path()), "--models", "stop", "--format", "csv"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("b.parquet"), "{}", stderr(&output));
    assert!(stdout(&output).contains("stop,false,mean,,,aav-collision,"));
}

/// Starts a run that lasts for seconds and waits until it has written rows.
fn long_run(input: &Path, out: &Path, resume: bool) -> Child {
    let mut command = program();
    command.args(["run", text(input), "--models", "log-replay,stop", "--rollouts", "30", "--jobs", "1"]);
    command.args(["--batch", "1", "--out", text(out)]).args(resume.then_some("--resume"));
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    while fs::metadata(out.join("rows.jsonl")).map_or(0, |m| m.len()) == 0 {
        assert!(child.try_wait().unwrap().is_none(), "the run ended before it wrote a row");
        assert!(begun.elapsed() < Duration::from_secs(60), "no row was written");
        sleep(Duration::from_millis(2));
    }
    child
}

/// Sends a signal to a run in its course; where the run was faster than the test, tries again.
#[cfg(unix)]
fn signalled(input: &Path, out: &Path, signal: &str) -> Output {
    for _ in 0..20 {
        let child = long_run(input, out, false);
        Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        let output = child.wait_with_output().unwrap();
        if !out.join("summary.json").exists() {
            return output;
        }
        fs::remove_dir_all(out).unwrap();
    }
    panic!("no run lasted long enough for {signal}");
}

#[cfg(unix)]
#[test]
fn killed_and_interrupted_runs_go_on_to_the_same_bytes() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("scenarios.parquet");
    write(&input, (0..24).map(scenario));
    let folder = |name: &str| home.path().join(name);
    let whole = folder("whole");
    assert!(long_run(&input, &whole, false).wait().unwrap().success());

    let killed = folder("killed");
    signalled(&input, &killed, "-KILL");
    assert!(long_run(&input, &killed, true).wait().unwrap().success());
    assert!(results(&killed) == results(&whole));

    // ^C.
    let stopped = folder("stopped");
    let output = signalled(&input, &stopped, "-INT");
    assert_eq!(output.status.code(), Some(130));
    assert!(stderr(&output).contains("--resume"), "{}", stderr(&output));
    let rows = fs::read_to_string(stopped.join("rows.jsonl")).unwrap();
    assert!(
        rows.ends_with('\n') && rows.lines().all(|l| serde_json::from_str::<serde_json::Value>(l).is_ok())
    );
    let unfinished = reactsim(&["report", text(&stopped)]);
    assert!(stderr(&unfinished).contains("holds no finished run"), "{}", stderr(&unfinished));
    assert!(long_run(&input, &stopped, true).wait().unwrap().success());
    assert!(results(&stopped) == results(&whole));
}

#[test]
fn kept_rollouts_score_to_the_same_numbers() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("scenarios.parquet");
    write(&input, (0..5).map(scenario));
    let mut kept = Vec::new();
    for jobs in ["1", "3", "600"] {
        let out = home.path().join(jobs);
        let output = reactsim(&[
            "run",
            text(&input),
            "--models",
            "stop,constant-velocity",
            "--rollouts",
            "2",
            "--jobs",
            jobs,
            "--batch",
            "2",
            "--out",
            text(&out),
            "--keep-rollouts",
        ]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert!(!out.join("parts").exists());
        kept.push(out.join("rollouts.parquet"));
    }
    // Far more threads than there is work for change nothing.
    for other in &kept[1..] {
        assert!(fs::read(&kept[0]).unwrap() == fs::read(other).unwrap());
    }
    let output = reactsim(&["score", text(&kept[0]), "--scenarios", text(&input), "--format", "json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let scored: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let run: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(home.path().join("1/summary.json")).unwrap()).unwrap();
    for simulator in ["stop", "constant-velocity"] {
        assert_eq!(scored["simulators"][simulator]["metrics"], run["simulators"][simulator]["metrics"]);
    }
    assert_eq!(scored["deviation"], run["deviation"]);
    let svg = home.path().join("x.svg");
    let drawn = reactsim(&[
        "inspect",
        text(&input),
        "--id",
        "road-003",
        "--rollout",
        text(&home.path().join("1")),
        "--simulator",
        "stop",
        "--index",
        "1",
        "--steps",
        "0,40,80",
        "--svg",
        text(&svg),
    ]);
    assert_eq!(drawn.status.code(), Some(0), "{}", stderr(&drawn));
    assert!(fs::read_to_string(&svg).unwrap().contains("</svg>"));
    assert!(stdout(&drawn).contains("3 around the AV: 3 vehicles"), "{}", stdout(&drawn));
    let resumed = reactsim(&[
        "run",
        text(&input),
        "--models",
        "stop,constant-velocity",
        "--rollouts",
        "2",
        "--out",
        text(&home.path().join("3")),
        "--keep-rollouts",
        "--resume",
    ]);
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    // Far more threads than there is work for change nothing.
    for other in &kept[1..] {
        assert!(fs::read(&kept[0]).unwrap() == fs::read(other).unwrap());
    }
}

#[test]
fn results_come_in_every_form() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("scenarios.parquet"), home.path().join("x_1"));
    write(&input, (0..3).map(scenario));
    let run = reactsim(&["run", text(&input), "--models", "log-replay,stop", "--out", text(&out)]);
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let report = |format: &str| {
        let output = reactsim(&["report", text(&out), "--format", format]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        output.stdout
    };
    assert!(report("markdown") == run.stdout);
    assert!(report("json") == fs::read(out.join("summary.json")).unwrap());
    assert!(report("parquet").starts_with(b"PAR1"));
    let latex = String::from_utf8(report("latex")).unwrap();
    assert!(latex.contains("Log Replay$^\\dagger$ & ") && latex.contains("\\bottomrule"));
    let csv = String::from_utf8(report("csv")).unwrap();
    assert_eq!(
        csv.lines().next().unwrap(),
        "run,simulator,oracle,kind,category,difficulty,metric,mean,low,high,scenarios"
    );
    assert!(csv.contains("x_1,stop,false,difference,,,ade,"));
    // Two runs in one table are told apart by their names.
    let two = reactsim(&["report", text(&out), text(&out)]);
    assert!(stdout(&two).contains("| Run "));
}

#[test]
fn tables_have_difficulties_and_further_metrics_on_request() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("scenarios.parquet"), home.path().join("x"));
    write(&input, (0..3).map(certified));
    let run = reactsim(&[
        "run",
        text(&input),
        "--models",
        "log-replay,stop",
        "--out",
        text(&out),
        "--keep-rollouts",
        "--also",
        "log-clinging,progress",
    ]);
    assert_eq!(run.status.code(), Some(0), "{}", stderr(&run));
    let table = stdout(&run);
    let at = |wanted: &str| table.find(wanted).unwrap_or_else(|| panic!("no `{wanted}` in {table}"));
    assert!(at("\nDirectional deviations (1 scenario):") < at("\nEasy conflicts (1 scenario):"));
    assert!(at("\nEasy conflicts") < at("\nMedium conflicts") && at("\nMedium") < at("\nHard conflicts"));
    let head = table.lines().next().unwrap();
    assert!(head.contains(" Way lost (m) ↓ ") && head.trim_end_matches([' ', '|']).ends_with("On log (%) ↓"));
    // What the table has anyway is not repeated.
    assert_eq!(head.matches("Progress").count(), 1);
    assert_eq!(fs::read_to_string(out.join("summary.md")).unwrap(), table);
    assert!(fs::read_to_string(out.join("summary.json")).unwrap().contains("\"log-clinging\""));

    let report = |options: &[&str]| stdout(&reactsim(&[&["report", text(&out)], options].concat()));
    assert!(!report(&[]).contains("On log"));
    assert_eq!(report(&["--also", "log-clinging"]), table);
    assert!(report(&["--format", "latex", "--also", "over-braking"]).contains("Over-br."));
    assert!(report(&["--format", "csv"]).contains("x,stop,false,mean,,hard,undisturbed-loss,"));
    let unknown = reactsim(&["report", text(&out), "--also", "log-cling"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(stderr(&unknown).contains("a similar value exists: 'log-clinging'"), "{}", stderr(&unknown));
    let page = reactsim(&["report", text(&out), "--format", "html", "--also", "ade"]);
    assert!(stderr(&page).contains("leave the options of tables out"), "{}", stderr(&page));

    let rollouts = out.join("rollouts.parquet");
    let score = reactsim(&["score", text(&rollouts), "--scenarios", text(&input), "--also", "log-clinging"]);
    let scored = stdout(&score);
    assert!(scored.contains("\nHard conflicts (1 scenario):") && scored.contains("On log (%)"), "{scored}");
}

#[test]
fn a_reader_that_goes_away_is_no_error_but_a_full_disk_is() {
    let mut child = program().args(["list", "metrics"]).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
    let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") else { return };
    let output = program().args(["list", "metrics"]).stdout(full).stderr(Stdio::piped()).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("could not write to stdout"));
}

#[test]
fn conversion_changes_no_number() {
    let home = tempfile::tempdir().unwrap();
    let mini = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
    let native = home.path().join("mini.parquet");
    let output = reactsim(&["convert", mini, "--out", text(&native)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let metrics = |input: &str| {
        let output = reactsim(&["run", input, "--models", "stop", "--format", "json"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (summary["simulators"].clone(), summary["provenance"]["scenarios_blake3"].clone())
    };
    assert_eq!(metrics(mini), metrics(text(&native)));
    // A result never replaces its own source.
    let refused = reactsim(&["convert", text(&native), "--out", text(&native)]);
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn rollout_documents_are_scored() {
    let home = tempfile::tempdir().unwrap();
    let document = home.path().join("document.json");
    let steady = |x: f64| (0..91).map(|f| x + 0.5 * f64::from(f)).collect::<Vec<_>>();
    let agent = |id: &str, x: f64| {
        serde_json::json!({
            "id": id, "type": "vehicle", "length": 4.5, "width": 2.0, "x": steady(x), "y": vec![0.0; 91],
            "heading": vec![0.0; 91], "vx": null, "vy": null, "valid": vec![true; 91]
        })
    };
    // The agent drives half a metre behind the AV's bumper into nothing, and is risky to nobody at the same
    // speed.
    let scenario = serde_json::json!({
        "id": "pair", "current_index": 10, "num_future": 80, "av_index": 0, "map": {},
        "agents": [agent("av", 5.0), agent("follower", 0.0)]
    });
    let text_of = |format: &str| {
        serde_json::json!({ "format": format, "dt": 0.1, "scenarios": [scenario] }).to_string()
    };
    fs::write(&document, text_of("reactsim-rollouts-v1")).unwrap();
    let output = reactsim(&["score", text(&document)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["aggregate"]["a_av_collision_count"], 0.0);
    assert_eq!(result["aggregate"]["a_a_collision_rate"], 0.0);
    assert!(result["aggregate"]["offroad_rate"].is_null(), "no drivable area, nothing judged");
    fs::write(&document, text_of("reactsim-rollouts-v9")).unwrap();
    let output = reactsim(&["score", text(&document)]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("reactsim-rollouts-v9"), "{}", stderr(&output));
    let rows = home.path().join("rows.parquet");
    write(&rows, [crate::generated::scenario(0)]);
    assert!(stderr(&reactsim(&["score", text(&rows)])).contains("give --scenarios"));
}

#[test]
fn deviations_from_a_file_are_those_that_scenarios_carry() {
    let home = tempfile::tempdir().unwrap();
    let (carried, plain) = (home.path().join("carried.parquet"), home.path().join("plain.parquet"));
    write(&carried, (0..3).map(scenario));
    write(&plain, (0..3).map(|i| deviating(i, false)));
    let record = |i: usize| {
        let deviation = scenario(i).deviation.unwrap();
        let each = |of: fn(&reactsim::scene::AgentState) -> f64| -> Vec<f64> {
            deviation.track.iter().map(of).collect()
        };
        serde_json::json!({
            "scenario_id": format!("road-{i:03}"), "category": deviation.category.map(|c| c.name()),
            "x": each(|s| s.x), "y": each(|s| s.y), "heading": each(|s| s.heading)
        })
    };
    let file = home.path().join("deviations.json");
    let put = |records: Vec<serde_json::Value>| {
        let all = serde_json::json!({
            "format": "reactsim-deviations-v1", "frame": "world", "deviations": records
        });
        fs::write(&file, all.to_string()).unwrap();
    };
    let simulators = |output: &Output| {
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        summary["simulators"].clone()
    };
    let common = ["--models", "log-replay,stop", "--format", "json"];
    let wanted = reactsim(&[&["run", text(&carried)], &common[..]].concat());
    assert_eq!(wanted.status.code(), Some(0), "{}", stderr(&wanted));
    put((0..3).map(record).collect());
    let named = format!("file:{}", text(&file));
    for choice in [["--deviations", text(&file)], ["--av", &named]] {
        let output = reactsim(&[&["run", text(&plain)], &common[..], &choice].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert_eq!(simulators(&output), simulators(&wanted));
    }
    // One scenario without a trajectory, one with a trajectory that was made for another version of it.
    let mut foreign = record(1);
    foreign["scenario_digest"] = "0".repeat(64).into();
    put(vec![record(0), foreign]);
    let output = reactsim(&[&["run", text(&plain), "--deviations", text(&file)], &common[..]].concat());
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("`road-001`: the deviated AV was made for a scenario with the digest 000")
    );
    assert!(stderr(&output).contains("1 scenario passed over: no deviated AV in the file of deviations"));
    assert_eq!(simulators(&output)["stop"]["scenarios"], 1);
}

#[test]
fn scenarios_without_a_deviation_in_the_file_are_passed_over() {
    let home = tempfile::tempdir().unwrap();
    let (plain, file) = (home.path().join("plain.parquet"), home.path().join("d.json"));
    write(&plain, (0..4).map(|i| deviating(i, false)));
    let record = |i: usize| {
        let track = scenario(i).deviation.unwrap().track;
        let each = |of: fn(&reactsim::scene::AgentState) -> f64| track.iter().map(of).collect::<Vec<_>>();
        let id = format!("road-{i:03}");
        serde_json::json!({
            "scenario_id": id, "x": each(|s| s.x), "y": each(|s| s.y), "heading": each(|s| s.heading)
        })
    };
    let all = [record(0), record(2), record(7)];
    let document = serde_json::json!({
        "format": "reactsim-deviations-v1", "frame": "scenario", "deviations": all
    });
    fs::write(&file, document.to_string()).unwrap();
    let out = home.path().join("run");
    let arguments =
        ["run", text(&plain), "--deviations", text(&file), "--models", "stop", "--out", text(&out)];
    let output = reactsim(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    insta::assert_snapshot!(stderr(&output), @r"
    2 scenarios passed over: no deviated AV in the file of deviations
    warning: 1 deviation not used: for scenarios that are not among those that were read
    ");
    // What lies beyond the limit is not unknown.
    let limited =
        reactsim(&["run", text(&plain), "--deviations", text(&file), "--models", "stop", "--limit", "1"]);
    assert_eq!(limited.status.code(), Some(0), "{}", stderr(&limited));
    insta::assert_snapshot!(stderr(&limited), @"warning: 2 deviations not used: for scenarios that are not among those that were read");
    assert!(stdout(&output).contains("2 scenarios, 2 passed over, "), "{}", stdout(&output));
    let wanted = results(&out);
    let summary: serde_json::Value = serde_json::from_slice(&wanted[0]).unwrap();
    let counts = |key: &str| summary["provenance"][key].as_u64().unwrap();
    assert_eq!((counts("scenarios"), counts("passed_over"), counts("unused_deviations")), (2, 2, 1));
    // A run that is resumed, from anywhere, counts the same.
    for rows in [2, 0] {
        let text: String = String::from_utf8(wanted[1].clone()).unwrap();
        let kept: String = text.lines().take(rows).map(|l| format!("{l}\n")).collect();
        fs::write(out.join("rows.jsonl"), kept).unwrap();
        let output = reactsim(&[&arguments[..], &["--resume"]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert_eq!(results(&out), wanted);
    }
    // Where none is left there is nothing to be shown, and it is said why.
    fs::write(&file, document.to_string().replace("road-00", "street-")).unwrap();
    let output = reactsim(&["run", text(&plain), "--deviations", text(&file)]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(stderr(&output), @r"
    4 scenarios passed over: no deviated AV in the file of deviations
    warning: 3 deviations not used: for scenarios that are not among those that were read
    error: no scenario could be run: see the warnings above
    ");
}

#[test]
fn with_a_file_of_deviations_those_that_scenarios_carry_do_not_count() {
    let home = tempfile::tempdir().unwrap();
    let (carried, file) = (home.path().join("carried.parquet"), home.path().join("d.json"));
    write(&carried, (0..3).map(scenario));
    let track = scenario(1).deviation.unwrap().track;
    let each = |of: fn(&reactsim::scene::AgentState) -> f64| track.iter().map(of).collect::<Vec<_>>();
    let document = serde_json::json!({
        "format": "reactsim-deviations-v1", "frame": "scenario", "deviations": [{
            "scenario_id": "road-001", "x": each(|s| s.x), "y": each(|s| s.y), "heading": each(|s| s.heading)
        }]
    });
    fs::write(&file, document.to_string()).unwrap();
    let output = reactsim(&["run", text(&carried), "--deviations", text(&file), "--models", "stop"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    insta::assert_snapshot!(stderr(&output), @"2 scenarios passed over: no deviated AV in the file of deviations");
    assert!(stdout(&output).contains("1 scenario, 2 passed over, "), "{}", stdout(&output));
}

#[test]
fn shells_and_man_know_every_command() {
    let home = tempfile::tempdir().unwrap();
    let (script, _) = crate::reference::said(&["completions", "bash"], 0);
    crate::reference::said(&["man", "--out", home.path().to_str().unwrap()], 0);
    for command in ["run", "curate", "study", "inspect", "verify"] {
        assert!(script.contains(command), "{command}");
        let page = home.path().join(format!("reactsim-{command}.1"));
        assert!(std::fs::read_to_string(page).unwrap().contains(".SH"), "{command}");
    }
}

#[test]
fn scenarios_are_selected_by_id_and_category() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("run");
    let run = |more: &[&str]| reactsim(&[&["run", "--models", "stop", "--quiet"], more].concat());
    let (one, other) = ("bench-2-000002", "bench-2-000012");
    let output = run(&["--id", one, "--id", other, "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stdout(&output).contains("2 scenarios, 148 not selected, "), "{}", stdout(&output));
    // Positions are those in the whole file, so that the page finds the scenarios.
    let rows = fs::read_to_string(out.join("rows.jsonl")).unwrap();
    let records: std::collections::BTreeSet<usize> = rows
        .lines()
        .map(|line| serde_json::from_str::<reactsim::evaluation::Row>(line).unwrap().record)
        .collect();
    let listed = stdout(&reactsim(&["list", "scenarios"]));
    let position = |id: &str| listed.lines().position(|line| line.starts_with(id)).unwrap() - 1;
    assert_eq!(records, [position(one), position(other)].into());
    assert_eq!(listed.lines().count(), 151);
    // A resumed run with another selection is another run.
    let output = run(&["--id", one, "--out", text(&out), "--resume"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("selection"), "{}", stderr(&output));

    let lateral = stdout(&reactsim(&["list", "scenarios", "--category", "lateral"]));
    assert!(lateral.lines().skip(1).all(|line| line.contains(" lateral ")), "{lateral}");
    let output = run(&["--category", "lateral"]);
    let expected = format!("{} scenarios, ", lateral.lines().count() - 1);
    assert!(stdout(&output).contains(&expected), "{expected}: {}", stdout(&output));

    let output = run(&["--id", "bench-2-2"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(stderr(&output), @r"
    warning: no scenario has the id `bench-2-2`
    error: no scenario could be run: see the warnings above
    ");
}

#[test]
fn converted_files_have_the_selected_scenarios() {
    let home = tempfile::tempdir().unwrap();
    let (all, some) = (home.path().join("all.parquet"), home.path().join("some.parquet"));
    write(&all, (0..3).map(scenario));
    let convert = |more: &[&str]| reactsim(&[&["convert", text(&all), "--out", text(&some)], more].concat());
    let output = convert(&["--id", "road-001"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let ids: Vec<String> = reactsim::formats::open(&some).unwrap().map(|s| s.unwrap().id).collect();
    assert_eq!(ids, ["road-001"]);
    let output = convert(&["--id", "road-009"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(
        stderr(&output),
        @"error: no scenario is selected: leave out --id, --category or --futures"
    );
    let output = reactsim(&["inspect", text(&all), "--id", "road-01"]);
    let said = stderr(&output);
    assert!(said.contains("holds no scenario `road-01`; did you mean `road-001`?"), "{said}");
}

#[test]
fn misspelt_names_are_answered_with_the_most_similar_one() {
    let meant = |arguments: &[&str], expected: &str| {
        let output = reactsim(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
    };
    meant(&["run", "--models", "imd"], "did you mean `idm`?");
    meant(
        &["run", "--models", "idm", "--set", "idm.vehicle.headwy=2"],
        "did you mean `idm.vehicle.headway`?",
    );
    meant(&["run", "--metric-option", "faul_order=nuplan"], "did you mean `fault_order`?");
    meant(&["list", "parameters", "ntp_reactive"], "did you mean `ntp-reactive`?");
    meant(&["inspect", "--case", "turn-acros"], "did you mean `turn-across`?");
    meant(&["compare", "a", "b", "--worse", "aav-colision=1"], "did you mean `aav-collision`?");
    meant(&["compare", "a", "b"], "hint: `reactsim run --out FOLDER` writes a run folder");
}
