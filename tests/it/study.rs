//! Studies: ordinary runs side by side, in one folder that can be resumed.

use std::fs;
use std::path::Path;

use reactsim::evaluation::{
    AvChoice, ExternalPrograms, LogErrors, Member, RunParts, RunSpec, StudyKind, StudyPlan, is_study,
    read_study, read_summary,
};
use serde_json::Value;

use crate::program::{MINI, program, said, signalled, stderr, text, words};
use crate::small_scenarios::{deviating, deviations, scenario, source, write};

/// Returns the members of a study, in order.
fn members(study: &Path) -> Vec<Member> {
    read_study(study).unwrap().members
}

/// Reads the files of all members and of the study itself that must not depend on how it was executed.
fn results(study: &Path) -> Vec<Vec<u8>> {
    let read = |path: std::path::PathBuf| fs::read(&path).unwrap_or_else(|e| panic!("{path:?}: {e}"));
    let mut all: Vec<Vec<u8>> = ["study.json", "study.md"].iter().map(|n| read(study.join(n))).collect();
    for member in members(study) {
        let names =
            ["summary.json", "rows.jsonl", "events.jsonl", "failures.jsonl", "summary.md", "provenance.json"];
        all.extend(names.iter().map(|n| read(study.join(&member.folder).join(n))));
    }
    all
}

/// Checks that a member has the results of `run` with these arguments.
fn is_what_run_makes(study: &Path, member: &str, arguments: &[&str]) {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("run");
    said(&[&["run", MINI, "--out", text(&out)], arguments].concat(), 0);
    for name in ["summary.json", "rows.jsonl", "summary.md"] {
        let same = fs::read(study.join(member).join(name)).unwrap() == fs::read(out.join(name)).unwrap();
        assert!(same, "{name} of {member}");
    }
}

/// Returns the rows of the tables in a text, by cells, including heads.
fn rows(table: &str) -> Vec<Vec<String>> {
    let lines = table.lines().filter(|l| l.starts_with("| "));
    lines.map(|l| l.trim_matches('|').split(" | ").map(|c| c.trim().to_owned()).collect()).collect()
}

/// Returns the mean of a metric as tables show it.
fn shown(member: &Path, simulator: &str, metric: &str) -> String {
    let summary = read_summary(member).unwrap();
    let mean = summary.simulators[simulator].metrics[metric].mean.unwrap();
    match metric {
        "ade" | "min-ade" => format!("{mean:.2}"),
        _ => format!("{mean:.3}"),
    }
}

/// Returns the part of a cell before its half width.
fn mean(cell: &str) -> &str {
    cell.split(' ').next().unwrap()
}

#[test]
fn intervals_are_studied_in_the_realism_protocol_too() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("replan");
    let asked = ["--protocol", "realism", "--models", "idm,stop"];
    let arguments = ["study", "replan", MINI, "--intervals", "5,40", "--out", text(&out)];
    let (table, _) = said(&[&arguments[..], &asked].concat(), 0);
    let study = read_study(&out).unwrap();
    assert!(study.members.iter().all(|m| m.protocol.as_deref() == Some("realism")));
    is_what_run_makes(&out, "steps-40", &[&asked[..], &["--replan", "40steps"]].concat());
    for metric in ["ADE (m)", "minADE (m)", "Kin. Lik."] {
        assert!(table.contains(&format!("{metric} ")), "{metric} is missing:\n{table}");
    }
}

