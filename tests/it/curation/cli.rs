//! The command `curate` as its user sees it.

use std::fs;
use std::path::Path;
use std::time::Duration;

use reactsim::curation::{Decision, store};
use reactsim::scene::{Agent, AgentKind, AgentState, FRAMES, LoggedAgent, Scenario, ScenarioParts};

use super::hand::{scenario, write};
use crate::program::{MINI, ended, program, refused, result, said, signalled, stderr, text, words};
use crate::small_scenarios::{deviating, parts, write as write_scenarios};
use reactsim_test_support::proto::{self, Proto};

#[test]
fn wrong_input_names_the_mend_and_exits_with_2() {
    let home = tempfile::tempdir().unwrap();
    let scenarios = home.path().join("s.parquet");
    write_scenarios(&scenarios, (0..2).map(|i| deviating(i, false)));
    let out = home.path().join("c.parquet");
    let error =
        |arguments: &[&str]| refused(&[&["curate"], arguments].concat()).replace(text(home.path()), "HOME");
    let make = |more: &[&str]| error(&[&[text(&scenarios), "--out", text(&out)], more].concat());
    assert!(error(&[]).contains("--out <FILE>"));
    assert!(error(&[text(&scenarios)]).contains("--out <FILE>"));
    let sources = "`dice` is not a source: choose rules, diffusion, diffusion:FILE or file:PATH";
    for (options, part) in [
        ("--source dice", sources),
        ("--source file:", "write file:PATH"),
        ("--source diffusion:", "write diffusion:FILE"),
        ("--source diffusion:none", "could not read none"),
        ("--temperature 2", "give it with --source diffusion"),
        ("--candidates 0", "1..=1000"),
        ("--radius -3", "--radius"),
        ("--radius=0", "expected a number above 0"),
        ("--min-ade=nan", "expected 0 or a larger number"),
        ("--jobs 0", "1..=1024"),
    ] {
        let error = make(&words(options));
        assert!(error.contains(part), "{options}: {error}");
    }
    let weights = home.path().join("w.safetensors");
    fs::write(&weights, crate::vbd::untrained()).unwrap();
    let foreign = make(&["--source", &format!("diffusion:{}", text(&weights))]);
    assert!(foreign.contains("w.safetensors cannot be used") && foreign.contains("kind `vbd`"), "{foreign}");
    insta::assert_snapshot!(error(&["absent", "--out", text(&out)]), @"error: absent: could not read: No such file or directory (os error 2)");
    insta::assert_snapshot!(error(&[text(&scenarios), "--out", text(home.path())]), @"error: HOME: could not create: is a directory");
    insta::assert_snapshot!(error(&[text(&scenarios), "--out", text(&home.path().join("no/c.parquet"))]), @"error: HOME/no/c.parquet: could not create: No such file or directory (os error 2)");
    assert!(!out.exists());
    for verb in ["stats", "review", "apply"] {
        let more: &[&str] = if verb == "apply" { &["d.jsonl", "--out", "HOME/x"] } else { &[] };
        let absent = error(&[&[verb, "absent.parquet"], more].concat());
        assert!(absent.contains("error: absent.parquet: could not read"), "{absent}");
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
        let inputs = ["curate", text(&input), text(&again), text(&broken), "--out", text(&out)];
        let limits = ["--jobs", jobs, "--candidates", "5", "--min-vehicles", "1", "--max-ttc", "100"];
        let (printed, warnings) = said(&[&inputs[..], &limits].concat(), 1);
        assert!(printed.contains("| Read ") && printed.contains("| Directional "), "{printed}");
        let twice = "t.parquet: record 0: scenario `road-039`: an earlier one has this id";
        assert!(warnings.contains(twice), "{warnings}");
        assert!(warnings.contains("warning: 2 failed; the others are in the file"), "{warnings}");
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
    let written = serde_json::to_string(&provenance).unwrap();
    assert!(!written.contains(text(home.path())), "paths are nobody else's concern: {written}");
    let dropped: u64 = provenance.funnel.preselection.values().sum();
    assert_eq!(provenance.funnel.preselected + dropped, 42);
    assert!(opened.count() > 0, "nothing has candidates: {:?}", provenance.funnel);
    // If nothing can be read, nothing is written.
    let none = home.path().join("none.parquet");
    let error = refused(&["curate", text(&broken), "--out", text(&none)]);
    assert!(error.contains("error: no scenario could be read") && !none.exists(), "{error}");
    said(&["curate", text(&input), "--limit", "2", "--out", text(&none)], 0);
    assert_eq!(store::read(&none).unwrap().provenance().funnel.scenarios, 2);
}

#[test]
fn figures_are_printed() {
    let home = tempfile::tempdir().unwrap();
    let file = home.path().join("c.parquet");
    write(&file, &["a", "b", "c"].map(|id| scenario(id, 4)));
    let (output, _) = said(&["curate", "stats", text(&file)], 0);
    assert!(output.contains("Certificates: 3 of 3 chosen candidates"), "{output}");
    let figures = result(&["curate", "stats", text(&file)]);
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
    let apply = |more: &[&str], code| {
        let begin = ["curate", "apply", text(&file), "--out", text(&out)];
        said(&[&begin, more].concat(), code).1.replace(text(home.path()), "HOME")
    };
    assert!(apply(&[], 2).contains("<DECISIONS>..."));
    assert!(apply(&both, 2).contains("could not read the decisions in HOME/ana.jsonl"));
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
    insta::assert_snapshot!(apply(&both, 0), @r"
    0 picked, 1 dropped, 0 only marked
    warning: 1 pick not applied: rejected by a filter, such as candidate 2 of scenario `a` by `pressure`; give --allow-rejected to accept them
    warning: 2 decisions not applied: the scenario is not in the file, or its content differs
    HOME/d.parquet: 3 of 4 scenarios chosen
    ");
    insta::assert_snapshot!(apply(&[&both[..], &["--allow-rejected"]].concat(), 0), @r"
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
    assert!(apply(&both, 2).contains("ben.jsonl, line 1") && !out.exists());
}

#[cfg(unix)]
#[test]
fn interrupted_it_keeps_what_is_finished() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("s.parquet"), home.path().join("c.parquet"));
    write_scenarios(&input, (0..4000).map(|i| deviating(i, false)));
    let small = home.path().join("small.parquet");
    write_scenarios(&small, (0..2).map(|i| deviating(i, false)));
    ended(&["curate", text(&small), "--out", text(&out), "--min-vehicles", "0"], 0);
    let whole: Vec<_> = store::read(&out).unwrap().map(|r| r.unwrap()).collect();
    let mut command = program();
    command.args(["curate", text(&input), "--out", text(&out), "--jobs", "1", "--min-vehicles", "0"]);
    // Interrupts are handled before the unfinished file exists.
    let begun = || {
        let is_there = fs::read_dir(home.path()).unwrap().count() > 3;
        // Some scenarios are to be finished.
        std::thread::sleep(Duration::from_millis(if is_there { 60 } else { 0 }));
        is_there
    };
    let output = signalled(&mut command, "-INT", begun);
    let said = stderr(&output);
    if output.status.success() {
        return crate::skipped("it was done before it was interrupted");
    }
    assert_eq!(output.status.code(), Some(130), "{said}");
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
    let (_, said) = said(&["curate", text(&input), "--out", text(&out)], 1);
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
    ended(&[&["curate", text(&logs), "--out", text(&out)], &curate[..]].concat(), 0);
    assert_eq!(store::read(&out).unwrap().provenance().settings["all-agents"], "true");
    let run = ["--models", "log-replay,stop", "--deviations", text(&out)];
    let all = result(&[&["run", text(&logs), "--all-agents"], &run[..]].concat());
    let few = refused(&[&["run", text(&logs)], &run[..]].concat());
    assert!(few.contains("same keys: `all-agents`, `current-frame`, `history`, `future`"), "{few}");
    // A converted file keeps its agents, so that no option is needed.
    ended(&["convert", text(&logs), "--all-agents", "--out", text(&converted)], 0);
    let native = result(&[&["run", text(&converted)], &run[..]].concat());
    assert_eq!(native["simulators"], all["simulators"]);
    let avs = path("avs.json");
    let rest = ["--deviations", text(&out), "--all-agents", "--out", text(&avs)];
    ended(&[&["export", "av", text(&logs)], &rest[..]].concat(), 0);
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
    let foreign = "is `reactsim-scenarios`, expected `reactsim-deviations`";
    for (name, expected) in [("half", ""), ("s", foreign)] {
        let file = path(&format!("{name}.parquet"));
        for verb in [
            &["curate", "stats", text(&file)][..],
            &["curate", "review", text(&file)],
            &["curate", "apply", text(&file), "d.jsonl", "--out", text(&out)],
            &["run", text(&scenarios), "--models", "stop", "--deviations", text(&file)],
        ] {
            let said = refused(verb);
            assert!(said.starts_with("error: ") && said.contains(text(&file)), "{verb:?}: {said}");
            assert!(said.contains(expected), "{verb:?}: {said}");
            assert!(!out.exists());
        }
    }
}

#[test]
fn the_shipped_planner_proposes_the_same_on_any_number_of_threads() {
    let home = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for jobs in ["1", "2"] {
        let out = home.path().join(format!("c{jobs}.parquet"));
        let source = ["--source", "diffusion", "--candidates", "4", "--min-vehicles", "1"];
        ended(&[&["curate", MINI, "--out", text(&out), "--jobs", jobs], &source[..]].concat(), 0);
        files.push(fs::read(&out).unwrap());
    }
    assert!(files[0] == files[1], "the number of threads changes bytes");
    let opened = store::read(home.path().join("c1.parquet")).unwrap();
    assert_eq!(opened.provenance().settings["source"], "diffusion:diffusion-planner.safetensors");
    assert!(opened.provenance().funnel.candidates > 0);
}
