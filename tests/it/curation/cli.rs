//! The command `curate` as its user sees it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use reactsim::curation::{Decision, store};
use reactsim::scene::{Agent, AgentKind, AgentState, FRAMES, LoggedAgent, Scenario, ScenarioParts};

use super::hand::{scenario, write};
use crate::program::{program, reactsim};
use crate::small_scenarios::{deviating, parts, write as write_scenarios};
use reactsim_test_support::proto::{self, Proto};

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn wrong_input_names_the_mend_and_exits_with_2() {
    let home = tempfile::tempdir().unwrap();
    let scenarios = home.path().join("s.parquet");
    write_scenarios(&scenarios, (0..2).map(|i| deviating(i, false)));
    let out = home.path().join("c.parquet");
    let error = |arguments: &[&str]| {
        let output = reactsim(&[&["curate"], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
        stderr(&output).replace(text(home.path()), "HOME")
    };
    let make = |more: &[&str]| error(&[&[text(&scenarios), "--out", text(&out)], more].concat());
    assert!(error(&[]).contains("--out <FILE>"));
    assert!(error(&[text(&scenarios)]).contains("--out <FILE>"));
    assert!(
        make(&["--source", "dice"])
            .contains("`dice` is not a source: choose rules, diffusion, diffusion:FILE or file:PATH")
    );
    assert!(make(&["--source", "file:"]).contains("write file:PATH"));
    assert!(make(&["--source", "diffusion:"]).contains("write diffusion:FILE"));
    assert!(make(&["--source", "diffusion:none"]).contains("could not read none"));
    assert!(make(&["--temperature", "2"]).contains("give it with --source diffusion"));
    let weights = home.path().join("w.safetensors");
    std::fs::write(&weights, crate::vbd::untrained()).unwrap();
    let foreign = make(&["--source", &format!("diffusion:{}", text(&weights))]);
    assert!(foreign.contains("w.safetensors cannot be used") && foreign.contains("kind `vbd`"), "{foreign}");
    assert!(make(&["--candidates", "0"]).contains("1..=1000"));
    assert!(make(&["--radius", "-3"]).contains("--radius"));
    assert!(make(&["--radius=0"]).contains("expected a number above 0"));
    assert!(make(&["--min-ade=nan"]).contains("expected 0 or a larger number"));
    assert!(make(&["--jobs", "0"]).contains("1..=1024"));
    insta::assert_snapshot!(error(&["absent", "--out", text(&out)]), @"error: absent: could not read: No such file or directory (os error 2)");
    insta::assert_snapshot!(error(&[text(&scenarios), "--out", text(home.path())]), @"error: HOME: could not create: is a directory");
    insta::assert_snapshot!(error(&[text(&scenarios), "--out", text(&home.path().join("no/c.parquet"))]), @"error: HOME/no/c.parquet: could not create: No such file or directory (os error 2)");
    insta::assert_snapshot!(error(&[text(&scenarios), "--out", text(&scenarios)]), @"error: HOME/s.parquet is both input and output; choose another --out");
    assert!(!out.exists());
    for verb in ["stats", "review", "apply"] {
        let more: &[&str] = if verb == "apply" { &["d.jsonl", "--out", "HOME/x"] } else { &[] };
        let absent = error(&[&[verb, "absent.parquet"], more].concat());
        assert!(absent.contains("error: absent.parquet: could not read"), "{absent}");
        let foreign = error(&[&[verb, text(&scenarios)], more].concat());
        assert!(
            foreign.contains("s.parquet: `reactsim.format` in the file's metadata is `reactsim-scenarios`, expected `reactsim-deviations`"),
            "{foreign}"
        );
    }
}

/// Returns a scenario in which the AV comes closer to the vehicle ahead.
pub(super) fn closing(i: usize) -> Scenario {
    Scenario::assemble(closing_parts(i)).unwrap()
}

fn closing_parts(i: usize) -> ScenarioParts {
    let mut parts = parts(i, false);
    for (f, frame) in parts.agents[2].track.iter_mut().enumerate() {
        let state = frame.as_mut().unwrap();
        (state.x, state.vx) = (state.x - 0.2 * (f as f64 - 10.0), state.vx - 2.0);
    }
    parts
}

#[test]
fn help_fits_a_terminal() {
    for verb in [
        &["curate", "--help"][..],
        &["curate", "stats", "--help"],
        &["curate", "apply", "--help"],
        &["curate", "review", "--help"],
    ] {
        let help = stdout(&reactsim(verb));
        assert!(help.contains("Usage: reactsim curate"), "{help}");
        assert!(help.lines().all(|l| l.chars().count() < 100), "{help}");
    }
}

#[test]
fn scenarios_become_a_file_of_candidates() {
    let home = tempfile::tempdir().unwrap();
    let (input, again) = (home.path().join("s.parquet"), home.path().join("t.parquet"));
    write_scenarios(&input, (0..40).map(closing));
    // One of them a second time, and a file that is not a scenario.
    write_scenarios(&again, (39..42).map(closing));
    let broken = home.path().join("u.json");
    fs::write(&broken, r#"{"format": "reactsim-scenario-v1"}"#).unwrap();
    let mut files = Vec::new();
    for jobs in ["1", "3"] {
        let out = home.path().join(format!("c{jobs}.parquet"));
        let output = reactsim(&[
            "curate",
            text(&input),
            text(&again),
            text(&broken),
            "--out",
            text(&out),
            "--jobs",
            jobs,
            "--candidates",
            "5",
            "--min-vehicles",
            "1",
            "--max-ttc",
            "100",
        ]);
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
        let printed = stdout(&output);
        assert!(printed.contains("| Read ") && printed.contains("| Directional "), "{printed}");
        assert!(
            stderr(&output).contains("t.parquet: record 0: scenario `road-039`: an earlier one has this id")
        );
        assert!(stderr(&output).contains("warning: 2 failed; the others are in the file"));
        files.push(fs::read(&out).unwrap());
    }
    assert!(files[0] == files[1], "the number of threads changes bytes");
    let out = home.path().join("c1.parquet");
    let opened = store::read(&out).unwrap();
    let provenance = opened.provenance().clone();
    assert_eq!((provenance.funnel.scenarios, provenance.failures.len()), (42, 2));
    assert_eq!(provenance.inputs.len(), 3);
    assert_eq!(provenance.settings["source"], "rules");
    assert_eq!(provenance.settings["candidates"], "5");
    let said = serde_json::to_string(&provenance).unwrap();
    assert!(!said.contains(text(home.path())), "paths are nobody else's concern: {said}");
    let dropped: u64 = provenance.funnel.preselection.values().sum();
    assert_eq!(provenance.funnel.preselected + dropped, 42);
    assert!(opened.count() > 0, "nothing has candidates: {:?}", provenance.funnel);
    // If nothing can be read, nothing is written.
    let none = home.path().join("none.parquet");
    let output = reactsim(&["curate", text(&broken), "--out", text(&none)]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("error: no scenario could be read"));
    assert!(!none.exists());
    let limited = reactsim(&["curate", text(&input), "--limit", "2", "--out", text(&none)]);
    assert_eq!(limited.status.code(), Some(0), "{}", stderr(&limited));
    assert_eq!(store::read(&none).unwrap().provenance().funnel.scenarios, 2);
}

#[test]
fn figures_are_printed() {
    let home = tempfile::tempdir().unwrap();
    let file = home.path().join("c.parquet");
    write(&file, &["a", "b", "c"].map(|id| scenario(id, 4)));
    let output = reactsim(&["curate", "stats", text(&file)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stdout(&output).contains("Certificates: 3 of 3 chosen candidates"), "{}", stdout(&output));
    let output = reactsim(&["curate", "stats", text(&file), "--format", "json"]);
    let figures: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for key in ["funnel", "categories", "difficulties", "overall", "agreement", "certificates"] {
        assert!(figures[key].is_object(), "{key}: {figures}");
    }
    assert_eq!((figures["chosen"].as_u64(), figures["overall"]["ade"]["n"].as_u64()), (Some(3), Some(3)));
}

#[test]
fn decisions_go_into_a_new_file() {
    let home = tempfile::tempdir().unwrap();
    let (file, out) = (home.path().join("c.parquet"), home.path().join("d.parquet"));
    let records = ["a", "b", "c", "d"].map(|id| scenario(id, 4));
    write(&file, &records);
    let (own, theirs) = (home.path().join("ana.jsonl"), home.path().join("ben.jsonl"));
    let both = [text(&own), text(&theirs)];
    let apply = |more: &[&str]| {
        let output = reactsim(&[&["curate", "apply", text(&file), "--out", text(&out)], more].concat());
        (output.status.code(), stderr(&output).replace(text(home.path()), "HOME"))
    };
    assert!(apply(&[]).1.contains("<DECISIONS>..."));
    assert!(apply(&both).1.contains("could not read the decisions in HOME/ana.jsonl"));
    assert!(!out.exists());
    let line = |id: &str, digest: &str, candidate: &str, decision: &str, reviewer: &str, minute: u32| {
        format!(
            r#"{{"scenario_id":"{id}","scenario_digest":"{digest}","candidate":{candidate},"decision":"{decision}","reviewer":"{reviewer}","at":"2026-01-01T12:{minute:02}:00.000Z"}}"#
        ) + "\n"
    };
    let digest = |i: usize| records[i].scenario_digest.as_str();
    let lines = [
        line("a", digest(0), "3", "pick", "ana", 1),
        line("b", digest(1), "1", "reject", "ana", 2),
        line("b", digest(1), "null", "clear", "ana", 3),
        line("c", digest(2), "1", "reject", "ana", 4),
        line("d", "0000", "1", "reject", "ana", 5),
        line("e", "0000", "1", "reject", "ana", 5),
    ];
    fs::write(&theirs, line("a", digest(0), "2", "pick", "ben", 9)).unwrap();
    fs::write(&own, lines.concat()).unwrap();
    let (code, said) = apply(&both);
    assert_eq!(code, Some(0), "{said}");
    insta::assert_snapshot!(said, @r"
    0 picked, 1 dropped, 0 only marked
    warning: 1 pick not applied: rejected by a filter, such as candidate 2 of scenario `a` by `pressure`; give --allow-rejected to accept them
    warning: 2 decisions not applied: the scenario is not in the file, or its content differs
    HOME/d.parquet: 3 of 4 scenarios chosen
    ");
    let (code, said) = apply(&[&both[..], &["--allow-rejected"]].concat());
    assert_eq!(code, Some(0), "{said}");
    insta::assert_snapshot!(said, @r"
    1 picked, 1 dropped, 0 only marked
    warning: 1 candidate picked despite rejection by a filter
    warning: 2 decisions not applied: the scenario is not in the file, or its content differs
    HOME/d.parquet: 3 of 4 scenarios chosen
    ");
    let opened = store::read(&out).unwrap();
    let applied = opened.provenance().applied[0].clone();
    assert_eq!((applied.version.as_str(), applied.reviews.len()), (env!("CARGO_PKG_VERSION"), 2));
    let digest_of = |path: &Path| blake3::hash(&fs::read(path).unwrap()).to_hex().to_string();
    assert_eq!((applied.file.name.as_str(), &applied.file.digest), ("c.parquet", &digest_of(&file)));
    assert_eq!(applied.reviews[1].digest, digest_of(&theirs));
    assert_eq!(opened.provenance().funnel.chosen, 3);
    let written: Vec<_> = opened.map(|record| record.unwrap()).collect();
    let chosen: Vec<_> = written.iter().map(|r| r.chosen().map(|c| c.candidate.number)).collect();
    assert_eq!(chosen, [Some(2), Some(1), None, Some(1)]);
    let mark = written[0].chosen().unwrap().review.clone().unwrap();
    assert_eq!((mark.reviewer.as_str(), mark.decision), ("ben", Decision::Pick));
    // A line that is not a decision ends the command before anything is written.
    fs::remove_file(&out).unwrap();
    fs::write(&theirs, "{}\n").unwrap();
    let (code, said) = apply(&both);
    assert!(code == Some(2) && said.contains("ben.jsonl, line 1"), "{said}");
    assert!(!out.exists());
}

#[cfg(unix)]
#[test]
fn interrupted_it_keeps_what_is_finished() {
    use std::io::Read;
    use std::process::Stdio;
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("s.parquet"), home.path().join("c.parquet"));
    write_scenarios(&input, (0..4000).map(|i| deviating(i, false)));
    let small = home.path().join("small.parquet");
    write_scenarios(&small, (0..2).map(|i| deviating(i, false)));
    reactsim(&["curate", text(&small), "--out", text(&out), "--min-vehicles", "0"]);
    let whole: Vec<_> = store::read(&out).unwrap().map(|r| r.unwrap()).collect();
    let mut child = program()
        .args(["curate", text(&input), "--out", text(&out), "--jobs", "1", "--min-vehicles", "0"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Interrupts are handled before the unfinished file exists.
    let begun = || fs::read_dir(home.path()).unwrap().count() > 3;
    while !begun() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    std::thread::sleep(std::time::Duration::from_millis(60));
    let interrupt = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(interrupt.success());
    let status = child.wait().unwrap();
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    if status.code() == Some(0) {
        return crate::skipped("it was done before it was interrupted");
    }
    assert_eq!(status.code(), Some(130), "{said}");
    assert!(said.contains("interrupted: writing what is finished; interrupt again to end at once"), "{said}");
    let part = home.path().join("c.interrupted.parquet");
    let kept = format!("interrupted: {} has the first ", part.display());
    assert!(said.contains(&kept) && said.contains(&format!("{} is unchanged", out.display())), "{said}");
    assert!(store::read(&out).unwrap().map(|r| r.unwrap()).eq(whole), "the old file stays");
    let kept = store::read(&part).unwrap();
    assert!(kept.provenance().interrupted);
    let scenarios = kept.provenance().funnel.scenarios;
    assert!(scenarios < 4000, "{scenarios}");
    let records: Vec<_> = kept.map(|r| r.unwrap()).collect();
    assert!(records.len() as u64 <= scenarios);
}

#[test]
fn a_scenario_of_the_wrong_length_does_not_stop_the_others() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("s.tfrecord"), home.path().join("c.parquet"));
    let made = |id: &str, frames: usize| Proto { id: id.into(), frames, ..Proto::default() };
    fs::write(&input, proto::records(&[made("a", 91), made("short", 90), made("b", 91)])).unwrap();
    let output = reactsim(&["curate", text(&input), "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let said = stderr(&output);
    let expected = "s.tfrecord: record 1: scenario `short`: timestamps_seconds is 90 entries, expected 91";
    assert!(said.contains(&format!("warning: failed: {expected}")), "{said}");
    let file = store::read(&out).unwrap();
    let provenance = file.provenance();
    assert_eq!((provenance.funnel.scenarios, provenance.failures.len()), (2, 1));
    assert!(provenance.failures[0].starts_with(expected), "{:?}", provenance.failures);
}

#[test]
fn deviations_of_all_agents_are_used_with_all_agents() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name);
    let (logs, converted, out) = (path("s.parquet"), path("all.parquet"), path("c.parquet"));
    // A cone next to the road and an object of unknown size, which the benchmark does not simulate.
    let crowded = |i: usize| {
        let mut parts = closing_parts(i);
        for (id, kind, size) in [("cone", AgentKind::Other, 0.5), ("unknown", AgentKind::Vehicle, 0.0)] {
            let agent = Agent { id: id.into(), kind, length: size, width: size };
            let state = AgentState { x: 20.0, y: -8.0, heading: 0.0, vx: 0.0, vy: 0.0 };
            parts.agents.push(LoggedAgent { agent, track: vec![Some(state); FRAMES], heights: Vec::new() });
        }
        Scenario::assemble(parts).unwrap()
    };
    write_scenarios(&logs, (0..6).map(crowded));
    let curate = ["--candidates", "8", "--min-vehicles", "1", "--max-ttc", "100", "--all-agents"];
    let output = reactsim(&[&["curate", text(&logs), "--out", text(&out)], &curate[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(store::read(&out).unwrap().provenance().settings["all-agents"], "true");
    let run = ["--models", "log-replay,stop", "--deviations", text(&out), "--format", "json"];
    let all = reactsim(&[&["run", text(&logs), "--all-agents"], &run[..]].concat());
    assert_eq!(all.status.code(), Some(0), "{}", stderr(&all));
    let few = reactsim(&[&["run", text(&logs)], &run[..]].concat());
    assert_eq!(few.status.code(), Some(2));
    assert!(stderr(&few).contains("read them with the same options: --all-agents"), "{}", stderr(&few));
    // A converted file keeps its agents, so that no option is needed.
    let arguments = ["convert", text(&logs), "--all-agents", "--out", text(&converted)];
    let output = reactsim(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let native = reactsim(&[&["run", text(&converted)], &run[..]].concat());
    assert_eq!(native.status.code(), Some(0), "{}", stderr(&native));
    let simulators = |output: &Output| {
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        summary["simulators"].clone()
    };
    assert_eq!(simulators(&native), simulators(&all));
    let avs = path("avs.json");
    let rest = ["--deviations", text(&out), "--all-agents", "--out", text(&avs)];
    let output = reactsim(&[&["export", "av", text(&logs)], &rest[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

#[test]
fn truncated_and_foreign_files_are_refused_everywhere() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name);
    let (scenarios, sound, out) = (path("s.parquet"), path("sound.parquet"), path("out.parquet"));
    write_scenarios(&scenarios, (0..2).map(|i| deviating(i, false)));
    write(&sound, &["a", "b", "c"].map(|id| scenario(id, 4)));
    let bytes = fs::read(&sound).unwrap();
    fs::write(path("half.parquet"), &bytes[..bytes.len() / 2]).unwrap();
    fs::write(path("short.parquet"), &bytes[..bytes.len() - 1]).unwrap();
    fs::write(path("empty.parquet"), "").unwrap();
    fs::write(path("text.parquet"), "a,b\n1,2\n").unwrap();
    let foreign = "is `reactsim-scenarios`, expected `reactsim-deviations`";
    let files = [("half", ""), ("short", ""), ("empty", ""), ("text", ""), ("s", foreign)];
    for (name, expected) in files {
        let file = path(&format!("{name}.parquet"));
        for verb in [
            &["curate", "stats", text(&file)][..],
            &["curate", "review", text(&file)],
            &["curate", "apply", text(&file), "d.jsonl", "--out", text(&out)],
            &["run", text(&scenarios), "--models", "stop", "--deviations", text(&file)],
        ] {
            let output = reactsim(verb);
            let said = stderr(&output);
            assert_eq!(output.status.code(), Some(2), "{verb:?}: {said}");
            assert!(output.stdout.is_empty(), "{verb:?} printed a result");
            assert!(said.starts_with("error: ") && said.contains(text(&file)), "{verb:?}: {said}");
            assert!(said.contains(expected), "{verb:?}: {said}");
            assert!(!out.exists());
        }
    }
}

#[test]
fn candidates_for_unknown_scenarios_are_told() {
    let home = tempfile::tempdir().unwrap();
    let (scenarios, file) = (home.path().join("s.parquet"), home.path().join("c.parquet"));
    write_scenarios(&scenarios, (0..2).map(|i| deviating(i, true)));
    write(&file, &["a", "b", "c"].map(|id| scenario(id, 4)));
    let output = reactsim(&["run", text(&scenarios), "--models", "stop", "--deviations", text(&file)]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(stderr(&output), @r"
    2 scenarios passed over: no deviated AV in the file of deviations
    warning: 3 deviations not used: for scenarios that are not among those that were read
    error: no scenario could be run: see the warnings above
    ");
    // The id is known, but the scenario is another one.
    write(&file, &["road-000", "b"].map(|id| scenario(id, 4)));
    let output = reactsim(&["run", text(&scenarios), "--models", "stop", "--deviations", text(&file)]);
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    assert!(
        said.contains("scenario `road-000`: the deviated AV was made for a scenario with the digest"),
        "{said}"
    );
}

#[test]
fn the_shipped_planner_proposes_the_same_on_any_number_of_threads() {
    let home = tempfile::tempdir().unwrap();
    let mini = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
    let mut files = Vec::new();
    for jobs in ["1", "2"] {
        let out = home.path().join(format!("c{jobs}.parquet"));
        let source = ["--source", "diffusion", "--candidates", "4", "--min-vehicles", "1"];
        let output =
            reactsim(&[&["curate", mini, "--out", text(&out), "--jobs", jobs], &source[..]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        files.push(fs::read(&out).unwrap());
    }
    assert!(files[0] == files[1], "the number of threads changes bytes");
    let opened = store::read(home.path().join("c1.parquet")).unwrap();
    assert_eq!(opened.provenance().settings["source"], "diffusion:diffusion-planner.safetensors");
    assert!(opened.provenance().funnel.candidates > 0);
}