#[test]
fn intervals_are_runs_side_by_side() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("replan");
    let arguments =
        ["study", "replan", MINI, "--models", "idm,stop", "--intervals", "40,5", "--out", text(&out)];
    let (table, told) = said(&arguments, 0);
    assert_eq!(told, "1 of 2: every 5 steps (2 Hz)\n2 of 2: every 40 steps (0.25 Hz)\n");
    assert_eq!(table, fs::read_to_string(out.join("study.md")).unwrap());
    assert!(is_study(&out) && !is_study(&out.join("steps-05")));
    let study = read_study(&out).unwrap();
    assert_eq!(study.kind, StudyKind::Replan);
    let names: Vec<&str> = study.members.iter().map(|m| m.folder.as_str()).collect();
    assert_eq!(names, ["steps-05", "steps-40"]);
    assert_eq!(study.members[1].replan_steps, Some(40));
    is_what_run_makes(&out, "steps-05", &["--models", "idm,stop"]);
    is_what_run_makes(&out, "steps-40", &["--models", "idm,stop", "--replan", "40steps"]);
    let rows = rows(&table);
    assert_eq!(rows[0], ["Method", "5", "40"]);
    for (metric, first) in [("aav-collision", 1), ("aav-ttc", 4)] {
        for (row, id) in rows[first..].iter().zip(["idm", "stop"]) {
            for (cell, member) in row[1..].iter().zip(names.iter()) {
                assert_eq!(mean(cell), shown(&out.join(member), id, metric), "{id} {member}");
            }
        }
    }
    // With a plan every four seconds, agents see the AV too late.
    assert!(
        shown(&out.join("steps-40"), "idm", "aav-collision")
            > shown(&out.join("steps-05"), "idm", "aav-collision")
    );

    // The same numbers as JSON, without another run.
    let before = results(&out);
    let (json, told) = said(&[&arguments[..], &["--resume", "--format", "json"]].concat(), 0);
    assert!(told.lines().count() == 2 && told.lines().all(|l| l.ends_with(": already finished")), "{told}");
    assert!(results(&out) == before);
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&json["study"], &json["members"][1]["replan_steps"]), (&"replan".into(), &40.into()));
    let simulator = &json["members"][1]["simulators"][0];
    let wanted = &read_summary(&out.join("steps-40")).unwrap().simulators["idm"].metrics["aav-ttc"];
    assert_eq!((&simulator["id"], simulator["scenarios"].as_u64()), (&"idm".into(), Some(12)));
    assert_eq!(simulator["metrics"]["aav-ttc"], serde_json::to_value(wanted).unwrap());
    assert_eq!(simulator["metrics"].as_object().unwrap().len(), 2);

    // The tables again, for documents.
    assert_eq!(said(&["report", text(&out)], 0).0, table);
    let latex = |more: &[&str]| said(&[&["report", text(&out), "--format", "latex"], more].concat(), 0).0;
    let usual = latex(&[]);
    assert!(usual.starts_with("\\begin{table}[t]\n  % steps-05: ") && !usual.contains("\\textbf"), "{usual}");
    assert_eq!(usual.matches("\\begin{tabular}{lcc}").count(), 2, "{usual}");
    let bold = latex(&["--bold", "--columns", "ade", "--caption", "Ours & theirs", "--label", "tab:replan"]);
    assert!(bold.contains("\\caption{Ours \\& theirs}\n  \\label{tab:replan}"), "{bold}");
    assert_eq!(
        (bold.matches("\\begin{tabular}").count(), bold.matches("\\textbf{").count()),
        (1, 2),
        "{bold}"
    );
    let (_, refused) = said(&["report", text(&out), "--caption", "x"], 2);
    assert!(refused.contains("--caption has no effect on markdown: leave it out, or give --format latex"));
}

#[test]
fn both_protocols_stand_side_by_side() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("realism");
    let models = ["--models", "log-replay,constant-velocity,idm"];
    let arguments =
        [&["study", "realism", MINI, "--rollouts", "3", "--seed", "4", "--out", text(&out)], &models[..]]
            .concat();
    let (table, _) = said(&arguments, 0);
    let study = read_study(&out).unwrap();
    let names: Vec<&str> = study.members.iter().map(|m| m.folder.as_str()).collect();
    assert_eq!((study.kind, names), (StudyKind::Realism, vec!["reactive", "realism"]));
    let run = [&models[..], &["--seed", "4"]].concat();
    is_what_run_makes(&out, "reactive", &run);
    is_what_run_makes(&out, "realism", &[&run[..], &["--protocol", "realism", "--rollouts", "3"]].concat());
    let rows = rows(&table);
    let columns = [
        ("reactive", "aav-collision"),
        ("reactive", "aav-ttc"),
        ("realism", "aav-collision"),
        ("realism", "aav-ttc"),
        ("realism", "ade"),
        ("realism", "min-ade"),
        ("realism", "kinematic-likelihood"),
    ];
    assert_eq!((rows.len(), rows[0].len()), (4, 1 + columns.len()));
    assert_eq!(rows[0][6], "Realism: minADE (m) ↓");
    assert_eq!(rows[1][0], "Log Replay †");
    for (row, id) in rows[1..].iter().zip(["log-replay", "constant-velocity", "idm"]) {
        for (cell, (member, metric)) in row[1..].iter().zip(columns) {
            assert_eq!(mean(cell), shown(&out.join(member), id, metric), "{id} {member} {metric}");
        }
    }
    // Log replay hits an AV that leaves the log, and equals the log if the AV does not.
    assert!(mean(&rows[1][1]) > "1.0" && mean(&rows[1][3]) == "0.000" && mean(&rows[1][5]) == "0.00");
}

