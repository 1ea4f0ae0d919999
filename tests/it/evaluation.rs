//! Runs give the same bytes however they are carried out.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use reactsim::evaluation::{
    self, EVENTS, EvaluationError, Execution, Outcome, Plan, PlannedSimulator, ROWS, RunFolder, RunObserver,
    SUMMARY, Source, Summary,
};

use crate::program::copy;
use crate::small_scenarios::{self, certified, source, source_of};

fn plan_of(sources: Vec<Source>, models: &[&str], rollouts: u32) -> Plan {
    let ids: Vec<String> = models.iter().map(|m| (*m).to_owned()).collect();
    let mut plan = small_scenarios::plan(sources, PlannedSimulator::by_ids(&ids).unwrap());
    plan.spec.rollout.rollouts = rollouts;
    plan
}

fn plan(rollouts: u32) -> Plan {
    let sources = vec![source("a", (0..6).collect()), source("b", (6..9).collect())];
    plan_of(sources, &["log-replay", "constant-velocity", "stop"], rollouts)
}

fn run(plan: &Plan, folder: &Path, resume: bool, jobs: usize, batch: usize) -> Summary {
    let mut tally = plan.tally();
    let folder = if resume {
        RunFolder::resume(folder, &plan.provenance(), &mut tally).unwrap()
    } else {
        RunFolder::create(folder, &plan.provenance()).unwrap()
    };
    let execution = Execution { jobs, batch };
    let stop = AtomicBool::new(false);
    match evaluation::run(plan, execution, Some(&folder), tally, &(), &stop).unwrap() {
        Outcome::Finished(summary) => *summary,
        Outcome::Interrupted => panic!("nobody interrupted"),
    }
}

fn files(folder: &Path) -> [Vec<u8>; 3] {
    [SUMMARY, ROWS, EVENTS].map(|name| fs::read(folder.join(name)).unwrap())
}

#[test]
fn threads_and_batches_change_no_byte() {
    let home = tempfile::tempdir().unwrap();
    let mut all = Vec::new();
    for jobs in [1, 2, 7] {
        for batch in [1, 3, 64] {
            let folder = home.path().join(format!("{jobs}-{batch}"));
            run(&plan(2), &folder, false, jobs, batch);
            all.push(files(&folder));
        }
    }
    assert!(all[0].iter().all(|f| !f.is_empty()), "the runs have rows and events");
    assert!(all.windows(2).all(|w| w[0] == w[1]));
}

#[test]
fn a_cut_run_goes_on_to_the_same_bytes() {
    let home = tempfile::tempdir().unwrap();
    let whole = home.path().join("whole");
    run(&plan(2), &whole, false, 2, 2);
    let wanted = files(&whole);
    let length = wanted[1].len();
    for (i, cut) in [0, 1, length / 7, length / 2, length / 2 + 1, length - 1, length].into_iter().enumerate()
    {
        let folder = copy(&whole, &home.path().join(format!("cut-{i}")));
        fs::remove_file(folder.join(SUMMARY)).unwrap();
        fs::write(folder.join(ROWS), &wanted[1][..cut]).unwrap();
        run(&plan(2), &folder, true, 1 + i % 3, 1 + i);
        assert_eq!(files(&folder), wanted, "cut at {cut} of {length}");
    }
}

#[test]
fn a_finished_run_resumes_to_itself_and_an_absent_one_begins() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("run");
    run(&plan(1), &folder, true, 2, 2);
    let wanted = files(&folder);
    // Partial files that a kill left behind are removed.
    let halves = [".summary.json.1.partial", ".rollouts.parquet.1.partial"].map(|n| folder.join(n));
    halves.iter().for_each(|half| fs::write(half, "half").unwrap());
    run(&plan(1), &folder, true, 2, 2);
    assert_eq!(files(&folder), wanted);
    assert!(!halves.iter().any(|half| half.exists()));
}

#[test]
fn an_interrupted_run_leaves_a_folder_that_goes_on() {
    /// Interrupts after the first batch.
    struct Impatient<'a>(&'a AtomicBool, AtomicUsize);
    impl RunObserver for Impatient<'_> {
        fn scenario_done(&self, _: usize) {
            self.1.fetch_add(1, Ordering::Relaxed);
            self.0.store(true, Ordering::Relaxed);
        }
    }
    let home = tempfile::tempdir().unwrap();
    let (whole, cut) = (home.path().join("whole"), home.path().join("cut"));
    run(&plan(1), &whole, false, 1, 2);
    let plan = plan(1);
    let stop = AtomicBool::new(false);
    let observer = Impatient(&stop, AtomicUsize::new(0));
    let folder = RunFolder::create(&cut, &plan.provenance()).unwrap();
    let execution = Execution { jobs: 1, batch: 2 };
    let outcome = evaluation::run(&plan, execution, Some(&folder), plan.tally(), &observer, &stop).unwrap();
    assert!(matches!(outcome, Outcome::Interrupted));
    assert_eq!(observer.1.load(Ordering::Relaxed), 1);
    assert!(!cut.join(SUMMARY).exists());
    drop(folder);
    run(&plan, &cut, true, 2, 1);
    assert_eq!(files(&cut), files(&whole));
}

