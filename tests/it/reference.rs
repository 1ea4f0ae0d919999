//! References: made from runs, refused after changes, verified by running again, and their tables.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use reactsim::evaluation::reference::{Reference, RerunInputs, SimulatorClass, verify};
use reactsim::evaluation::{
    Execution, Provenance, Row, RunObserver, Source, Summary, Tally, read_provenance, read_rows,
    read_summary, read_tally, shipped_benchmark,
};
use reactsim::formats;
use reactsim::metrics::Score;
use serde_json::json;

use crate::program::{MINI, copy, said, text};
use crate::small_scenarios;

const CLEAN: &str = "0123456789abcdef0123456789abcdef01234567";

/// Marks the program of a run as built from a commit: tests run in trees with changes.
pub(crate) fn as_if_committed(run: &Path) {
    edit_both(run, |provenance| provenance["commit"] = CLEAN.into());
}

/// Changes the provenance of a run folder, and that in its summary.
pub(crate) fn edit_both(run: &Path, edit: impl Fn(&mut serde_json::Value)) {
    edit_json(&run.join("provenance.json"), &edit);
    edit_json(&run.join("summary.json"), |summary| edit(&mut summary["provenance"]));
}

fn edit_json(path: &Path, edit: impl Fn(&mut serde_json::Value)) {
    let mut value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    edit(&mut value);
    fs::write(path, serde_json::to_string_pretty(&value).unwrap() + "\n").unwrap();
}

/// Returns a run on the whole benchmark with its rollouts, made once for all tests.
pub(crate) fn run() -> &'static Path {
    static RUN: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = RUN.get_or_init(|| {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("run");
        let models = "log-replay,constant-velocity,stop";
        said(&["run", "--models", models, "--keep-rollouts", "--out", text(&path)], 0);
        as_if_committed(&path);
        (home, path)
    });
    path
}

/// Makes a reference from a run; must succeed.
#[track_caller]
fn made(run: &Path, out: &Path, more: &[&str]) -> PathBuf {
    said(&[&["reference", "make", text(run), "--name", "test", "--out", text(out)], more].concat(), 0);
    out.to_owned()
}

/// Changes the rows of a run folder and sums them up again, so that all files agree.
pub(crate) fn edit_rows(run: &Path, edit: impl Fn(&mut Vec<Row>)) {
    let provenance = read_provenance(run).unwrap();
    let mut rows = read_rows(run).unwrap();
    edit(&mut rows);
    let lines = rows.iter().map(|row| serde_json::to_string(row).unwrap() + "\n");
    fs::write(run.join("rows.jsonl"), lines.collect::<String>()).unwrap();
    let mut tally = provenance.tally();
    let mut pairs: BTreeMap<_, Vec<Row>> = BTreeMap::new();
    for row in rows {
        pairs.entry((row.place(), row.simulator.clone())).or_default().push(row);
    }
    let empty = tally.clone();
    pairs.values().filter(|rows| empty.is_complete(rows)).for_each(|rows| tally.add(rows));
    let summary = Summary::new(&tally, &[], &provenance);
    fs::write(run.join("summary.json"), summary.to_json()).unwrap();
}

/// Changes a file of a reference and its digest.
pub(crate) fn edit_file(reference: &Path, name: &str, edit: impl Fn(&mut serde_json::Value)) {
    let path = reference.join(name);
    let digest = |path: &Path| blake3::hash(&fs::read(path).unwrap()).to_hex().to_string();
    let old = digest(&path);
    edit_json(&path, edit);
    let record = reference.join("reference.toml");
    let text = fs::read_to_string(&record).unwrap().replace(&old, &digest(&path));
    fs::write(record, text).unwrap();
}

