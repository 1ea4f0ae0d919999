//! External planners: the same rows as a planner of this program, and no fault stalls or falsifies a run.

use std::time::Duration;

use reactsim::evaluation::Driver;
use reactsim::external::{ExternalError, ExternalPlanner, ExternalSettings};
use reactsim::planning::planner::{Planner, PlannerInput};
use reactsim::planning::tracking::Controller;
use reactsim::planning::{PlanningError, Trajectory};
use reactsim::rollout::{Protocol, Purpose, stream};

use super::{Child, LONG, Results, driven, outline, run, start};

/// Constant velocity over two seconds, with the operations of the child.
struct Straight;

impl Planner for Straight {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let now = input
            .seen
            .and_then(|seen| seen.state(0))
            .ok_or_else(|| PlanningError("the AV is absent".to_owned()))?;
        let ahead = (1..=20).map(|k| 0.1 * f64::from(k));
        let poses: Vec<[f64; 3]> =
            ahead.map(|t| [now.x + now.vx * t, now.y + now.vy * t, now.heading]).collect();
        Ok(Trajectory::through_centers(&poses, input.ego(), input.shape)?)
    }
}

fn driver(settings: ExternalSettings) -> Result<Driver, ExternalError> {
    Ok(Driver::external(ExternalPlanner::start(settings, outline(Protocol::Reactive))?))
}

/// Returns the results with a planner of this program.
fn own(controller: Controller, every: usize) -> Results {
    let results = run(
        &driven("constant-velocity", Driver::own("straight", || Box::new(Straight)), controller, every),
        2,
    );
    assert!(results.0.len() >= 12 && results.1.is_empty(), "{:?}", results.1);
    results
}

#[test]
fn it_gives_the_rows_of_a_planner_of_the_program_on_any_number_of_workers_and_threads() {
    let Some(child) = Child::new() else { return };
    for (controller, every) in [(Controller::LqrBicycle, 1), (Controller::PerfectTracking, 5)] {
        let wanted = own(controller, every);
        for (workers, jobs) in [(1, 1), (1, 3), (3, 2)] {
            let settings = ExternalSettings { workers, ..child.settings("", LONG) };
            let found = run(&driven("constant-velocity", driver(settings).unwrap(), controller, every), jobs);
            assert_eq!(found, wanted, "{workers} workers, {jobs} threads");
        }
    }
    assert_eq!(child.left_over(), 0);
}

#[test]
fn more_workers_than_possible_are_refused_before_any_starts() {
    let Some(child) = Child::new() else { return };
    for workers in [0, 257, 100_000_000_000] {
        let error = driver(ExternalSettings { workers, ..child.settings("", LONG) }).err().unwrap();
        assert!(error.to_string().contains(&format!("{workers} workers: 1 to 256 are possible")), "{error}");
    }
    assert_eq!(child.left_over(), 0);
}

#[test]
fn a_process_that_ends_loses_nothing() {
    let Some(child) = Child::new() else { return };
    let wanted = own(Controller::LqrBicycle, 5);
    for (name, fault) in [("a", "exit3 plan 7"), ("b", "kill begin 4"), ("c", "cut50 plan 15")] {
        let arguments = format!("{fault} once:{}", child.path(name).display());
        let driver = driver(child.settings(&arguments, LONG)).unwrap();
        let found = run(&driven("constant-velocity", driver, Controller::LqrBicycle, 5), 2);
        assert_eq!(found, wanted, "{fault}");
        assert!(child.path(name).exists(), "{fault}: it happened");
    }
    assert_eq!(child.left_over(), 0);
}

#[test]
fn only_the_culprit_fails() {
    let Some(child) = Child::new() else { return };
    let (wanted, _) = own(Controller::LqrBicycle, 5);
    let culprit = wanted.keys().nth(5).unwrap();
    let seed = rand::Rng::next_u64(&mut stream(0, culprit, 0, Purpose::AvBegin));
    for (fault, message, part) in [
        ("exit3", "plan 7", "does not drive the AV to step 36: it ended with exit code 3"),
        ("kill", "begin any", "it was ended by signal 9"),
        ("failed", "plan 2", "not today"),
        ("errors", "plan 2", "the planner reports: not this one"),
        ("shape", "plan 3", "`trajectory` has the shape [60] instead of [1, 5 to 80, 3]"),
        ("one-pose", "plan 3", "`trajectory` has 1 poses; it needs 5, the steps until the next plan, to 80"),
        ("nan", "plan 0", "x of pose 1 is NaN, expected metres"),
        ("present", "plan 2", "`present`: x of pose 0 is NaN, expected metres"),
        ("far", "plan 4", "state 1 of the trajectory is reached at"),
        ("cut-and-hang", "plan 3", "no `planned` within 2 s; it was ended"),
    ] {
        let limit = if fault.contains("hang") { Duration::from_secs(2) } else { LONG };
        let settings = child.settings(&format!("{fault} {message} seed:{seed}"), limit);
        let plan = driven("constant-velocity", driver(settings).unwrap(), Controller::LqrBicycle, 5);
        let (rows, failures) = run(&plan, 2);
        let text = failures.values().next().map_or("", String::as_str);
        assert!(text.contains(part), "{fault}: {failures:?}");
        assert_eq!(failures.keys().collect::<Vec<_>>(), [culprit], "{fault}");
        assert_eq!(rows.len(), wanted.len() - 1, "{fault}");
        rows.iter().for_each(|(scenario, row)| assert_eq!(row, &wanted[scenario], "{fault}"));
    }
    assert_eq!(child.left_over(), 0);
}

#[test]
fn a_planner_is_no_simulator() {
    let Some(child) = Child::new() else { return };
    // The child is what it is asked to be; this one states the other role.
    let program = include_str!("child.py").replace("role=role", "role=other[role]").replace(
        "def main():",
        "other = {\"planner\": \"simulator\", \"simulator\": \"planner\"}\n\n\ndef main():",
    );
    std::fs::write(child.path("child.py"), program).unwrap();
    let error = driver(child.settings("", LONG)).err().unwrap().to_string();
    assert!(error.contains("states that it is a simulator, and is used as a planner"), "{error}");
    let error = start(child.settings("", LONG)).err().unwrap().to_string();
    assert!(error.contains("states that it is a planner, and is used as a simulator"), "{error}");
}
