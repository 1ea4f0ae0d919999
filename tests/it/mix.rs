//! Mixed traffic: `mix:idm=0.5+stop=0.5`.

use std::num::NonZeroUsize;
use std::path::Path;

use reactsim::Benchmark;
use reactsim::evaluation::{
    Adjustments, EvaluationError, PlannedSimulator, SimulatorRecord, read_rows, read_summary,
};
use reactsim::models::ModelError;
use reactsim::models::qp::Smoothing;
use reactsim::rollout::Protocol;

use crate::program::{MINI, refused, said, text};
use crate::small_scenarios;

fn benchmark(ids: &[&str]) -> Benchmark {
    let scenarios = (0..2).map(small_scenarios::scenario);
    Benchmark::scenarios(scenarios).baselines(ids.iter().copied()).rollouts(2).seed(5)
}

/// Returns the rows of a simulator as text, without its id.
fn rows(folder: &Path, simulator: &str) -> Vec<String> {
    let own = read_rows(folder).unwrap().into_iter().filter(|row| row.simulator == simulator);
    let text = |row| serde_json::to_string(&row).unwrap().replace(simulator, "");
    let rows: Vec<String> = own.map(text).collect();
    assert!(!rows.is_empty(), "no rows of {simulator}");
    rows
}

#[test]
fn a_mix_of_one_simulator_has_its_rows() {
    let home = tempfile::tempdir().unwrap();
    for protocol in [Protocol::Reactive, Protocol::Realism] {
        let out = home.path().join(protocol.name());
        let single = ["idm", "constant-velocity", "ntp-reactive", "idm@styles", "idm+qp"];
        let mixes = single.map(|id| format!("mix:{id}=1"));
        let behind = "mix:idm=1+qp".to_owned();
        let ids: Vec<&str> =
            single.into_iter().chain(mixes.iter().chain([&behind]).map(String::as_str)).collect();
        benchmark(&ids).protocol(protocol).folder(&out).run().unwrap();
        for (id, mix) in single.iter().zip(&mixes).chain([(&"idm+qp", &behind)]) {
            assert_eq!(rows(&out, id), rows(&out, mix), "{mix}");
        }
        assert_ne!(rows(&out, "idm"), rows(&out, "idm@styles"));
    }
}

#[test]
fn rows_of_a_mix_depend_on_neither_threads_nor_batches_nor_order() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name);
    let (given, id) =
        ("mix:ntp-guarded=0.5+idm=0.5+pedestrian=stop", "mix:idm=0.5+ntp-guarded=0.5+pedestrian=stop");
    let one = benchmark(&[given]).threads(NonZeroUsize::MIN).batch(NonZeroUsize::MIN);
    one.folder(at("one")).run().unwrap();
    let two = NonZeroUsize::new(2).unwrap();
    benchmark(&["idm", id, "ntp-guarded"]).threads(two).batch(two).folder(at("two")).run().unwrap();
    assert_eq!(rows(&at("one"), id), rows(&at("two"), id));
    for other in ["idm", "ntp-guarded"] {
        assert_ne!(rows(&at("two"), id), rows(&at("two"), other));
    }
    let other_seed = benchmark(&[id]).seed(6);
    other_seed.folder(at("seed")).run().unwrap();
    assert_ne!(rows(&at("one"), id), rows(&at("seed"), id));
}

