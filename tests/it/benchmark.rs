//! The interface `Benchmark` gives the numbers of `run`, for baselines and for simulators defined by users.

use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use reactsim::evaluation::{AvChoice, Failure, Row, RunObserver, RunSpec, read_rows};
use reactsim::formats;
use reactsim::rollout::{PlanError, Planning, Protocol, Replan, SingleEpisode, Stream};
use reactsim::scene::{Scenario, Start};
use reactsim::{Benchmark, BenchmarkError};

use crate::program::{MINI, said};
use crate::small_scenarios;

/// Every agent stays where it is.
struct Frozen;

impl SingleEpisode for Frozen {
    type Memory = ();

    fn id(&self) -> &'static str {
        "frozen"
    }

    fn begin(&self, _: &Start, _: &mut Stream) {}

    fn plan_one(&self, _: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        for agent in 0..episode.plan.agents() {
            for step in 0..episode.plan.steps() {
                episode.plan.set(agent, step, episode.seen.state(agent));
            }
        }
        Ok(())
    }
}

/// Returns the rows of a run folder, without the digest and the indices of their file.
fn rows(folder: &Path) -> Vec<(String, String, Option<u32>, String)> {
    let values =
        |row: Row| (row.scenario, row.simulator, row.rollout, serde_json::to_string(&row.metrics).unwrap());
    let mut rows: Vec<_> = read_rows(folder).unwrap().into_iter().map(values).collect();
    rows.sort();
    rows
}

#[test]
fn the_numbers_are_those_of_run() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let asked = ["--models", "idm,stop", "--av", "brake:4", "--replan", "10steps", "--seed", "3"];
    let out = at("run");
    said(&[&["run", MINI, "--out", out.to_str().unwrap()], &asked[..]].concat(), 0);
    let of = |benchmark: Benchmark| {
        benchmark
            .baselines(["idm", "stop"])
            .av("brake:4".parse().unwrap())
            .replan(Replan::every(10).unwrap())
            .seed(3)
    };
    let files = of(Benchmark::files([MINI])).folder(at("files")).run().unwrap();
    let scenarios = formats::open(Path::new(MINI)).unwrap().map(Result::unwrap);
    let memory =
        of(Benchmark::scenarios(scenarios)).threads(NonZeroUsize::MIN).folder(at("memory")).run().unwrap();
    assert_eq!(rows(&at("files")), rows(&out));
    assert_eq!(rows(&at("memory")), rows(&out));
    assert!(files.table().starts_with("| Method ") && files.table().contains("| IDM "), "{}", files.table());
    assert_eq!(files.mean("idm", "ade"), memory.mean("idm", "ade"));
    assert_eq!((files.mean("nobody", "ade"), files.mean("idm", "nothing")), (None, None));
}

#[test]
fn a_simulator_of_ones_own_has_a_row() {
    #[derive(Default)]
    struct Progress(AtomicUsize, Mutex<Vec<String>>);
    impl RunObserver for Progress {
        fn rows(&self, rows: &[Row]) {
            self.0.fetch_add(rows.len(), Ordering::Relaxed);
        }
        fn failed(&self, failure: &Failure) {
            self.1.lock().unwrap().push(failure.error.clone());
        }
    }
    let progress = Arc::new(Progress::default());
    let results = Benchmark::shipped()
        .limit(3)
        .simulator("frozen", Frozen)
        .baseline("stop")
        .rollouts(2)
        .observer(Arc::clone(&progress))
        .run()
        .unwrap();
    assert_eq!(results.summary.provenance.scenarios, 3);
    assert!(results.mean("frozen", "progress") < results.mean("stop", "progress"));
    // Two rollouts and a row for both together, per scenario and simulator.
    assert_eq!(progress.0.load(Ordering::Relaxed), 3 * 2 * 3);
    assert!(progress.1.lock().unwrap().is_empty());
}