#[test]
fn a_reference_holds_all_rows_and_is_read_like_a_run() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let command = "reactsim run --out run";
    let reference = made(run(), &at("reference"), &["--title", "A test", "--command", command]);
    let rows = read_rows(run()).unwrap();
    let read = Reference::open(&reference).unwrap();
    assert_eq!(read.rows.as_ref().unwrap(), &rows);
    assert_eq!(
        (read.record.title.as_str(), read.record.commands.as_slice()),
        ("A test", &[command.to_owned()][..])
    );
    assert_eq!(read.record.benchmark, shipped_benchmark().map(|known| known.record));
    assert!(read.record.simulators.values().all(|class| *class == SimulatorClass::Exact));
    // References can be read wherever run folders can.
    let report = |folder: &Path| said(&["report", text(folder)], 0).0;
    assert_eq!(report(&reference), report(run()));
    assert!(report(&reference).contains(&shipped_benchmark().unwrap().record.to_string()));
    let (compared, _) = said(&["compare", text(&reference), text(run()), "--worse", "ade=0"], 0);
    assert!(compared.contains("stop: 150 scenarios"), "{compared}");
    let page = ["report", text(&reference), "--format", "html"];
    assert!(said(&page, 2).1.contains("is a reference, which has no events"));
    // An existing folder is not replaced.
    let again = ["reference", "make", text(run()), "--name", "test", "--out", text(&reference)];
    assert!(said(&again, 2).1.contains("exists and is not empty"));
}

#[test]
fn runs_that_can_be_no_reference_are_refused() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let refused = |run: &Path, more: &[&str]| {
        let out = at("out");
        let arguments = ["reference", "make", text(run), "--name", "test", "--out", text(&out)];
        let said = said(&[&arguments[..], more].concat(), 2).1;
        assert!(!out.exists(), "{said}");
        said
    };
    let dirty = copy(run(), &at("dirty"));
    for commit in [format!("{CLEAN}+"), "unknown".to_owned()] {
        edit_both(&dirty, |provenance| provenance["commit"] = commit.as_str().into());
        assert!(refused(&dirty, &[]).contains(&format!("at commit `{commit}`")));
    }
    let failed = copy(run(), &at("failed"));
    edit_json(&failed.join("summary.json"), |summary| {
        let failure = json!({ "input": 0, "record": 3, "simulator": "stop", "file": "bench.parquet", "scenario": null,
            "error": "no way on" });
        summary["provenance"]["failures"] = json!([failure]);
    });
    assert!(refused(&failed, &[]).contains("1 failures, the first: no way on"));
    let unfinished = copy(run(), &at("unfinished"));
    fs::remove_file(unfinished.join("summary.json")).unwrap();
    assert!(refused(&unfinished, &[]).contains("holds no finished run"));
    let elsewhere = copy(run(), &at("elsewhere"));
    edit_both(&elsewhere, |provenance| provenance["cpu"] = "abacus".into());
    assert!(refused(&elsewhere, &[]).contains("another class of processor"));
    let part = copy(run(), &at("part"));
    edit_rows(&part, |rows| rows.retain(|row| row.record != 7));
    assert!(refused(&part, &[]).contains("149 of the 150 scenarios of"));
    let halved = copy(run(), &at("halved"));
    let lines = fs::read_to_string(halved.join("rows.jsonl")).unwrap();
    let kept: Vec<&str> = lines.lines().skip(1).collect();
    fs::write(halved.join("rows.jsonl"), kept.join("\n") + "\n").unwrap();
    assert!(refused(&halved, &[]).contains("are incomplete"));

    let limited = at("limited");
    said(&["run", "--models", "stop", "--limit", "3", "--out", text(&limited)], 0);
    as_if_committed(&limited);
    assert_eq!(read_provenance(&limited).unwrap().benchmark, None);
    assert!(!said(&["report", text(&limited)], 0).0.contains("reactsim-bench"));
    assert!(refused(&limited, &[]).contains("no known benchmark, or on a part of one"));
    let out = at("out");
    let no_name = ["reference", "make", text(run()), "--name", "../x", "--out", text(&out)];
    assert!(said(&no_name, 2).1.contains("is not a valid name of a reference"));
}

