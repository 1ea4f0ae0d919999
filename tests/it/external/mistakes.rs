//! Ordinary mistakes of simulators: refused by name before they become numbers.

use std::sync::atomic::AtomicBool;

use reactsim::evaluation::{self, EvaluationError, Execution, Failure, Outcome, RolloutCheck, RunFolder};
use reactsim::external::ExternalSettings;
use reactsim::rollout::Protocol;

use super::{Child, LONG, baseline, execute, plan_of, start};

/// Runs a simulator with a mistake in every plan, in batches of one, with these checks allowed.
fn run_with(
    child: &Child,
    mistake: &str,
    allowed: &[RolloutCheck],
    folder: Option<&str>,
) -> (Result<Outcome, EvaluationError>, Vec<Failure>) {
    let settings = child.settings(&format!("{mistake} plan any"), LONG);
    let simulator = start(ExternalSettings { batch: Some(1), ..settings }).unwrap();
    let mut plan = plan_of(vec![simulator], Protocol::Reactive);
    plan.spec.subject.motion.allow = allowed.to_vec();
    let folder = folder.map(|name| RunFolder::create(&child.path(name), &plan.provenance()).unwrap());
    let (outcome, _, failures) = execute(&plan, 1, 1, folder.as_ref());
    (outcome, failures)
}

#[test]
fn every_mistake_stops_the_run_with_its_name() {
    let Some(child) = Child::new() else { return };
    for (mistake, check, part) in [
        ("degrees", "headings", "they look like degrees; give radians"),
        ("clockwise", "headings", "they look clockwise; give radians counter-clockwise"),
        ("swapped", "coordinates", "x and y look swapped"),
        ("teleport", "teleports", "teleport, the first:"),
        ("local", "coordinates", "each agent's own"),
        ("feet", "units", "feet in place of metres"),
        ("lag", "time", "late by one step"),
        ("stale", "time", "behind at step 1"),
        ("order", "agent-order", "the agents look exchanged"),
        ("freeze", "freeze", "stop dead and stay"),
        ("rear", "rear-axle", "poses of the rear axle"),
    ] {
        let (outcome, _) = run_with(&child, &format!("mistake-{mistake}"), &[], None);
        let Err(error @ EvaluationError::Resumable(_)) = outcome else { panic!("{mistake}: {outcome:?}") };
        let text = error.to_string();
        // A scene with few moving agents shows that they jump, and not why.
        let is_named = text.contains(part) && text.contains(check);
        let jumps =
            text.contains("from where its velocity leads at step 1") && text.contains("`allow` jumps");
        let can_be_a_jump = ["lag", "stale", "order", "rear"].contains(&mistake);
        assert!(is_named || (can_be_a_jump && jumps), "{mistake}: {text}");
    }
    assert_eq!(child.left_over(), 0);
}

#[test]
fn an_allowed_mistake_is_marked() {
    let Some(child) = Child::new() else { return };
    let (outcome, failures) = run_with(&child, "mistake-degrees", &[RolloutCheck::Headings], Some("run"));
    let Ok(Outcome::Finished(summary)) = outcome else { panic!("{outcome:?}") };
    assert_eq!(failures, []);
    let marked = summary.provenance.allowed["headings"];
    assert!(marked > 0 && marked <= summary.provenance.scenarios, "{marked}");
    let table = reactsim::report::exporter("markdown").unwrap();
    let mut text = Vec::new();
    let runs = [reactsim::report::Run { name: "", summary: &summary }];
    table.export(&runs, reactsim::report::TableStyle::default(), &mut text).unwrap();
    let text = String::from_utf8(text).unwrap();
    assert!(
        text.contains("| mine ‡¶ ") && text.contains("¶ has rollouts whose motion fails a check"),
        "{text}"
    );
    assert!(text.contains("allowed as headings"), "{text}");
}

#[test]
fn a_simulator_that_hangs_stops_the_run_and_keeps_what_is_finished() {
    let Some(child) = Child::new() else { return };
    let wanted = baseline(Protocol::Reactive);
    for (fault, part) in [("hang", "no `planned` within 1 s"), ("exit3", "it ended with exit code 3")] {
        let limit = std::time::Duration::from_secs(1);
        // The first batch of four has no fault.
        let settings = child.settings(&format!("{fault} plan any after:4"), limit);
        let plan = plan_of(vec![start(settings).unwrap()], Protocol::Reactive);
        let path = child.path(fault);
        let folder = RunFolder::create(&path, &plan.provenance()).unwrap();
        let began = std::time::Instant::now();
        let (outcome, rows, failures) = execute(&plan, 1, 1, Some(&folder));
        let Err(error @ EvaluationError::Resumable(_)) = outcome else { panic!("{fault}: {outcome:?}") };
        let text = error.to_string();
        assert!(text.contains("3 episodes in a row") && text.contains(part), "{fault}: {text}");
        assert!(began.elapsed() < std::time::Duration::from_secs(60), "{fault}");
        drop((folder, plan));
        assert_eq!(rows.len(), 2 * 4, "{fault}");
        assert_eq!(failures, [], "{fault}");

        // The same run goes on with a simulator that is mended.
        let settings = child.settings(&format!("{fault} plan any after:4"), LONG);
        std::fs::write(child.path("after"), "mended").unwrap();
        let plan = plan_of(vec![start(settings).unwrap()], Protocol::Reactive);
        let mut tally = plan.tally();
        let folder = RunFolder::resume(&path, &plan.provenance(), &mut tally).unwrap();
        let (execution, stop) = (Execution { jobs: 1, batch: 1 }, AtomicBool::new(false));
        let outcome = evaluation::run(&plan, execution, Some(&folder), tally, &(), &stop);
        let Ok(Outcome::Finished(summary)) = outcome else { panic!("{fault}: {outcome:?}") };
        assert_eq!(summary.provenance.scenarios, wanted.len(), "{fault}");
        std::fs::remove_file(child.path("after")).unwrap();
    }
}

#[test]
fn a_fault_that_a_repetition_hides_is_counted_and_logged() {
    let Some(child) = Child::new() else { return };
    let marker = child.path("marker");
    let fault = format!("stderr-and-exit plan 3 once:{}", marker.display());
    let simulator = reactsim::external::ExternalSimulator::start(
        child.settings(&fault, LONG),
        super::outline(Protocol::Reactive),
    )
    .unwrap();
    let log = child.path("external-mine.log");
    simulator.processes().set_stderr(reactsim::external::StderrTarget::File(log.clone())).unwrap();
    let external = evaluation::PlannedSimulator::external(simulator.clone(), None).unwrap();
    let plan = plan_of(vec![external], Protocol::Reactive);
    let (outcome, ..) = execute(&plan, 1, 1, None);
    let Ok(Outcome::Finished(summary)) = outcome else { panic!("{outcome:?}") };
    assert_eq!(summary.simulators["mine"].outcomes, [("planned-again".to_owned(), 4)].into());
    assert_eq!(simulator.processes().faults().map(|(n, _)| n), Some(1));
    let log = std::fs::read_to_string(log).unwrap();
    assert!(log.contains("CUDA error: out of memory"), "{log}");
    assert!(log.contains("reactsim: a batch of 4 failed: it ended with exit code 1"), "{log}");
}