#[test]
fn another_setting_is_refused_by_name() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("run");
    run(&plan(1), &folder, false, 1, 1);
    let mut other = plan(1);
    other.spec.subject.seed = 3;
    let refused = RunFolder::resume(&folder, &other.provenance(), &mut other.tally()).unwrap_err();
    assert!(refused.to_string().contains("`seed` is 0 there and 3 now"), "{refused}");
    let more = plan_of(vec![source("a", vec![0])], &["stop"], 1);
    assert!(RunFolder::resume(&folder, &more.provenance(), &mut more.tally()).is_err());
    assert!(matches!(RunFolder::create(&folder, &plan(1).provenance()), Err(EvaluationError::Resumable(_))));
}

#[test]
fn of_two_scenarios_with_one_id_the_later_fails() {
    let home = tempfile::tempdir().unwrap();
    for jobs in [1, 4] {
        let sources = vec![source("a", vec![1, 2]), source("b", vec![3, 2])];
        let summary =
            run(&plan_of(sources, &["stop"], 1), &home.path().join(jobs.to_string()), false, jobs, 1);
        assert_eq!(summary.simulators["stop"].scenarios, 3);
        assert_eq!(summary.simulators["stop"].failed, 1);
        let failure = &summary.provenance.failures[0];
        assert_eq!((failure.input, failure.record), (1, 1));
        let wanted =
            "b: record 1: scenario `road-002`: the id is taken by record 1 of a; give each scenario once";
        assert_eq!(failure.error, wanted);
    }
}

#[test]
fn numbers_are_what_the_rows_say() {
    let home = tempfile::tempdir().unwrap();
    let summary = run(&plan(2), home.path(), false, 2, 4);
    let replay = &summary.simulators["log-replay"];
    assert!(replay.oracle);
    assert_eq!((replay.scenarios, replay.failed), (9, 0));
    // The AV brakes to a halt in front of its follower, which replays its log and hits the AV.
    assert_eq!(replay.metrics["aav-collision"].mean, Some(1.0));
    assert_eq!(replay.pressure.share_at_fault_collision, Some(1.0));
    assert_eq!(replay.metrics["ade"].mean, Some(0.0));
    assert_eq!(replay.by_category.len(), 3);
    assert_eq!(replay.by_category["lateral"].scenarios, 3);
    assert!(replay.paired_to_log_replay.is_empty());
    let stop = &summary.simulators["stop"];
    let (mean, log) = (stop.metrics["ade"].mean.unwrap(), stop.paired_to_log_replay["ade"].mean.unwrap());
    assert!((mean - log).abs() < 1e-12 && mean > 1.0);
    assert!(summary.deviation["endpoint_longitudinal"].mean.unwrap() < -10.0);
    // The kinematic likelihood and minADE judge both rollouts together.
    assert!(stop.metrics["kinematic-likelihood"].mean.is_some());
    let text = fs::read_to_string(home.path().join(ROWS)).unwrap();
    assert_eq!(text.lines().count(), 9 * 3 * (2 + 1));
    assert_eq!(serde_json::from_str::<Summary>(&summary.to_json()).unwrap(), summary);
    // Without certificates, difficulties and over-reaction are unknown.
    assert!(!summary.to_json().contains("by_difficulty"));
    assert_eq!(stop.metrics["over-reaction"].mean, None);
}

#[test]
fn certificates_tell_difficulty_and_over_reaction() {
    let home = tempfile::tempdir().unwrap();
    let sources = vec![source_of("certified", (0..7).collect(), certified)];
    let summary = run(&plan_of(sources, &["log-replay", "stop"], 1), home.path(), false, 1, 4);
    let replay = &summary.simulators["log-replay"];
    let sizes: Vec<(&str, usize)> =
        replay.by_difficulty.iter().map(|(name, part)| (name.as_str(), part.scenarios)).collect();
    assert_eq!(sizes, [("easy", 3), ("hard", 2), ("medium", 2)]);
    // Its only responder drives into the AV.
    assert_eq!(replay.metrics["over-reaction"].mean, None);
    assert_eq!(replay.metrics["undisturbed-loss"].mean, Some(0.0));
    assert_eq!(replay.metrics["log-clinging"].mean, Some(1.0));
    let stop = &summary.simulators["stop"];
    assert_eq!(stop.metrics["undisturbed-loss"].scenarios, 7);
    assert!(stop.metrics["undisturbed-loss"].mean.unwrap() > 10.0);
    assert_eq!(stop.by_difficulty["hard"].metrics["undisturbed-loss"].scenarios, 2);
    assert_eq!(serde_json::from_str::<Summary>(&summary.to_json()).unwrap(), summary);
}