#[test]
fn networks_along_a_training_are_a_path() {
    let home = tempfile::tempdir().unwrap();
    let (out, training) = (home.path().join("study"), home.path().join("training"));
    let named = format!("both={}", training.display());
    let study = ["study", "realism-reactivity", "--limit", "2", "--models", "stop", "--rollouts", "2"];
    let study = [&study[..], &["--training", &named, "--out", text(&out)]].concat();
    fs::create_dir(&training).unwrap();
    let (_, refused) = said(&study, 2);
    assert!(refused.contains("has no kept networks: train with --keep-every"), "{refused}");
    for step in [5, 20] {
        let weights = concat!(env!("CARGO_MANIFEST_DIR"), "/weights/ntp-reactive.safetensors");
        fs::copy(weights, training.join(format!("weights-{step:08}.safetensors"))).unwrap();
    }
    let (_, refused) = said(&[&study[..], &["--protocol", "realism"]].concat(), 2);
    assert!(refused.contains("--protocol: `study realism-reactivity` sets it"), "{refused}");
    let (table, _) = said(&study, 0);
    let rows = rows(&table);
    let networks: Vec<_> = rows.iter().filter(|row| row[0].starts_with("NTP-reactive (both-")).collect();
    assert_eq!(networks[0][0], "NTP-reactive (both-5)");
    assert_eq!(networks[0][1..], networks[1][1..], "the same weights");
    let rollouts = ["reactive", "realism"]
        .map(|member| read_summary(&out.join(member)).unwrap().provenance.run.settings.rollouts);
    assert_eq!(rollouts, [2, 2]);
    let picture = fs::read_to_string(out.join("paths.svg")).unwrap();
    for label in ["both, step 20", "Stop", "A-AV Coll. ↓", "Realism (Sim Agents) ↑"] {
        assert!(picture.contains(label), "{label}: {picture}");
    }
}

#[test]
fn parts_are_taken_away_and_put_to() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("guards");
    let (table, _) =
        said(&["study", "guards", MINI, "--models", "log-replay,stop,idm", "--out", text(&out)], 0);
    let study = read_study(&out).unwrap();
    let names: Vec<&str> = study.members.iter().map(|m| m.folder.as_str()).collect();
    assert_eq!(names, ["as-is", "lookahead-0", "with-qp", "with-qp-lookahead-0"], "no card has a projection");
    is_what_run_makes(&out, "as-is", &["--models", "log-replay,stop,idm"]);
    is_what_run_makes(&out, "lookahead-0", &["--models", "log-replay,stop,idm", "--av-lookahead", "0"]);
    is_what_run_makes(&out, "with-qp-lookahead-0", &["--models", "stop+qp,idm+qp", "--av-lookahead", "0"]);
    let rows = rows(&table);
    let values = &rows[..1 + rows[1..].iter().position(|r| r[0] == "Method").unwrap()];
    assert_eq!(values.len(), 1 + 2 + 4 + 4);
    let stands: Vec<&str> = values[3..7].iter().map(|r| r[1].as_str()).collect();
    assert_eq!(stands, ["as it is", "look-ahead 0", "with QP", "with QP, look-ahead 0"]);
    for (row, (member, id)) in
        values[3..].iter().zip([("as-is", "stop"), ("lookahead-0", "stop"), ("with-qp", "stop+qp")])
    {
        assert_eq!(mean(&row[3]), shown(&out.join(member), id, "aav-ttc"));
    }
    // A standing agent is risky if the AV drives into it; with the stage, no agent brakes as hard as `stop`.
    let (as_is, with) =
        (read_summary(&out.join("as-is")).unwrap(), read_summary(&out.join("with-qp")).unwrap());
    let risky =
        |s: &reactsim::evaluation::Summary, id: &str| s.simulators[id].metrics["aav-ttc"].mean.unwrap();
    let wanted = risky(&with, "stop+qp") - risky(&as_is, "stop");
    let found = rows[values.len()..].iter().find(|r| r[0] == "Stop" && r[1] == "with QP").unwrap();
    let cell = found[3].trim_matches('*');
    assert!((mean(cell).parse::<f64>().unwrap() - wanted).abs() < 6e-4, "{cell}, not {wanted}");
    // The same as JSON, with the interval.
    let again = ["study", "guards", MINI, "--models", "log-replay,stop,idm", "--out", text(&out), "--resume"];
    let (json, _) = said(&[&again[..], &["--format", "json"]].concat(), 0);
    let json: Value = serde_json::from_str(&json).unwrap();
    let changed = &json["members"][2]["simulators"][0];
    assert_eq!(changed["id"], "stop+qp");
    let difference = &changed["difference"]["aav-ttc"];
    assert!((difference["mean"].as_f64().unwrap() - wanted).abs() < 1e-12);
    assert!(difference["p"].as_f64().unwrap() <= 1.0 && difference["scenarios"] == 12);
    assert!(json["members"][0]["simulators"][1].get("difference").is_none());
}