#[test]
fn wrong_settings_are_refused() {
    let refused = |benchmark: Benchmark| benchmark.run().unwrap_err();
    assert!(matches!(refused(Benchmark::shipped()), BenchmarkError::NoSimulator));
    let stop = || Benchmark::shipped().baseline("stop");
    assert!(matches!(refused(stop().limit(0)), BenchmarkError::ZeroLimit));
    assert!(refused(stop().rollouts(0)).to_string().contains("at least 1 is needed"));
    let realism = stop().protocol(Protocol::Realism).av(AvChoice::Log);
    assert!(refused(realism).to_string().contains("leave `av` out"));
    assert!(refused(stop().baseline("stop")).to_string().contains("`stop`"));
    assert!(refused(stop().baseline("idn")).to_string().contains("`idn`"));
    assert!(refused(Benchmark::files(["/nowhere"]).baseline("stop")).to_string().contains("/nowhere"));
    assert!(refused(stop().deviations("/nowhere.json")).to_string().contains("/nowhere.json"));
    let none = Benchmark::scenarios([]).baseline("stop");
    assert!(
        matches!(refused(none), BenchmarkError::NothingRun(reason) if reason == "there are no scenarios")
    );
    // A file of deviations that the AV would not follow is refused before it is read.
    for av in [AvChoice::Log, "brake:4".parse().unwrap()] {
        let unused = refused(stop().deviations("/nowhere.json").av(av)).to_string();
        assert!(unused.contains("`deviations` goes with `av` deviated"), "{unused}");
    }
    let twice = refused(stop().deviations("/nowhere.json").av(AvChoice::File("/nowhere.json".into())));
    assert_eq!(twice.to_string(), "give either `deviations` or `av` file:<path>");
    let mut plain = small_scenarios::deviating(0, false);
    plain.id = "plain".to_owned();
    let undeviated = refused(Benchmark::scenarios([plain]).baseline("stop")).to_string();
    assert!(undeviated.contains("the scenarios have no deviated AV"), "{undeviated}");
    let unheard = refused(stop().parameter("idm", "vehicle.headway", "2.5")).to_string();
    assert!(unheard.contains("the simulator `idm`, which does not run"), "{unheard}");
    let unheard = Benchmark::shipped().simulator("frozen", Frozen).parameter("idm", "vehicle.headway", "2.5");
    let unheard = refused(unheard).to_string();
    assert!(unheard.contains("the simulator `idm`, which does not run"), "{unheard}");
    assert!(matches!(refused(stop().resume()), BenchmarkError::NoFolder));
    let stopped = stop().stop(Arc::new(AtomicBool::new(true)));
    assert!(matches!(refused(stopped), BenchmarkError::Interrupted));
}

#[test]
fn a_specification_has_its_programs_and_the_default_baselines() {
    let refused = |spec: &RunSpec| Benchmark::specified(spec.clone()).limit(1).run().unwrap_err().to_string();
    let mut spec = RunSpec::default();
    spec.subject.models = vec!["stop".to_owned()];
    spec.subject.external.external = vec!["mine=exit 3".to_owned()];
    assert!(refused(&spec).contains("did not start: it ended with exit code 3"), "{}", refused(&spec));
    spec.subject.external.external = Vec::new();
    spec.subject.external.planner = vec!["mine=exit 3".to_owned()];
    assert!(refused(&spec).contains("did not start: it ended with exit code 3"), "{}", refused(&spec));

    let ids = |benchmark: Benchmark| {
        let results = benchmark.limit(1).run().unwrap();
        results.summary.provenance.run.simulators.into_iter().map(|s| s.id).collect::<Vec<_>>()
    };
    let defaults = ids(Benchmark::shipped().baseline("default"));
    assert_eq!(ids(Benchmark::specified(RunSpec::default())), defaults);
    assert_eq!(ids(Benchmark::specified(RunSpec::default()).simulator("frozen", Frozen)), ["frozen"]);
}

#[test]
fn all_baselines_and_variants_are_those_of_run() {
    let simulators = |benchmark: Benchmark| {
        let results = benchmark.run().unwrap();
        results.summary.provenance.run.simulators.into_iter().map(|s| s.id).collect::<Vec<_>>()
    };
    let scenario = || Benchmark::scenarios([small_scenarios::scenario(0)]).batch(NonZeroUsize::MIN);
    let complete = reactsim::models::MODELS.iter().filter(|baseline| baseline.is_complete());
    let complete: Vec<_> = complete.map(|baseline| baseline.id.to_owned()).collect();
    assert_eq!(simulators(scenario().baseline("all")), complete);

    let home = tempfile::tempdir().unwrap();
    let calm = |folder: &str| {
        scenario()
            .baselines(["idm", "idm@calm"])
            .parameter("idm@calm", "vehicle.headway", "2.5")
            .folder(home.path().join(folder))
    };
    assert_eq!(simulators(calm("variants")), ["idm", "idm@calm"]);
    // A finished run is resumed without rolling anything out anew.
    let before = rows(&home.path().join("variants"));
    assert_eq!(simulators(calm("variants").resume()), ["idm", "idm@calm"]);
    assert_eq!(rows(&home.path().join("variants")), before);
    assert!(calm("variants").run().is_err(), "the folder has a run");
}

#[test]
fn deviated_and_logged_avs_mix_by_scenario() {
    let home = tempfile::tempdir().unwrap();
    let mut plain = small_scenarios::deviating(0, false);
    plain.id = "plain".to_owned();
    let deviated = small_scenarios::deviating(0, true);
    assert!(plain.deviation.is_none() && deviated.deviation.is_some());
    let run = |av: AvChoice, scenarios: &[&Scenario]| {
        let folder = home.path().join(av.to_string());
        let scenarios = scenarios.iter().map(|scenario| (*scenario).clone());
        Benchmark::scenarios(scenarios).baseline("idm").av(av).folder(&folder).run().unwrap();
        rows(&folder)
    };
    let mixed = run(AvChoice::DeviatedOrLog, &[&deviated, &plain]);
    let mut apart = run(AvChoice::Deviated, &[&deviated]);
    apart.extend(run(AvChoice::Log, &[&plain]));
    apart.sort();
    assert_eq!(mixed, apart);
}