#[test]
fn a_changed_reference_is_refused_by_name() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let reference = made(run(), &at("reference"), &[]);
    let mut n = 0;
    let mut refused = |change: &dyn Fn(&Path)| {
        n += 1;
        let changed = copy(&reference, &at(&n.to_string()));
        change(&changed);
        said(&["verify", text(&changed)], 2).1
    };
    let missing = refused(&|folder| fs::remove_file(folder.join("rows.parquet")).unwrap());
    assert!(missing.contains("rows.parquet is missing"), "{missing}");
    let extra = refused(&|folder| fs::write(folder.join("notes.md"), "x").unwrap());
    assert!(extra.contains("notes.md does not belong"), "{extra}");
    for name in ["rows.parquet", "summary.json", "provenance.json"] {
        let edited = refused(&|folder| {
            let path = folder.join(name);
            let mut bytes = fs::read(&path).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            fs::write(&path, bytes).unwrap();
        });
        assert!(edited.contains(&format!("{name} was changed")), "{edited}");
    }
    let summary = refused(&|folder| {
        edit_file(folder, "summary.json", |summary| {
            summary["simulators"]["stop"]["metrics"]["ade"]["mean"] = json!(0.25);
        });
    });
    assert!(
        summary
            .contains("summary.json and the rows do not agree: `simulators.stop.metrics.ade.mean` is 0.25"),
        "{summary}"
    );
    let both = |folder: &Path, edit: &dyn Fn(&mut serde_json::Value)| {
        edit_file(folder, "provenance.json", edit);
        edit_file(folder, "summary.json", |s| edit(&mut s["provenance"]));
    };
    let version = refused(&|f| both(f, &|p| p["version"] = "9.0.0".into()));
    assert!(version.contains("`version` is 9.0.0 in the reference"), "{version}");
    let option = refused(&|f| both(f, &|p| p["metric_options"]["fault_order"] = "mine".into()));
    assert!(option.contains("metric option `fault_order` is `mine`"), "{option}");
    let card = refused(&|f| both(f, &|p| p["simulators"][1]["card"] = "00".into()));
    assert!(card.contains("`simulators[1].card` is \"00\" in the reference"), "{card}");
    let seed = refused(&|f| both(f, &|p| p["settings"]["seed"] = 5.into()));
    assert!(seed.contains("do not agree"), "the seed decides the intervals: {seed}");
    // Names of simulators are also in the rows: a reference of another simulator is made, not edited.
    let strange = copy(run(), &at("strange"));
    let other = |s: &mut serde_json::Value| s["simulators"][2]["id"] = "halt".into();
    edit_json(&strange.join("provenance.json"), other);
    edit_rows(&strange, |rows| {
        rows.iter_mut().filter(|r| r.simulator == "stop").for_each(|r| r.simulator = "halt".into());
    });
    // The tally is read with the simulators of the summary.
    edit_json(&strange.join("summary.json"), |s| other(&mut s["provenance"]));
    edit_rows(&strange, |_| {});
    let strange = made(&strange, &at("of-strangers"), &[]);
    assert!(said(&["verify", text(&strange)], 2).1.contains("there is no simulator `halt`"));
    // Another benchmark than that of the program.
    let foreign = refused(&|folder| {
        both(folder, &|p| {
            p["benchmark"]["blake3"] = "ab".into();
            p["inputs"][0]["blake3"] = "ab".into();
        });
        let record = folder.join("reference.toml");
        let own = shipped_benchmark().unwrap().record.blake3;
        fs::write(&record, fs::read_to_string(&record).unwrap().replace(&own, "ab")).unwrap();
    });
    assert!(foreign.contains("`benchmark` is") && foreign.contains("give its scenarios"), "{foreign}");
    assert!(
        refused(&|folder| fs::remove_file(folder.join("reference.toml")).unwrap())
            .contains("is not a reference")
    );
    let bound = refused(&|folder| {
        let record = folder.join("reference.toml");
        fs::write(
            &record,
            fs::read_to_string(&record).unwrap().replace("class = \"exact\"", "class = \"about\""),
        )
        .unwrap();
    });
    assert!(bound.contains("reference.toml cannot be read"), "{bound}");
    assert!(said(&["verify", "nothing-here"], 2).1.contains("there is no reference `nothing-here`"));
}