#[test]
fn errors_are_grouped_by_what_agents_do() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("study");
    let arguments =
        ["study", "errors", MINI, "--models", "log-replay,constant-velocity", "--out", text(&out)];
    let (table, _) = said(&arguments, 0);
    let study = read_study(&out).unwrap();
    assert_eq!((study.kind, study.members[0].folder.as_str()), (StudyKind::Errors, "log-av"));
    let found = LogErrors::read(&out).unwrap().unwrap();
    let [replay, constant] = &found.simulators[..] else { panic!("{found:?}") };
    assert!(replay.groups.iter().all(|group| group.displacement == 0.0 && group.ahead == 0.0));
    let group = |name: &str| constant.groups.iter().find(|group| group.group == name).unwrap();
    for dimension in ["class", "situation", "speed", "distance"] {
        let groups = constant.groups.iter().filter(|group| group.by == dimension);
        let (agents, share) =
            groups.fold((0, 0.0), |(n, s), group| (n + group.agents, s + group.share.unwrap()));
        assert_eq!(agents, group("all").agents, "{dimension}");
        assert!((share - 1.0).abs() < 1e-9, "{dimension}: {share}");
    }
    // Agents that halt in the log do not halt at constant velocity, and those that set off stand.
    assert!(group("halts").ahead > 5.0 && group("sets off").ahead < 0.0, "{constant:?}");
    assert!(group("after 8 s").displacement > 3.0 * group("after 2 s").displacement);
    assert!(table.contains("by what agents do in it") && table.contains("| halts"), "{table}");
    let (json, _) = said(&[&arguments[..], &["--resume", "--format", "json"]].concat(), 0);
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["errors"]["simulators"][1]["groups"][0]["agents"], group("all").agents);
    let refused = ["study", "errors", MINI, "--av", "log", "--out", "x"];
    assert!(said(&refused, 2).1.contains("--av: `study errors` sets it: leave out --av"));
}

