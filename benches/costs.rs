//! Cost per scenario of every baseline and of every metric, on one thread: what a large run will take.
//!
//! `cargo bench --bench costs [-- FILE]`; without a file the first scenarios of the shipped benchmark are
//! taken. Times are processor times of the measuring thread, the smallest of several rounds. A metric is
//! measured alone, with the intermediate results that it shares with others: the sum exceeds the cost of all.
#![expect(clippy::print_stdout, reason = "the table is what this program is for")]

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use mimalloc::MiMalloc;
use reactsim::evaluation::Source;
use reactsim::formats;
use reactsim::metrics::{self, Case, METRICS, Options};
use reactsim::models::MODELS;
use reactsim::rollout::{Av, Controller, DeviatedAv, Request, Rollout, ScriptedAv, Settings, roll_out};
use reactsim::scene::Scenario;

// As in the program.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Number of scenarios.
const SCENARIOS: usize = 16;
/// Number of rounds.
const ROUNDS: usize = 2;
/// Number of times that a metric is computed in a round: the clock of Linux has ticks of 4 ms.
const REPEATS: usize = 100;

fn main() -> Result<()> {
    let file = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let scenarios: Vec<Scenario> = match &file {
        Some(file) => formats::open(Path::new(file))?.take(SCENARIOS).collect::<Result<_, _>>()?,
        None => Source::shipped(SCENARIOS).scenarios()?.collect::<Result<_, _>>()?,
    };
    let agents: usize = scenarios.iter().map(|s| s.start.agents.len()).sum();
    let n = scenarios.len() as f64;
    println!("{n} scenarios with {:.0} agents each; milliseconds per scenario\n", agents as f64 / n);
    println!("| baseline | rollout | per plan and agent |\n|---|--:|--:|");
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    alone.install(|| -> Result<()> {
        for baseline in MODELS {
            // Baselines without weights cannot run.
            let Ok(controller) = baseline.simulator() else { continue };
            let seconds = best(|| all_rollouts(&scenarios, &controller).map(drop))?;
            let plans = 16.0 * agents as f64;
            println!("| `{}` | {:.1} | {:.3} |", baseline.id, 1e3 * seconds / n, 1e3 * seconds / plans);
        }
        let baseline = reactsim::models::find("idm").context("there is no baseline `idm`")?;
        let done = all_rollouts(&scenarios, &baseline.simulator()?)?;
        println!("\n| metric | alone |\n|---|--:|");
        for metric in METRICS {
            let seconds = judging(&scenarios, &done, |case| _ = metric.score(case, &mut Vec::new()))?;
            println!("| `{}` | {:.3} |", metric.spec().id, 1e3 * seconds / n);
        }
        let all = judging(&scenarios, &done, |case| drop(metrics::score_case(case)))?;
        println!("| all of them | {:.3} |", 1e3 * all / n);
        Ok(())
    })
}

fn all_rollouts(scenarios: &[Scenario], controller: &Controller) -> Result<Vec<Rollout>> {
    let mut done = Vec::new();
    for scenario in scenarios {
        let av: Arc<dyn Av> = match &scenario.deviation {
            Some(deviation) => Arc::new(DeviatedAv::new(scenario, deviation.track.clone())?),
            None => Arc::new(ScriptedAv::new(scenario, "brake:4".parse()?)?),
        };
        let request = Request { scenario, av: Some(av), rollout: 0 };
        for rollout in roll_out(vec![request], controller, &Settings::default()) {
            done.push(rollout?);
        }
    }
    Ok(done)
}

/// Returns the processor time of judging all rollouts once, seconds.
fn judging(scenarios: &[Scenario], rollouts: &[Rollout], judge: impl Fn(&Case<'_>)) -> Result<f64> {
    let seconds = best(|| {
        for (scenario, rollout) in (0..REPEATS).flat_map(|_| scenarios.iter().zip(rollouts)) {
            judge(&Case::of_rollout(scenario, &rollout.tracks, Options::default()));
        }
        Ok(())
    })?;
    Ok(seconds / REPEATS as f64)
}

/// Returns the smallest processor time of several rounds, seconds.
fn best(mut work: impl FnMut() -> Result<()>) -> Result<f64> {
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let begin = Instant::now();
        let before = processor_time(begin);
        work()?;
        best = best.min(processor_time(begin) - before);
    }
    Ok(best)
}

/// Returns the processor time of this thread so far, seconds; without Linux's clock the wall clock.
fn processor_time(begin: Instant) -> f64 {
    let text = fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = text.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| begin.elapsed().as_secs_f64(), |n| n * 1e-9)
}