#[test]
fn equal_numbers_verify_and_one_other_number_is_named() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let reference = made(run(), &at("reference"), &[]);
    let (table, _) = said(&["verify", text(&reference)], 0);
    for id in ["log-replay", "constant-velocity", "stop"] {
        let line = table.lines().find(|l| l.starts_with(&format!("| {id} "))).unwrap();
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        assert_eq!(cells[2..7], ["exact", "300", "0", "–", "equal"], "{table}");
    }
    assert!(table.contains(": 900 rows compared.") && !table.contains("quick"), "{table}");
    // One more collision in one scenario, in all files of the reference.
    let other = copy(run(), &at("other"));
    edit_rows(&other, |rows| {
        let row = rows.iter_mut().find(|r| r.simulator == "stop" && r.record == 40 && r.rollout == Some(0));
        let row = row.unwrap();
        let Some(Some(Score::Count(n))) = row.metrics.get_mut("aav-collision") else { panic!("{row:?}") };
        *n += 3;
    });
    let other = made(&other, &at("other-reference"), &[]);
    let (table, _) = said(&["verify", text(&other), "--quick"], 1);
    let scenario = &read_rows(run()).unwrap().into_iter().find(|r| r.record == 40).unwrap().scenario;
    assert!(table.contains("| stop              | exact |      300 |      1 |"), "{table}");
    assert!(table.contains("| 3.000e0 (aav-collision) | differs |"), "{table}");
    let line = table.lines().find(|l| l.contains(&format!("{scenario}, rollout 0"))).unwrap();
    assert!(line.contains("| aav-collision |") && line.contains("3 ") && line.contains("0 "), "{table}");
}

/// References of earlier programs lack the metrics that were added since.
#[test]
fn references_are_compared_in_the_metrics_that_they_have() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let old = copy(run(), &at("old"));
    let added = "red-light";
    edit_rows(&old, |rows| {
        rows.iter_mut().for_each(|row| {
            row.metrics.remove(added);
        });
    });
    edit_json(&old.join("summary.json"), |summary| {
        for simulator in summary["simulators"].as_object_mut().unwrap().values_mut() {
            let parts = ["by_category", "by_difficulty"].map(|part| simulator.get(part).cloned());
            for (name, part) in ["by_category", "by_difficulty"].into_iter().zip(parts) {
                for key in part.iter().flat_map(|part| part.as_object().unwrap().keys()) {
                    simulator[name][key]["metrics"].as_object_mut().unwrap().remove(added);
                }
            }
            for name in ["metrics", "paired_to_log_replay"] {
                simulator[name].as_object_mut().unwrap().remove(added);
            }
        }
    });
    let rows = made(&old, &at("rows"), &[]);
    assert!(said(&["verify", text(&rows)], 0).0.contains(": 900 rows compared."));
    let aggregates = made(&old, &at("aggregates"), &["--aggregates-only"]);
    let (table, _) = said(&["verify", text(&aggregates)], 0);
    assert!(table.contains("values compared") && table.contains("equal"), "{table}");
    // A metric that only the summary lacks is not forgiven.
    edit_json(&old.join("summary.json"), |summary| {
        summary["simulators"]["stop"]["metrics"].as_object_mut().unwrap().remove("ade");
    });
    let lacking = at("lacking");
    let make = ["reference", "make", text(&old), "--name", "test", "--out", text(&lacking)];
    assert!(said(&make, 2).1.contains("do not agree"));
}