#[test]
fn a_variant_holds_what_it_changes() {
    let models = ["stop+qp", "idm", "ntp-reactive", "ntp-reactive-raw", "qp-regression"];
    let mut spec = RunSpec::default();
    spec.subject.av = Some(AvChoice::Deviated);
    spec.subject.models = models.map(str::to_owned).to_vec();
    spec.subject.set = ["ntp-reactive.keep_clear=false", "idm.vehicle.headway=2"].map(str::to_owned).to_vec();
    let parts = RunParts { sources: vec![source("a", vec![0])], ..RunParts::default() };
    let programs = ExternalPrograms::default();
    let mut plan = StudyPlan::new(StudyKind::Guards, vec![(spec, Vec::new())], parts, &programs).unwrap();
    let members = plan.study().members.clone();
    let found: Vec<String> = (0..members.len())
        .map(|i| {
            let plan = plan.select(i);
            let provenance = plan.provenance();
            let simulators = provenance.simulators.iter().map(|s| {
                let changes = s.parameters.iter().map(|(key, value)| format!(" {key}={value}"));
                assert!(members[i].originals.contains_key(&s.id), "{}", s.id);
                assert_eq!(s.weights.is_some(), s.id.contains("ntp") || s.id.contains("regression"));
                format!("{}{}", s.id, changes.collect::<String>())
            });
            assert_eq!(members[i].originals.len(), provenance.simulators.len());
            let ahead = u8::from(provenance.settings.av_lookahead);
            assert_eq!(Some(ahead == 1), members[i].av_lookahead);
            let simulators: Vec<String> = simulators.collect();
            format!("{} {ahead}: {}", members[i].folder, simulators.join(", "))
        })
        .collect();
    insta::assert_snapshot!(found.join("\n"), @r"
    as-is 1: stop+qp, idm vehicle.headway=2.0, ntp-reactive keep_clear=false, ntp-reactive-raw, qp-regression
    lookahead-0 0: stop+qp, idm vehicle.headway=2.0, ntp-reactive keep_clear=false, ntp-reactive-raw, qp-regression
    without-projection 1: ntp-reactive keep_clear=false projection=false
    without-projection-lookahead-0 0: ntp-reactive keep_clear=false projection=false
    with-projection 1: ntp-reactive-raw projection=true
    with-projection-lookahead-0 0: ntp-reactive-raw projection=true
    without-keep-clear 1: qp-regression keep_clear=false
    without-keep-clear-lookahead-0 0: qp-regression keep_clear=false
    with-keep-clear 1: ntp-reactive keep_clear=true, ntp-reactive-raw keep_clear=true
    with-keep-clear-lookahead-0 0: ntp-reactive keep_clear=true, ntp-reactive-raw keep_clear=true
    with-qp 1: idm+qp vehicle.headway=2.0, ntp-reactive+qp keep_clear=false, ntp-reactive-raw+qp
    with-qp-lookahead-0 0: idm+qp vehicle.headway=2.0, ntp-reactive+qp keep_clear=false, ntp-reactive-raw+qp
    without-qp 1: stop
    without-qp-lookahead-0 0: stop
    ");
    // Members can be selected in any order.
    assert_eq!(plan.select(0).simulators.len(), models.len());
}

#[test]
fn axes_are_runs_of_all_combinations() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("axes");
    let spec = home.path().join("spec.toml");
    let mini = fs::canonicalize(MINI).unwrap();
    fs::write(&spec, format!("scenarios = [{mini:?}]\nmodels = [\"stop\", \"idm\"]\nlimit = 2\n")).unwrap();
    let arguments = ["study", text(&spec), "--axis", "idm.vehicle.headway=1,2", "--axis", "av=log,brake:4"];
    let (table, told) = said(&[&arguments[..], &["--out", text(&out)]].concat(), 0);
    assert!(told.starts_with("1 of 4: idm.vehicle.headway 1, av log\n"), "{told}");
    let study = read_study(&out).unwrap();
    let names: Vec<&str> = study.members.iter().map(|m| m.folder.as_str()).collect();
    let wanted = [
        "idm-vehicle-headway-1_av-log",
        "idm-vehicle-headway-1_av-brake-4",
        "idm-vehicle-headway-2_av-log",
        "idm-vehicle-headway-2_av-brake-4",
    ];
    assert_eq!((study.kind, &names[..]), (StudyKind::Axes, &wanted[..]));
    let headway = ["--models", "stop,idm", "--limit", "2", "--set", "idm.vehicle.headway=2"];
    is_what_run_makes(&out, wanted[3], &[&headway[..], &["--av", "brake:4"]].concat());
    let rows = rows(&table);
    assert_eq!(rows[0][..3], ["Method", "idm.vehicle.headway", "av"]);
    assert_eq!(rows.len(), 1 + 2 * 4);
    assert_eq!(rows[8][..3], ["IDM", "2", "brake:4"]);
    assert_eq!(mean(&rows[8][3]), shown(&out.join(wanted[3]), "idm", "aav-collision"));
    // A member is the run that its specification repeats, wherever it is called from.
    let again = home.path().join("again");
    let member = out.join(wanted[3]);
    said(&["run", text(&member.join("spec.toml")), "--out", text(&again)], 0);
    for name in ["provenance.json", "rows.jsonl", "summary.json"] {
        assert!(fs::read(member.join(name)).unwrap() == fs::read(again.join(name)).unwrap(), "{name}");
    }
    assert_eq!(said(&["report", text(&out)], 0).0, table);
    assert!(said(&["report", text(&out), "--format", "latex"], 0).0.contains("\\begin{tabular}{lllccccccc}"));
    let (json, _) =
        said(&[&arguments[..], &["--out", text(&out), "--resume", "--format", "json"]].concat(), 0);
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["members"][3]["axes"][1]["value"], "brake:4");

    let refused = |axes: &[&str], part: &str| {
        let (_, told) = said(&[&["study", MINI, "--out", "never"], axes].concat(), 2);
        assert!(told.contains(part), "{told}");
    };
    refused(&["--axis", "replan=2hz,3hz"], "axis replan=3hz: `3hz` is not a replan interval");
    refused(&[], "nothing is varied: give --axis KEY=VALUES");
    let drivers = ["--models", "stop", "--limit", "1", "--axis", "av.planner=idm,pdm-closed"];
    let driven = home.path().join("driven");
    let (table, _) = said(&[&["study", MINI, "--out", text(&driven)], &drivers[..]].concat(), 0);
    assert!(table.starts_with("| Method | av ") && table.contains("| AV score ↑ |"), "{table}");
    let (_, told) = said(&["study", "repln", MINI, "--out", "never"], 2);
    assert!(told.contains("there is no study `repln`; did you mean `replan`?"), "{told}");
    let (_, told) = said(&["study", "vocabulary", "--out", "never"], 2);
    assert!(told.contains("there is no study `vocabulary`: the studies are replan, realism, "), "{told}");
}

