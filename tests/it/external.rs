//! External simulators: the same numbers as baselines, and no fault stalls or falsifies a run.

mod faults;
mod mistakes;
mod planners;
mod plans;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::Command as Process;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use reactsim::evaluation::{
    self, AvChoice, Driver, EvaluationError, Execution, Failure, Outcome, Plan, PlannedAv, PlannedSimulator,
    Row, RunFolder, RunObserver, Source,
};
use reactsim::external::{
    Command, ExternalError, ExternalSettings, ExternalSimulator, RunOutline, TimeLimits,
};
use reactsim::models;
use reactsim::planning::tracking;
use reactsim::rollout::{Controller, Entering, Protocol, Purpose, Replan, roll_out, stream};
use serde_json::Value;

use crate::protocol::entering::{request, settings_of, street};
use crate::scenes::{bits, car, scene, straight};
use crate::small_scenarios;

const CHILD: &str = include_str!("external/child.py");

/// A copy of the child with a path of its own, which identifies its processes.
pub(super) struct Child {
    folder: tempfile::TempDir,
}

impl Child {
    /// Copies the child. `None`, with a message, if there is no Python.
    pub(super) fn new() -> Option<Self> {
        if !Process::new("python3").arg("--version").output().is_ok_and(|o| o.status.success()) {
            crate::skipped("there is no python3");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("child.py"), CHILD).unwrap();
        Some(Self { folder })
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the command with a fault, such as `nan plan 0 once:FILE`.
    pub(super) fn command(&self, fault: &str) -> Command {
        // Without `exec`, some shells would stay between the program and the child.
        Command::Shell(format!("exec python3 {} {fault}", self.path("child.py").display()))
    }

    pub(super) fn settings(&self, fault: &str, limit: Duration) -> ExternalSettings {
        let limits = TimeLimits { start: limit, first: limit, plan: limit };
        ExternalSettings { limits, ..ExternalSettings::new("mine", self.command(fault)) }
    }

    /// Returns the number of processes of this child that still run.
    pub(super) fn left_over(&self) -> usize {
        processes(&self.folder.path().display().to_string())
    }
}

/// Returns the number of running processes with this text in their command line.
pub(super) fn processes(mark: &str) -> usize {
    let has_mark = |entry: &fs::DirEntry| {
        let line = fs::read(entry.path().join("cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&line).contains(mark)
    };
    // Without /proc, this cannot be checked.
    fs::read_dir("/proc").map_or(0, |all| all.flatten().filter(has_mark).count())
}

pub(super) const LONG: Duration = Duration::from_secs(60);

pub(super) fn outline(protocol: Protocol) -> RunOutline {
    RunOutline { intervals: vec![5], protocols: vec![protocol.name()] }
}

pub(super) fn start(settings: ExternalSettings) -> Result<PlannedSimulator, ExternalError> {
    let simulator = ExternalSimulator::start(settings, outline(Protocol::Reactive))?;
    Ok(PlannedSimulator::external(simulator, None).unwrap())
}

pub(super) fn plan_of(simulators: Vec<PlannedSimulator>, protocol: Protocol) -> Plan {
    let mut plan = small_scenarios::plan(vec![Source::shipped(12)], simulators);
    plan.spec.rollout.protocol = protocol;
    if protocol == Protocol::Realism {
        plan.spec.subject.av = None;
    }
    plan
}

/// Plans runs of a baseline in which this driver moves the AV.
pub(super) fn driven(baseline: &str, driver: Driver, controller: tracking::Controller, every: usize) -> Plan {
    let simulators = PlannedSimulator::by_ids(&[baseline.to_owned()]).unwrap();
    let every = Replan::every(every).unwrap();
    let mut plan = plan_of(simulators, Protocol::Reactive);
    plan.spec.subject.av =
        Some(AvChoice::Planned(PlannedAv { driver: driver.driver().clone(), controller, every }));
    plan.drivers.push(driver);
    plan
}

#[derive(Default)]
struct Collector {
    rows: Mutex<Vec<Row>>,
    failures: Mutex<Vec<Failure>>,
}

impl RunObserver for Collector {
    fn rows(&self, rows: &[Row]) {
        self.rows.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(rows);
    }

    fn failed(&self, failure: &Failure) {
        self.failures.lock().unwrap_or_else(PoisonError::into_inner).push(failure.clone());
    }
}

/// Runs a plan; returns how it ended, its rows and its failures.
pub(super) fn execute(
    plan: &Plan,
    jobs: usize,
    batch: usize,
    folder: Option<&RunFolder>,
) -> (Result<Outcome, EvaluationError>, Vec<Row>, Vec<Failure>) {
    let (collector, stop) = (Collector::default(), AtomicBool::new(false));
    let outcome = evaluation::run(plan, Execution { jobs, batch }, folder, plan.tally(), &collector, &stop);
    (outcome, collector.rows.into_inner().unwrap(), collector.failures.into_inner().unwrap())
}

/// Rows by scenario, without the name of the simulator and the endings of plans; failures by scenario.
pub(super) type Results = (BTreeMap<String, Value>, BTreeMap<String, String>);

pub(super) fn run(plan: &Plan, jobs: usize) -> Results {
    let (outcome, rows, failures) = execute(plan, jobs, 3, None);
    assert!(matches!(outcome, Ok(Outcome::Finished(_))), "{outcome:?}");
    let rows = rows.iter().map(|row| {
        let mut value = serde_json::to_value(row).unwrap();
        let fields = value.as_object_mut().unwrap();
        fields.remove("simulator");
        fields.remove("outcomes");
        (row.scenario.clone(), value)
    });
    let failures = failures.into_iter().map(|f| (f.scenario.unwrap(), f.error));
    (rows.collect(), failures.collect())
}

pub(super) fn baseline(protocol: Protocol) -> BTreeMap<String, Value> {
    let baseline = PlannedSimulator::by_ids(&["constant-velocity".to_owned()]).unwrap();
    let (rows, failures) = run(&plan_of(baseline, protocol), 1);
    assert!(rows.len() >= 12 && failures.is_empty());
    rows
}

#[test]
fn it_gives_the_rows_of_the_baseline_on_any_number_of_workers_and_threads() {
    let Some(child) = Child::new() else { return };
    for protocol in [Protocol::Reactive, Protocol::Realism] {
        let wanted = baseline(protocol);
        for (batch, workers, jobs) in [(1, 1, 1), (4, 2, 3), (5, 3, 2), (100, 1, 2)] {
            let settings = ExternalSettings { batch: Some(batch), workers, ..child.settings("", LONG) };
            let simulator = ExternalSimulator::start(settings, outline(protocol)).unwrap();
            let name = simulator.processes().description().name.as_str();
            assert_eq!((simulator.batch(), name), (batch, "child"));
            let plan = plan_of(vec![PlannedSimulator::external(simulator, None).unwrap()], protocol);
            let (rows, failures) = run(&plan, jobs);
            assert_eq!(failures, BTreeMap::new());
            assert_eq!(rows, wanted, "batch {batch}, {workers} workers, {jobs} threads");
        }
    }
    assert_eq!(child.left_over(), 0);
}

#[test]
fn a_stage_behind_it_acts_as_behind_the_baseline() {
    let Some(child) = Child::new() else { return };
    let smoothing = reactsim::models::qp::Smoothing::Full;
    let simulator = ExternalSimulator::start(child.settings("", LONG), outline(Protocol::Reactive)).unwrap();
    let external = PlannedSimulator::external(simulator, Some(smoothing)).unwrap();
    assert_eq!(external.id, "mine+qp");
    let theirs = run(&plan_of(vec![external], Protocol::Reactive), 2);
    let own = PlannedSimulator::by_ids(&["constant-velocity+qp".to_owned()]).unwrap();
    assert_eq!(theirs, run(&plan_of(own, Protocol::Reactive), 2));
}

#[test]
fn a_run_with_another_batch_size_is_another_run() {
    let Some(child) = Child::new() else { return };
    let plan = |settings| plan_of(vec![start(settings).unwrap()], Protocol::Reactive);
    let usual = plan(child.settings("", LONG));
    drop(RunFolder::create(&child.path("run"), &usual.provenance()).unwrap());
    let other = plan(ExternalSettings { batch: Some(5), ..child.settings("", LONG) });
    let refused = RunFolder::resume(&child.path("run"), &other.provenance(), &mut other.tally());
    let refused = refused.err().unwrap().to_string();
    assert!(refused.contains("batch"), "{refused}");
}

#[test]
fn only_the_culprit_of_a_batch_fails() {
    let Some(child) = Child::new() else { return };
    let wanted = baseline(Protocol::Reactive);
    let culprit = wanted.keys().nth(5).unwrap();
    let seed = rand::Rng::next_u64(&mut stream(0, culprit, 0, Purpose::Begin));
    for (fault, message, part) in [
        ("exit3", "plan 7", "it ended with exit code 3"),
        ("kill", "begin any", "it was ended by signal 9"),
        ("stderr-and-exit", "plan 0", "CUDA error: out of memory"),
        ("failed", "plan 2", "not today"),
        ("shape", "plan 15", "`planned` cannot be used: `states` has the shape ["),
        ("cut-and-hang", "plan 3", "no `planned` within 2 s; it was ended"),
    ] {
        let arguments = format!("{fault} {message} seed:{seed}");
        let limit = if fault.contains("hang") { Duration::from_secs(2) } else { LONG };
        let simulator = start(child.settings(&arguments, limit)).unwrap();
        let (rows, failures) = run(&plan_of(vec![simulator], Protocol::Reactive), 2);
        let text = failures.values().next().map_or("", String::as_str);
        assert!(text.contains(part), "{fault}: {failures:?}");
        assert_eq!(failures.keys().collect::<Vec<_>>(), [culprit], "{fault}");
        assert_eq!(rows.len(), wanted.len() - 1, "{fault}");
        rows.iter().for_each(|(scenario, row)| assert_eq!(row, &wanted[scenario], "{fault}"));
    }
    assert_eq!(child.left_over(), 0);
}

#[test]
fn simulators_that_cannot_start_are_refused_with_their_reason() {
    let Some(child) = Child::new() else { return };
    let refusal = |settings: ExternalSettings| start(settings).err().unwrap().to_string();
    let of = |fault: &str| refusal(child.settings(fault, LONG));
    for (fault, part) in [
        ("exit2 hello", "it ended with exit code 2"),
        ("raise hello", "ValueError: the child fails on purpose"),
        ("print hello", "begins with the text \"Loading \": only frames may be written to standard output"),
        ("print hello", "\na program in Python must call `reactsim.serve` and print nothing before"),
        ("version hello", "of version \"2\" of the protocol; this program speaks 1"),
        ("failed hello", "not today"),
        ("name hello", "`welcome`: `name` is missing or empty"),
        ("digest hello", "`weights_sha256` is \"abc\" instead of 64 hexadecimal digits"),
        ("intervals hello", "`intervals` has 0: 1 to 80 steps are possible"),
        ("batch hello", "`batch` is \"0\" instead of 1 to 1024"),
        ("type hello", "it answered `pong` instead of `welcome`"),
        ("sequence hello", "`welcome` answers request 999 instead of request 0"),
    ] {
        let text = of(fault);
        assert!(text.starts_with("external program `mine` did not start: "), "{fault}: {text}");
        assert!(text.contains(part), "{fault}: {text}");
    }
    let missing = refusal(ExternalSettings::new("mine", Command::Shell("no-such-program-here".to_owned())));
    assert!(missing.contains("it ended with exit code 127") && missing.contains("not found"), "{missing}");
    let silent = refusal(ExternalSettings::new("mine", Command::Shell("exit 0".to_owned())));
    let remedy = "a program in Python must call `reactsim.serve` and print nothing before";
    assert!(silent.ends_with(&format!("exit code 0\n{remedy}")), "{silent}");
    let brief = refusal(ExternalSettings::new("mine", Command::Shell("echo hello".to_owned())));
    assert!(brief.contains(remedy), "{brief}");
    let hanging = refusal(child.settings("hang hello", Duration::from_millis(300)));
    assert!(hanging.contains("no `welcome` within 0.3 s"), "{hanging}");
    for (settings, part) in [
        (ExternalSettings::new("a b", child.command("")), "a name has 1 to 64 letters"),
        (ExternalSettings::new("mine", Command::Shell(" ".to_owned())), "the command is empty"),
        (ExternalSettings { workers: 0, ..child.settings("", LONG) }, "0 workers: 1 to 256"),
        (ExternalSettings { batch: Some(2000), ..child.settings("", LONG) }, "batches of 2000: 1 to 1024"),
    ] {
        let text = refusal(settings);
        assert!(text.contains(part), "{text}");
    }
    let simulator = ExternalSimulator::start(
        ExternalSettings { name: "idm".to_owned(), ..child.settings("", LONG) },
        outline(Protocol::Reactive),
    );
    assert!(PlannedSimulator::external(simulator.unwrap(), None).is_err(), "the name of a baseline");
    assert_eq!(child.left_over(), 0);
}

#[test]
fn the_library_takes_a_command() {
    let Some(child) = Child::new() else { return };
    let Command::Shell(line) = child.command("") else { return };
    let results = reactsim::Benchmark::shipped()
        .limit(4)
        .baseline("constant-velocity")
        .external("mine", line)
        .run()
        .unwrap();
    let mean = |id: &str| results.mean(id, "ade").unwrap();
    assert_eq!(mean("mine"), mean("constant-velocity"));
    assert!(results.table().contains("| mine ‡ "), "{}", results.table());
}

#[test]
fn batches_and_single_episodes_are_compared() {
    let Some(child) = Child::new() else { return };
    let simulator = ExternalSimulator::start(child.settings("", LONG), outline(Protocol::Reactive)).unwrap();
    let plan = plan_of(Vec::new(), Protocol::Reactive);
    let scenarios: Vec<_> =
        (plan.sources[0].open)(0).unwrap().map(|r| r.unwrap().decode().unwrap()).collect();
    let requests: Vec<_> = scenarios
        .iter()
        .map(|scenario| reactsim::rollout::Request { scenario, av: plan.av(scenario).unwrap().0, rollout: 0 })
        .collect();
    let difference = simulator.compare_batches(&requests, &plan.spec.settings());
    assert_eq!((difference.scenarios, difference.largest), (scenarios.len(), 0.0));
}

#[test]
fn episodes_go_on_when_agents_enter_in_one_of_a_batch() {
    let Some(child) = Child::new() else { return };
    let (street, still) = (street("street"), scene("still", vec![car("av", 0.0, 0.0, 0.0, 8.0)], straight()));
    let settings = settings_of(Entering::Log);
    let roll = |controller: &Controller| -> Vec<_> {
        let requests = vec![request(&street), request(&still)];
        roll_out(requests, controller, &settings)
            .into_iter()
            .map(|done| bits(&done.unwrap().tracks))
            .collect()
    };
    let simulator = ExternalSimulator::start(child.settings("", LONG), outline(Protocol::Reactive)).unwrap();
    let wanted = roll(&models::find("constant-velocity").unwrap().simulator().unwrap());
    assert_eq!(roll(&Controller::Fair(Box::new(simulator))), wanted);
    // Runs do not join them in batches in the first place.
    let simulator = start(child.settings("", LONG)).unwrap();
    let mut plan = plan_of(vec![simulator], Protocol::Reactive);
    let batch = |plan: &Plan| plan.provenance().simulators[0].external.as_ref().unwrap().batch;
    assert_eq!(batch(&plan), 4, "as it asks");
    plan.spec.rollout.entering = Some(Entering::Log);
    assert_eq!(batch(&plan), 1);
}