#[test]
fn runs_of_another_length_are_verified_with_it() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let out = at("run");
    let run = ["run", MINI, "--models=stop", "--history=5", "--future=6s", "--out", text(&out)];
    said(&run, 0);
    as_if_committed(&out);
    let reference = made(&out, &at("reference"), &["--aggregates-only"]);
    let (table, _) = said(&["verify", text(&reference), "--scenarios", MINI], 0);
    assert!(table.contains("equal"), "{table}");
}

#[test]
fn sets_of_recordings_have_aggregates_only() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let out = at("run");
    said(&["run", MINI, "--models", "stop,constant-velocity", "--out", text(&out)], 0);
    as_if_committed(&out);
    let none = at("none");
    let with_rows = ["reference", "make", text(&out), "--name", "mini", "--out", text(&none)];
    assert!(said(&with_rows, 2).1.contains("references of aggregates only"));
    let reference = made(&out, &at("reference"), &["--aggregates-only"]);
    assert!(!reference.join("rows.parquet").exists());
    assert_eq!(said(&["report", text(&reference)], 0).0, said(&["report", text(&out)], 0).0);
    assert!(said(&["compare", text(&reference), text(&out)], 2).1.contains("holds aggregates only"));
    let (table, _) = said(&["verify", text(&reference), "--scenarios", MINI], 0);
    assert!(table.contains("values compared") && table.contains("equal"), "{table}");
    assert!(
        said(&["verify", text(&reference)], 2)
            .1
            .contains("`number of inputs` is 12 in the reference and 1 here")
    );
    let lesser = copy(Path::new(MINI), &at("lesser"));
    let crossing = lesser.join("crossing.json");
    fs::write(&crossing, fs::read_to_string(&crossing).unwrap() + "\n").unwrap();
    let refused = said(&["verify", text(&reference), "--scenarios", text(&lesser)], 2).1;
    assert!(refused.contains("`digest of crossing.json` is"), "{refused}");
    let extra = ["verify", text(&reference), "--scenarios", MINI, "--deviations", "absent.json"];
    assert!(said(&extra, 2).1.contains("absent.json"));
    // Another number that nothing in the folder contradicts.
    edit_file(&reference, "summary.json", |s| {
        s["simulators"]["stop"]["metrics"]["ade"]["mean"] = json!(0.25)
    });
    let (table, _) = said(&["verify", text(&reference), "--scenarios", MINI], 1);
    let line = table.lines().find(|l| l.contains("| ade.mean |")).unwrap();
    assert!(line.starts_with("| stop ") && line.contains("| all ") && line.contains(" 0.25 |"), "{table}");
}

/// Files of curations contain the program that made them; another one may make the same deviated AVs.
#[test]
fn deviated_avs_are_recognised_by_their_trajectories() {
    let home = tempfile::tempdir().unwrap();
    let [logs, file, other, run] =
        ["logs.parquet", "d.json", "other.json", "run"].map(|n| home.path().join(n));
    small_scenarios::write(&logs, (0..3).map(small_scenarios::scenario));
    let mut deviations = small_scenarios::deviations(&[0, 1, 2]);
    fs::write(&file, deviations.to_string()).unwrap();
    let inputs = [text(&logs), "--deviations", text(&file)];
    said(&[&["run"], &inputs[..], &["--models", "stop", "--out", text(&run)]].concat(), 0);
    as_if_committed(&run);
    let reference = made(&run, &home.path().join("reference"), &["--aggregates-only"]);
    let verify = |code| {
        let arguments =
            ["verify", text(&reference), "--scenarios", text(&logs), "--deviations", text(&other)];
        said(&arguments, code)
    };
    fs::write(&other, serde_json::to_string_pretty(&deviations).unwrap()).unwrap();
    assert!(verify(0).0.contains("values compared"));
    deviations["deviations"][1]["x"][40] =
        (deviations["deviations"][1]["x"][40].as_f64().unwrap() + 1e-9).into();
    fs::write(&other, deviations.to_string()).unwrap();
    let (_, refusal) = verify(2);
    assert!(refusal.contains("digest of d.json"), "{refusal}");
}