#[test]
fn an_interrupted_study_goes_on_to_the_same_bytes() {
    let home = tempfile::tempdir().unwrap();
    let (out, cut) = (home.path().join("whole"), home.path().join("cut"));
    let study = |out: &Path, more: &[&str], code| {
        let models = ["--models", "stop,constant-velocity", "--intervals", "5,10,20", "--keep-rollouts"];
        said(&[&["study", "replan", MINI, "--out", text(out)], &models[..], more].concat(), code).1
    };
    study(&out, &[], 0);
    let wanted = results(&out);
    // One member complete, one truncated, one not begun.
    study(&cut, &["--jobs", "1"], 0);
    assert!(results(&cut) == wanted);
    let member = cut.join("steps-10");
    let rows = fs::read_to_string(member.join("rows.jsonl")).unwrap();
    let half = &rows[..rows.len() / 2 + 3];
    fs::write(member.join("rows.jsonl"), half).unwrap();
    fs::remove_file(member.join("summary.json")).unwrap();
    fs::remove_dir_all(cut.join("steps-20")).unwrap();
    fs::remove_file(cut.join("study.md")).unwrap();
    let error = read_study(&cut).unwrap_err().to_string();
    assert!(error.contains("is not finished (steps-10, steps-20)"), "{error}");
    let told = study(&cut, &["--resume"], 0);
    assert_eq!(told.matches("already finished").count(), 1, "{told}");
    assert!(results(&cut) == wanted);
    // Rows lost although the member was finished, and a table that was not written.
    fs::write(member.join("rows.jsonl"), half).unwrap();
    fs::remove_file(cut.join("steps-20/summary.md")).unwrap();
    let told = study(&cut, &["--resume"], 0);
    assert_eq!(told.matches("already finished").count(), 1, "{told}");
    assert!(results(&cut) == wanted);
    // A folder that a kill left before the study began.
    let begun = home.path().join("begun");
    fs::create_dir(&begun).unwrap();
    fs::write(begun.join(".study.json.1.partial"), "{").unwrap();
    study(&begun, &["--resume"], 0);
    assert!(results(&begun) == wanted);

    // Other settings are refused by name, whichever members are begun, and nothing is changed.
    let refused = |more: &[&str], part: &str| {
        let told = study(&cut, more, 2);
        assert!(told.contains(part), "{told}");
    };
    refused(&[], "the same command with --resume continues the run");
    refused(&["--resume", "--seed", "3"], "`seed` is 0 there and 3 now");
    // The files after the first scenario are no inputs then; the limit is what differs.
    refused(&["--resume", "--limit", "1"], "`limit` is absent there and 1 now; give the same settings");
    fs::remove_dir_all(cut.join("steps-05")).unwrap();
    refused(&["--resume", "--seed", "3"], "steps-10: `seed` is 0 there and 3 now");
    let shared =
        ["study", "replan", MINI, "--models", "stop,constant-velocity", "--out", text(&cut), "--resume"];
    let (_, told) = said(&[&shared[..], &["--intervals", "5,10", "--keep-rollouts"]].concat(), 2);
    assert!(
        told.contains("`members` is steps-05, steps-10, steps-20 there and steps-05, steps-10 now"),
        "{told}"
    );
    let (_, told) = said(&["study", "guards", MINI, "--models", "stop", "--out", text(&cut), "--resume"], 2);
    assert!(told.contains("`study` is replan there and guards now"), "{told}");
    let (_, told) =
        said(&["study", "guards", MINI, "--models", "stop", "--out", text(&member), "--resume"], 2);
    assert!(told.contains("steps-10 is not a study: it has no study.json"), "{told}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_a_study_that_goes_on() {
    let home = tempfile::tempdir().unwrap();
    let (input, whole, out) =
        (home.path().join("scenarios.parquet"), home.path().join("whole"), home.path().join("stopped"));
    write(&input, (0..24).map(scenario));
    let study = |out: &Path| {
        let mut command = program();
        command.args(["study", "replan", text(&input), "--models", "stop", "--intervals", "5,10"]);
        command.args(["--rollouts", "60", "--jobs", "1", "--batch", "1", "--out", text(out)]);
        command
    };
    assert!(study(&whole).output().unwrap().status.success());
    let has_rows = || fs::metadata(out.join("steps-05/rows.jsonl")).is_ok_and(|m| m.len() > 0);
    // A study may end before the signal.
    let output = (0..20).find_map(|_| {
        fs::remove_dir_all(&out).ok();
        let output = signalled(&mut study(&out), "-INT", has_rows);
        (!output.status.success()).then_some(output)
    });
    let output = output.expect("no study lasted long enough");
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains("to continue, repeat the command with --resume"));
    assert!(read_study(&out).unwrap_err().to_string().contains("is not finished"));
    assert!(study(&out).arg("--resume").output().unwrap().status.success());
    assert!(results(&out) == results(&whole));
}

