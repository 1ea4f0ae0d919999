//! Scripted faults: every one at every message. No run hangs, and every scenario has its right row or a
//! failure.

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use reactsim::external::ExternalSettings;
use reactsim::rollout::Protocol;
use serde_json::Value;

use super::{Child, baseline, execute, plan_of, run, start};
use crate::program::words;

/// Faults that end or break the connection at once.
const ABRUPT: &str = "exit0 exit1 kill raise close-both garbage zeros cut3 cut50 cut99 huge large empty \
                      no-metadata version type sequence no-sequence header not-json print grandchild \
                      stderr-and-exit";

/// Faults that the simulator reports, or that leave the connection in order.
const REPORTED: &str = "failed failed-silently stderr slow";

/// Faults in the content of a plan.
const CONTENT: &str = "missing shape short dtype nan inf -inf 1e9 errors errors-wrong errors-far";

/// Faults that only a time limit ends.
const HANGING: &str = "hang stop ignore-signals close-stdin cut-and-hang";

/// Runs a simulator with a fault. With `once`, only the first process has the fault.
fn check(child: &Child, fault: &str, limit: Duration, once: bool, number: usize) {
    check_with(child, fault, limit, once, number, 1);
}

fn check_with(child: &Child, fault: &str, limit: Duration, once: bool, number: usize, workers: usize) {
    let wanted = baseline_once();
    let marker = child.path(&format!("marker-{number}"));
    let condition = if once { format!("once:{}", marker.display()) } else { String::new() };
    let began = Instant::now();
    let settings = child.settings(&format!("{fault} {condition}"), limit);
    let simulator = start(ExternalSettings { workers, ..settings });
    let Ok(simulator) = simulator else { panic!("{fault}: it starts without a fault") };
    let (rows, failures) = run(&plan_of(vec![simulator], Protocol::Reactive), 2);
    assert!(began.elapsed() < Duration::from_secs(120), "{fault}");
    assert_eq!(rows.len() + failures.len(), wanted.len(), "{fault}: {failures:?}");
    rows.iter().for_each(|(scenario, row)| assert_eq!(row, &wanted[scenario], "{fault}"));
    failures.values().for_each(|text| assert!(text.len() > 20, "{fault}: {text}"));
    if once && !words(CONTENT).iter().any(|content| fault.starts_with(content)) {
        assert_eq!(failures.len(), 0, "{fault}: {failures:?}");
    }
}

fn baseline_once() -> &'static BTreeMap<String, Value> {
    static ROWS: OnceLock<BTreeMap<String, Value>> = OnceLock::new();
    ROWS.get_or_init(|| baseline(Protocol::Reactive))
}

fn assert_none_left(child: &Child) {
    let deadline = Instant::now() + Duration::from_secs(5);
    while child.left_over() > 0 {
        assert!(Instant::now() < deadline, "{} processes are left", child.left_over());
        sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_fault_in_one_process_costs_nothing() {
    let Some(child) = Child::new() else { return };
    let mut number = 0;
    for message in ["begin 0", "plan 3", "end 0"] {
        for fault in words(ABRUPT).into_iter().chain(words(REPORTED)) {
            number += 1;
            check(&child, &format!("{fault} {message}"), Duration::from_secs(60), true, number);
        }
    }
    for (fault, message) in [("twice", "plan 2"), ("flood", "plan 2"), ("twice", "begin 0")] {
        number += 1;
        check(&child, &format!("{fault} {message}"), Duration::from_secs(60), true, number);
    }
    assert_none_left(&child);
}

#[test]
fn a_fault_in_every_process_fails_scenarios_and_nothing_else() {
    let Some(child) = Child::new() else { return };
    for (number, fault) in words(CONTENT).iter().enumerate() {
        check(&child, &format!("{fault} plan 4"), Duration::from_secs(60), false, number);
    }
    assert_none_left(&child);
}

#[test]
fn a_fault_that_ends_every_process_ends_the_run() {
    let Some(child) = Child::new() else { return };
    for fault in &words(ABRUPT)[..6] {
        let simulator = start(child.settings(&format!("{fault} plan 4"), Duration::from_secs(60))).unwrap();
        let plan = plan_of(vec![simulator], Protocol::Reactive);
        let error = execute(&plan, 2, 3, None).0.unwrap_err();
        assert!(error.to_string().contains("3 episodes in a row ended its process"), "{fault}: {error}");
    }
    assert_none_left(&child);
}

#[test]
fn a_hanging_process_is_ended_in_time() {
    let Some(child) = Child::new() else { return };
    for (number, fault) in words(HANGING).iter().enumerate() {
        for message in ["begin 0", "plan 6"] {
            let number = 100 * number + message.len();
            check(&child, &format!("{fault} {message}"), Duration::from_secs(3), true, number);
        }
    }
    assert_none_left(&child);
}

#[test]
#[ignore = "takes ten minutes: every fault at many messages, in one process or in all"]
fn a_thousand_faults() {
    let Some(child) = Child::new() else { return };
    let all: Vec<&str> = [ABRUPT, REPORTED, HANGING, "twice flood"].into_iter().flat_map(words).collect();
    let mut number = 0;
    for message in ["begin 0", "begin 1", "plan 0", "plan 1", "plan 7", "plan 15", "end 0", "end 1"] {
        let mut faults = all.clone();
        if message.starts_with("plan") {
            faults.extend(words(CONTENT));
        }
        for fault in faults {
            for (once, workers) in [(true, 1), (true, 3), (false, 1), (false, 2)] {
                // Several episodes in a row that end their process end the run.
                if !once && !words(CONTENT).contains(&fault) && !words(REPORTED).contains(&fault) {
                    continue;
                }
                number += 1;
                let is_hanging = words(HANGING).contains(&fault);
                let limit = Duration::from_secs(if is_hanging { 2 } else { 60 });
                check_with(&child, &format!("{fault} {message}"), limit, once, number, workers);
            }
        }
        assert_none_left(&child);
    }
    assert!(number >= 600, "only {number} faults");
}