/// Makes a reference of a network on small scenarios, with rows.
fn of_network(home: &Path) -> (Reference, PathBuf) {
    let (input, out) = (home.join("roads.parquet"), home.join("run"));
    small_scenarios::write(&input, (0..6).map(small_scenarios::scenario));
    said(&["run", text(&input), "--models", "stop,regression", "--out", text(&out)], 0);
    as_if_committed(&out);
    let mut reference =
        Reference::open(&made(&out, &home.join("reference"), &["--aggregates-only"])).unwrap();
    reference.rows = Some(read_rows(&out).unwrap());
    (reference, input)
}

#[test]
fn weights_that_ship_for_another_simulator_are_found_by_their_digest() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("roads.parquet"), home.path().join("run"));
    small_scenarios::write(&input, (0..2).map(small_scenarios::scenario));
    let weights = concat!("regression=", env!("CARGO_MANIFEST_DIR"), "/weights/mtr.safetensors");
    let models = ["--models", "regression", "--model-weights", weights];
    said(&[&["run", text(&input), "--out", text(&out)][..], &models].concat(), 0);
    as_if_committed(&out);
    let reference = made(&out, &home.path().join("reference"), &["--aggregates-only"]);
    said(&["verify", text(&reference), "--scenarios", text(&input)], 0);
}

/// Counts the runs that began.
#[derive(Default)]
struct Begun(AtomicUsize);