#[test]
fn wrong_input_names_the_mend_before_anything_is_run() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("study");
    let refused = |arguments: &[&str]| {
        let (printed, told) = said(&[&["study"], arguments, &["--out", text(&out)]].concat(), 2);
        assert!(printed.is_empty() && !out.exists(), "{arguments:?}");
        told
    };
    for (intervals, part) in [
        ("0", "`0` is not a replan interval: expected 1 to 80 steps"),
        ("5,81", "`81` is not a replan interval"),
        ("", "`` is not a replan interval"),
        ("5,2hz", "axis replan=5steps: its value is there twice"),
    ] {
        let told = refused(&["replan", MINI, "--models", "stop", "--intervals", intervals]);
        assert!(told.contains(part), "{told}");
    }
    for (line, part) in [
        ("guards MINI --models stop+qqp", "no simulator `stop+qqp`"),
        ("guards MINI --models stop --set idm.x=1", "name it in `models` too"),
        ("realism MINI --models stop --rollouts 0", "1..=10000"),
        ("realism MINI --models stop --metric-option a=b", "metric option `a`"),
        ("replan absent.parquet --models stop", "absent.parquet"),
    ] {
        let told = refused(&words(&line.replace("MINI", MINI)));
        assert!(told.contains(part), "{line}: {told}");
    }
    let (_, told) = said(&["study", "replan", MINI], 2);
    assert!(told.contains("--out <FOLDER>"), "{told}");
}