#[test]
fn the_provenance_states_the_members() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("run");
    let models = "idm,mix:ntp-reactive=0.5,idm@calm=.50,pedestrian=stop,stop";
    let arguments = ["run", MINI, "--limit", "1", "--out", text(&out), "--models", models];
    let set = ["--set", "idm@calm.vehicle.headway=2", "--set", "stop.deceleration=2"];
    let (table, _) = said(&[&arguments[..], &set].concat(), 0);
    assert!(table.contains("Mix (IDM (calm) 0.5, NTP-reactive 0.5, pedestrians Stop)"), "{table}");
    assert_eq!(table.matches("stop with deceleration=2.0").count(), 1, "{table}");
    let simulators = read_summary(&out).unwrap().provenance.run.simulators;
    let ids: Vec<&str> = simulators.iter().map(|simulator| simulator.id.as_str()).collect();
    assert_eq!(ids, ["idm", "mix:idm@calm=0.5+ntp-reactive=0.5+pedestrian=stop", "stop"]);
    let mix: &SimulatorRecord = &simulators[1];
    assert!(mix.is_network() && !simulators[0].is_network());
    let parts: Vec<(&str, usize, bool)> =
        mix.parts().iter().map(|m| (m.id.as_str(), m.parameters.len(), m.weights.is_some())).collect();
    assert_eq!(parts, [("idm@calm", 1, false), ("ntp-reactive", 0, true), ("stop", 1, false)]);
    assert_eq!(simulators[0].parts(), &simulators[..1]);
    // The canonical id names the same run.
    let models = ids.join(",");
    let arguments = ["run", MINI, "--limit", "1", "--out", text(&out), "--resume", "--models", &models];
    assert_eq!(said(&[&arguments[..], &set].concat(), 0).0, table);
}

#[test]
fn a_mix_may_drive_the_av() {
    let av = "planner:simulator:mix:idm=1+constant-velocity=1".parse().unwrap();
    let results = benchmark(&["stop"]).av(av).run().unwrap();
    let driver = results.summary.provenance.run.driver.unwrap();
    assert_eq!(driver.id, "mix:constant-velocity=1+idm=1");
}

#[test]
fn the_stage_follows_a_mix_of_simulators_that_take_it() {
    let asked = Adjustments { smoothing: Some(Smoothing::Full), ..Adjustments::default() };
    let ids = ["mix:idm=1+stop=1", "mix:idm=1+ntp-guarded=1", "mix:idm+qp=1+stop=1"].map(str::to_owned);
    let all = PlannedSimulator::adjusted(&ids, &asked).unwrap();
    let ids: Vec<&str> = all.iter().map(|simulator| simulator.id.as_str()).collect();
    assert_eq!(ids, ["mix:stop=1+idm=1+qp", "mix:idm=1+ntp-guarded=1", "mix:stop=1+idm+qp=1"]);
    assert_eq!(all[0].title, "Mix (Stop 1, IDM 1) + qp");
    let error = PlannedSimulator::by_ids(&["mix:idm=1+ntp-guarded=1+qp".to_owned()]).err().unwrap();
    assert!(
        matches!(error, EvaluationError::Model(ModelError::TakesNoStage { id: "ntp-guarded" })),
        "{error}"
    );
}

#[test]
fn invalid_mixes_are_refused_by_name() {
    for (models, parts) in [
        ("mix:imd=0.5+stop=0.5", &["there is no baseline `imd`", "did you mean `idm`?"][..]),
        ("mix:idm=1+pedestrian=stpo", &["there is no baseline `stpo`", "did you mean `stop`?"]),
        ("mix:idm=1,stop=inf", &["the share of `stop` is `inf`"]),
        ("mix:idm=1,mix:idm=1.0", &["the simulator `mix:idm=1` is named twice"]),
        ("mix:idm=1+log-replay=1", &["`log-replay` observes the logged future"]),
        ("mix:default=1", &["there is no baseline `default`"]),
        ("mix:smart=1", &["the simulator `smart` needs weights"]),
        ("idm=0.5", &["there is no simulator `idm=0.5`"]),
    ] {
        let error = refused(&["run", MINI, "--models", models]);
        assert!(parts.iter().all(|part| error.contains(part)), "{models}: {error}");
    }
    let asked = [("mix:idm=1".to_owned(), "vehicle.headway".to_owned(), "2".to_owned())];
    let asked = Adjustments { parameters: asked.into(), ..Adjustments::default() };
    let error = PlannedSimulator::adjusted(&["mix:idm=1".to_owned()], &asked).err().unwrap();
    assert!(error.to_string().contains("a mix has no parameters or weights"), "{error}");
    let error = refused(&["run", MINI, "--models", "mix:idm=1", "--set", "stop.deceleration=2"]);
    assert!(error.contains("`stop`, which does not run"), "{error}");
}
