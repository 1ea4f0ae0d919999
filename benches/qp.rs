//! Time of the stage of quadratic programs, on one thread, in rollouts of `qp-regression` on the shipped
//! benchmark.
//!
//! `cargo bench --bench qp`. Times are by the wall clock: nothing else should run. Programs are timed
//! together with all work for them: bounds, obstacles, linearisations, driving.
#![expect(clippy::print_stdout, reason = "the table is what this program is for")]

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use anyhow::{Context, Result};
use reactsim::formats;
use reactsim::metrics::{Case, Options, score_case};
use reactsim::models::nn::device;
use reactsim::models::qp::{self, Ending, Endings, Stage};
use reactsim::models::qp_regression::{EpisodeMemory, PlanningParameters, Policy, QpRegressionSimulator};
use reactsim::models::{find, weights};
use reactsim::rollout::{
    Controller, DeviatedAv, PlanError, Planning, Request, Settings, SingleEpisode, Stream, roll_out,
};
use reactsim::scene::{Scenario, Start};

/// Number of scenarios.
const SCENARIOS: usize = 50;
/// Number of agents from which a replan counts as large.
const LARGE: usize = 32;

fn main() -> Result<()> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/bench.parquet");
    let scenarios = formats::open(Path::new(path))?.take(SCENARIOS).collect::<Result<Vec<_>, _>>()?;
    let smooth: PlanningParameters =
        find("qp-regression").context("no such baseline")?.setup()?.parameters()?;
    let file = weights::shipped("qp-regression")?.context("no weights ship")?;
    let policy = Policy::read(&file.bytes, &device())?;
    let inner = QpRegressionSimulator::new(policy, smooth, qp::settings()?, device());
    let found = std::sync::Arc::new(Mutex::new(Found::default()));
    let timed = Timed { inner, found: found.clone() };
    let controller = Controller::Fair(Box::new(timed));
    let mut rollouts = Vec::new();
    for scenario in scenarios.iter().filter(|s| s.deviation.is_some()) {
        let begun = now();
        let rollout = roll_out(vec![request(scenario)?], &controller, &Settings::default()).remove(0)?;
        std::hint::black_box(score_case(&Case::of_rollout(scenario, rollout.tracks, Options::default())));
        rollouts.push(now() - begun);
    }
    let found = std::mem::take(&mut *found.lock().map_err(|_| anyhow::anyhow!("a rollout panicked"))?);
    found.print(rollouts);
    Ok(())
}

fn request(scenario: &Scenario) -> Result<Request<'_>> {
    let track = scenario.deviation.as_ref().context("a deviation")?.track.clone();
    let av = DeviatedAv::new(&scenario.start.now(0), track)?;
    Ok(Request { scenario, av: Some(Arc::new(av)), rollout: 0 })
}

/// Returns the wall-clock seconds since the first call.
fn now() -> f64 {
    static BEGAN: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    BEGAN.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// One replan.
struct Replan {
    agents: usize,
    network: f64,
    stage: f64,
    programs: u64,
}

#[derive(Default)]
struct Found {
    replans: Vec<Replan>,
    endings: Endings,
}

/// The simulator with a clock.
struct Timed {
    inner: QpRegressionSimulator,
    found: std::sync::Arc<Mutex<Found>>,
}

impl SingleEpisode for Timed {
    type Memory = Option<(EpisodeMemory, Stage)>;

    fn id(&self) -> &'static str {
        "timed"
    }

    fn begin(&self, start: &Start, _: &mut Stream) -> Self::Memory {
        Some((self.inner.memory(start), self.inner.stage()?))
    }

    fn plan_one(&self, kept: &mut Self::Memory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let failed = || PlanError::Failed("no stage".to_owned());
        let (memory, stage) = kept.as_mut().ok_or_else(failed)?;
        let begun = now();
        let intents = self.inner.intents(memory, episode);
        let asked = now();
        let plans = stage.plan(&episode.seen, &intents, episode.plan.steps());
        let ended = now();
        let endings = stage.take_endings();
        for (slot, plan) in plans.into_iter().enumerate() {
            for (k, state) in plan.into_iter().flatten().take(episode.plan.steps()).enumerate() {
                episode.plan.set(slot, k, Some(state));
            }
        }
        let mut found = self.found.lock().map_err(|_| failed())?;
        let replan = Replan {
            agents: episode.seen.start().agents.len(),
            network: asked - begun,
            stage: ended - asked,
            programs: endings.programs,
        };
        found.replans.push(replan);
        for (ending, n) in endings.plans {
            *found.endings.plans.entry(ending).or_default() += n;
        }
        for (iterations, n) in endings.iterations {
            *found.endings.iterations.entry(iterations).or_default() += n;
        }
        found.endings.failed += endings.failed;
        found.endings.programs += endings.programs;
        Ok(())
    }
}

impl Found {
    fn print(&self, rollouts: Vec<f64>) {
        println!("| what | mean | 10 % | half | 90 % | most | aim |\n|---|--:|--:|--:|--:|--:|--:|");
        let times =
            |of: &dyn Fn(&Replan) -> Option<f64>| self.replans.iter().filter_map(of).collect::<Vec<f64>>();
        row("network of a replan, ms", times(&|r| Some(1e3 * r.network)), "-");
        row("stage of a replan, ms", times(&|r| Some(1e3 * r.stage)), "-");
        let large = |r: &Replan| r.agents >= LARGE;
        let whole = times(&|r| large(r).then_some(1e3 * (r.network + r.stage)));
        let name = format!("whole replan of at least {LARGE} agents, ms");
        row(&name, whole, "45");
        row("agents of such a replan", times(&|r| large(r).then_some(r.agents as f64)), "-");
        let per = times(&|r| (r.programs > 0).then(|| 1e3 * r.stage / r.programs as f64));
        row("stage over programs, by replan, ms", per, "1.0 (mean)");
        let iterations = self.endings.iterations.iter();
        let iterations = iterations.flat_map(|(i, n)| std::iter::repeat_n(f64::from(*i), *n as usize));
        row("iterations of a solve", iterations.collect(), "-");
        row("80 steps with metrics, s", rollouts, "0.8");
        let programs: u64 = self.replans.iter().map(|r| r.programs).sum();
        let solves: u64 = self.endings.iterations.values().sum();
        let stage: f64 = self.replans.iter().map(|r| r.stage).sum();
        let mean = 1e3 * stage / programs as f64;
        println!("\nAll of the stage over all {programs} programs, {solves} with the solver: {mean:.3} ms.");
        let plans: u64 = self.endings.plans.values().sum();
        let part = |n: u64| 100.0 * n as f64 / plans as f64;
        let ended = Ending::ALL.iter().filter_map(|e| {
            let n = *self.endings.plans.get(e)?;
            Some(format!("{} {:.2} %", e.name(), part(n)))
        });
        println!(
            "{plans} plans: {}; failed solves: {}.",
            ended.collect::<Vec<_>>().join(", "),
            self.endings.failed
        );
    }
}

fn row(name: &str, mut values: Vec<f64>, aim: &str) {
    values.sort_by(f64::total_cmp);
    let Some(last) = values.len().checked_sub(1) else { return };
    let at = |part: f64| values[(part * last as f64).round() as usize];
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    println!(
        "| {name} | {mean:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {aim} |",
        at(0.1),
        at(0.5),
        at(0.9),
        at(1.0)
    );
}