#[test]
fn without_names_the_log_is_replayed_where_it_tells_something() {
    let ids = |study: &str| {
        let home = tempfile::tempdir().unwrap();
        let input = home.path().join("some.parquet");
        let out = home.path().join("study");
        // Everything is planned before the only scenario turns out to have no deviated AV.
        write(&input, [deviating(0, false)]);
        let (_, told) = said(&["study", study, text(&input), "--av", "deviated", "--out", text(&out)], 2);
        assert!(told.contains("no scenario could be run"), "{told}");
        let first = if study == "replan" { "steps-01" } else { "reactive" };
        let summary = read_summary(&out.join(first)).unwrap();
        summary.provenance.run.simulators.into_iter().map(|s| s.id).collect::<Vec<_>>()
    };
    let (replan, realism) = (ids("replan"), ids("realism"));
    assert!(replan.len() > 3 && !replan.contains(&"log-replay".to_owned()));
    assert_eq!(realism.len(), replan.len() + 1);
}

#[test]
fn deviations_say_which_scenarios_both_protocols_have() {
    let home = tempfile::tempdir().unwrap();
    let (plain, file, out) =
        (home.path().join("p.parquet"), home.path().join("d.json"), home.path().join("s"));
    write(&plain, (0..4).map(|i| deviating(i, false)));
    fs::write(&file, deviations(&[1, 3]).to_string()).unwrap();
    let arguments = ["study", "realism", text(&plain), "--deviations", text(&file), "--models", "stop"];
    let (_, told) = said(&[&arguments[..], &["--rollouts", "2", "--out", text(&out)]].concat(), 0);
    assert!(told.contains("2 scenarios passed over"), "{told}");
    let [reactive, realism] = ["reactive", "realism"].map(|m| read_summary(&out.join(m)).unwrap().provenance);
    assert_eq!((reactive.scenarios, reactive.passed_over), (2, 2));
    assert_eq!((realism.scenarios, realism.passed_over), (2, 2));
    assert_eq!(reactive.scenarios_blake3, realism.scenarios_blake3);
}

#[test]
fn failures_are_counted_and_tried_again() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("some.parquet"), home.path().join("study"));
    write(&input, (0..3).map(|i| deviating(i, i != 2)));
    let arguments =
        ["study", "replan", text(&input), "--models", "stop", "--intervals", "5,10", "--out", text(&out)];
    let (table, told) = said(&arguments, 1);
    assert!(table.contains("`steps-05`: 2 scenarios, 1 failure, "), "{table}");
    assert!(told.ends_with("warning: 2 failed; the others are in the table\n"), "{told}");
    let before = results(&out);
    let (_, told) = said(&[&arguments[..], &["--resume"]].concat(), 1);
    assert!(!told.contains("already finished"), "{told}");
    assert!(results(&out) == before);
}

#[test]
fn a_damaged_study_is_refused() {
    let home = tempfile::tempdir().unwrap();
    let refused = |text: &str, part: &str| {
        fs::write(home.path().join("study.json"), text).unwrap();
        let error = read_study(home.path()).unwrap_err().to_string();
        assert!(error.contains("study.json cannot be read") && error.contains(part), "{error}");
    };
    let study =
        |kind: &str, members: &str| format!(r#"{{"version": 1, "kind": "{kind}", "members": [{members}]}}"#);
    refused("{", "EOF");
    refused(
        r#"{"version": 2, "kind": "replan", "members": []}"#,
        "its version is 2, this program reads version 1",
    );
    refused(&study("other", ""), "unknown variant `other`");
    refused(&study("replan", ""), "it has no members");
    refused(
        &study("replan", r#"{"folder": "../x", "label": "", "replan_steps": 1}"#),
        "`../x` is not a valid folder name",
    );
    refused(&study("replan", r#"{"folder": "x", "label": ""}"#), "the member `x` has no `replan_steps`");
    refused(&study("realism", r#"{"folder": "x", "label": ""}"#), "has no `protocol`");
    refused(&study("guards", r#"{"folder": "x", "label": "", "variant": "a"}"#), "has no `av_lookahead`");
    refused(&study("replan", r#"{"folder": "x", "label": "", "speed": 1}"#), "unknown field `speed`");
    let twice = r#"{"folder": "x", "label": "", "replan_steps": 1}"#;
    refused(&study("replan", &format!("{twice}, {twice}")), "two members `x`");
    fs::remove_file(home.path().join("study.json")).unwrap();
    let error = read_study(home.path()).unwrap_err().to_string();
    assert!(error.contains("is not a study: it has no study.json"), "{error}");
    assert!(!is_study(home.path()));
}