impl RunObserver for Begun {
    fn started(&self, _total: Option<usize>) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

#[test]
fn networks_agree_bit_for_bit_at_home_and_within_bounds_elsewhere() {
    let begun = Begun::default();
    let home = tempfile::tempdir().unwrap();
    let (mut reference, input) = of_network(home.path());
    assert!(reference.provenance.backend.is_some() && reference.provenance.cpu.is_some());
    let again = |reference: &Reference, every: Option<usize>| {
        let open = input.clone();
        let file = reference.provenance.inputs[0].clone();
        let open = Box::new(move |first| {
            let found = formats::find_inputs(&open)?;
            Ok(Box::new(found[0].open_from(first)?) as formats::PendingScenarios)
        });
        let given = RerunInputs {
            sources: vec![Source { file, open, count: None }],
            deviations: None,
            weights: Vec::new(),
        };
        let execution = Execution { jobs: 2, batch: 4 };
        let stop = AtomicBool::new(false);
        verify(reference, given, every, execution, &begun, &stop).unwrap().unwrap()
    };
    let network = |done: &reactsim::evaluation::reference::Verification| done.simulators[1].clone();
    let whole = again(&reference, None);
    assert!(whole.passed() && whole.differences.is_empty() && whole.left_out == 0);
    assert_eq!((network(&whole).compared, network(&whole).class), (12, "tolerance"));
    assert!(network(&whole).bit_for_bit);
    // A quick check leaves out scenarios of networks and reports the number of rows.
    let quick = again(&reference, Some(4));
    assert!(quick.passed());
    assert_eq!((quick.left_out, network(&quick).compared, quick.simulators[0].compared), (8, 4, 12));
    // The quick check is a run for networks and one for the others.
    assert_eq!(begun.0.load(Ordering::Relaxed), 3);

    let bound = 0.5;
    let class = SimulatorClass::Tolerance { bounds: [("ade".to_owned(), bound)].into() };
    reference.record.simulators.insert("regression".into(), class);
    let mut shifted = reference.clone();
    let shift = |reference: &mut Reference, by: f64| {
        for row in reference.rows.as_mut().unwrap().iter_mut().filter(|r| r.simulator == "regression") {
            if let Some(Some(Score::Value(ade))) = row.metrics.get_mut("ade") {
                *ade += by;
            }
        }
    };
    shift(&mut shifted, 0.9 * bound);
    // On the same kind of processor, every bit counts.
    assert!(!again(&shifted, None).passed());
    shifted.provenance.cpu = Some("abacus".into());
    let elsewhere = again(&shifted, None);
    assert!(elsewhere.passed(), "{elsewhere:?}");
    let check = network(&elsewhere);
    assert!(!check.bit_for_bit && check.differing == 6, "{check:?}");
    assert!((check.largest.unwrap().difference - 0.9 * bound).abs() < 1e-9);
    shift(&mut shifted, 0.2 * bound);
    let beyond = again(&shifted, None);
    assert!(!beyond.passed());
    assert_eq!((beyond.differences.len(), beyond.differences[0].field.as_str()), (1, "metrics.ade"));
    // Simulators without a network agree bit for bit everywhere.
    let rows = shifted.rows.as_mut().unwrap();
    let stop = rows.iter_mut().find(|r| r.simulator == "stop" && r.metrics.contains_key("ade")).unwrap();
    stop.metrics.insert("ade".into(), None);
    let beyond = again(&shifted, None);
    assert!(!beyond.simulators[0].passed && beyond.simulators[0].differing == 1);
    // A missing row agrees with nothing, on any machine.
    let mut lacking = reference.clone();
    lacking.provenance.cpu = Some("abacus".into());
    lacking.rows.as_mut().unwrap().retain(|r| r.simulator != "regression" || r.record != 2);
    let done = again(&lacking, None);
    assert!(!network(&done).passed && done.differences[0].field == "row", "{done:?}");
}

#[test]
fn weights_decide_which_class_and_provenance_name_the_machine() {
    let home = tempfile::tempdir().unwrap();
    let (reference, _) = of_network(home.path());
    let SimulatorClass::Tolerance { bounds } = &reference.record.simulators["regression"] else { panic!() };
    for (metric, estimate) in &reference.summary.simulators["regression"].metrics {
        let (Some(low), Some(high)) = (estimate.low, estimate.high) else { continue };
        assert_eq!(bounds[metric], ((high - low) / 4.0).max(1e-3), "{metric}");
    }
    assert_eq!(reference.record.simulators["stop"], SimulatorClass::Exact);
    // A metric without a bound would not be compared.
    let record = home.path().join("reference/reference.toml");
    let stated = fs::read_to_string(&record).unwrap();
    let line = stated.lines().find(|l| l.starts_with("ade = ")).unwrap();
    for (bound, part) in [("", "`ade` has no bound"), ("ade = -1.0", "the bound of `ade` is -1")] {
        fs::write(&record, stated.replace(line, bound)).unwrap();
        let refused = Reference::open(&home.path().join("reference")).unwrap_err().to_string();
        assert!(refused.contains(part), "{refused}");
    }
    let machine = &reference.record.machine;
    assert_eq!(reference.provenance.cpu.as_deref(), Some(machine.cpu.as_str()));
    // Without a network, nothing depends on the machine.
    let plain: Provenance = read_provenance(run()).unwrap();
    assert_eq!((plain.backend, plain.cpu), (None, None));
    // Files of earlier versions do not state the benchmark.
    let mut old = serde_json::to_value(read_provenance(run()).unwrap()).unwrap();
    old.as_object_mut().unwrap().remove("benchmark");
    assert_eq!(serde_json::from_value::<Provenance>(old).unwrap().benchmark, None);
}

#[test]
fn tables_of_documents_are_written_and_checked() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let reference = made(run(), &at("reference"), &[]);
    let page = at("page.md");
    let category = read_summary(run()).unwrap().simulators["stop"].by_category.keys().next().unwrap().clone();
    let block = |options: &str| format!("<!-- table {} {options} -->\nold\n<!-- end -->\n", text(&reference));
    let old = format!(
        "# Numbers\n{}between\n{}{}end\n",
        block(""),
        block("columns=ade,aav-collision models=stop,log-replay"),
        block(&format!("columns=ade category={category}"))
    );
    fs::write(&page, &old).unwrap();
    let (_, stale) = said(&["reference", "tables", text(&page), "--check"], 1);
    assert_eq!(stale.matches("differs from its reference").count(), 3, "{stale}");
    assert!(stale.contains("line 2: the table"), "{stale}");
    assert_eq!(fs::read_to_string(&page).unwrap(), old, "a check changes nothing");
    said(&["reference", "tables", text(&page)], 0);
    let new = fs::read_to_string(&page).unwrap();
    let report = said(&["report", text(run())], 0).0;
    assert!(new.contains(report.split("\n\n").next().unwrap()), "{new}");
    let chosen: Vec<&str> = new.split("between\n").nth(1).unwrap().lines().skip(1).take(4).collect();
    let heads: Vec<&str> = chosen[0].split('|').map(str::trim).collect();
    assert_eq!(heads[1..4], ["Method", "ADE (m) ↓", "A-AV Coll. ↓"], "{new}");
    assert!(chosen[2].starts_with("| Stop ") && chosen[3].starts_with("| Log Replay † "), "{new}");
    assert!(new.contains(&format!("{category} deviations, ")), "{new}");
    assert!(new.contains("between\n") && new.ends_with("<!-- end -->\nend\n"), "{new}");
    assert_eq!(said(&["reference", "tables", text(&page), "--check"], 0), (String::new(), String::new()));
    said(&["reference", "tables", text(&page)], 0);
    assert_eq!(fs::read_to_string(&page).unwrap(), new, "writing again changes nothing");
    fs::write(&page, new.replacen("0.0", "0.1", 1)).unwrap();
    assert!(said(&["reference", "tables", text(&page), "--check"], 1).1.matches("differs from").count() == 1);
    let refused = |options: &str| {
        fs::write(&page, block(options)).unwrap();
        said(&["reference", "tables", text(&page)], 2).1
    };
    assert!(refused("models=idm").contains("no simulator `idm`"));
    assert!(refused("difficulty=absurd").contains("no scenario has the difficulty `absurd`"));
    assert!(refused("category=absurd").contains("no scenario has the category `absurd`"));
    assert!(refused("columns=speed").contains("no column `speed`"));
    fs::write(&page, "<!-- table references/none -->\n<!-- end -->\n").unwrap();
    assert!(said(&["reference", "tables", text(&page)], 2).1.contains("references/none is not a reference"));
}

#[test]
fn difficulties_are_parts_of_tables() {
    let home = tempfile::tempdir().unwrap();
    let hard = copy(run(), &home.path().join("run"));
    edit_rows(&hard, |rows| {
        rows.iter_mut().for_each(|r| r.difficulty = Some(if r.record < 9 { "hard" } else { "easy" }.into()));
    });
    let reference = made(&hard, &home.path().join("reference"), &[]);
    let page = home.path().join("page.md");
    fs::write(&page, format!("<!-- table {} difficulty=hard -->\n<!-- end -->\n", text(&reference))).unwrap();
    said(&["reference", "tables", text(&page)], 0);
    let table = fs::read_to_string(&page).unwrap();
    assert!(table.contains("difficulty hard, 9 scenarios, "), "{table}");
    let tally: Tally = read_tally(&reference).unwrap();
    let ade = tally.metric("ade").unwrap();
    let values = tally.entries.values().take(9).map(|e| e.cells[2].as_ref().unwrap().values[ade].unwrap());
    let mean = values.sum::<f64>() / 9.0;
    assert!(
        table.lines().any(|l| l.starts_with("| Stop ") && l.contains(&format!("| {mean:.2} ±"))),
        "{table}"
    );
}
