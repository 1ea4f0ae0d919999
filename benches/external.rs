//! Cost of the protocol of external simulators: the example `constant_velocity.py` in closed loop on the
//! shipped benchmark, on one thread.
//!
//! `cargo bench --bench external`, with a `python3` that has numpy. Times are by the wall clock and contain
//! what the example itself computes: nothing else should run.
#![expect(clippy::print_stdout, reason = "the table is what this program is for")]

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use anyhow::{Context, Result};
use reactsim::external::{Command, ExternalSettings, ExternalSimulator, RunOutline};
use reactsim::formats;
use reactsim::models::find;
use reactsim::rollout::{
    Beginning, Controller, DeviatedAv, Episode, Memory, PlanError, Request, Settings, Simulator, roll_out,
};
use reactsim::scene::{RoadMap, Scenario};

/// Scenarios of a batch.
const BATCH: usize = 16;
/// Largest time for a scenario and a plan, milliseconds.
const PLAN_TARGET: f64 = 1.0;
/// Smallest number of map points per second at the beginning.
const POINTS_TARGET: f64 = 2e6;

fn main() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scenarios = formats::open(&root.join("scenarios/bench.parquet"))?.collect::<Result<Vec<_>, _>>()?;
    let example = root.join("python/examples/constant_velocity.py");
    let python = root.join("python");
    let line = format!("PYTHONPATH='{}' exec python3 '{}'", python.display(), example.display());
    let mut settings = ExternalSettings::new("external", Command::Shell(line));
    settings.batch = Some(BATCH);
    let inner = ExternalSimulator::start(settings, RunOutline::of(&Settings::default()))?;
    let times = std::sync::Arc::new(Mutex::new(Times::default()));
    let external = Controller::Fair(Box::new(Timed { inner, times: times.clone() }));
    let own = find("constant-velocity").context("no such baseline")?.simulator()?;
    let (mut with, mut without) = (0.0, 0.0);
    for batch in scenarios.chunks(BATCH) {
        with += timed(batch, &external)?;
        without += timed(batch, &own)?;
    }
    let times = times.lock().map_err(|_| anyhow::anyhow!("a rollout panicked"))?;
    let plan = 1e3 * times.planning / times.plans as f64;
    let points = times.points as f64 / times.beginning;
    println!("{} scenarios in batches of {BATCH}, {:.1} agents each\n", scenarios.len(), times.agents());
    println!("| what | measured | target |\n|---|--:|--:|");
    println!("| a scenario and a plan, ms | {plan:.3} | at most {PLAN_TARGET} |");
    println!("| map points per second at the beginning | {points:.2e} | at least {POINTS_TARGET:.0e} |");
    println!("| rollouts, s | {with:.2} | - |");
    println!("| the same of the baseline in the program, s | {without:.2} | - |");
    Ok(())
}

/// Returns the seconds that the rollouts of a batch take.
fn timed(batch: &[Scenario], controller: &Controller) -> Result<f64> {
    let requests = batch.iter().map(request).collect::<Result<Vec<_>>>()?;
    let begun = Instant::now();
    for rollout in roll_out(requests, controller, &Settings::default()) {
        std::hint::black_box(rollout?);
    }
    Ok(begun.elapsed().as_secs_f64())
}

fn request(scenario: &Scenario) -> Result<Request<'_>> {
    let track = scenario.deviation.as_ref().context("a deviation")?.track.clone();
    let av = DeviatedAv::new(&scenario.start.now(0), track)?;
    Ok(Request { scenario, av: Some(Arc::new(av)), rollout: 0 })
}

#[derive(Default)]
struct Times {
    /// Seconds of all beginnings and of all plans.
    beginning: f64,
    planning: f64,
    /// Number of scenarios that began, and of pairs of a scenario and a plan.
    scenarios: usize,
    plans: usize,
    /// Agents and map points of the scenarios that began.
    all_agents: usize,
    points: usize,
}

impl Times {
    fn agents(&self) -> f64 {
        self.all_agents as f64 / self.scenarios as f64
    }
}

/// The external simulator with a clock.
struct Timed {
    inner: ExternalSimulator,
    times: std::sync::Arc<Mutex<Times>>,
}

impl Timed {
    fn add(&self, add: impl FnOnce(&mut Times)) {
        if let Ok(mut times) = self.times.lock() {
            add(&mut times);
        }
    }
}

impl Simulator for Timed {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let begun = Instant::now();
        let done = self.inner.begin_batch(batch);
        let seconds = begun.elapsed().as_secs_f64();
        self.add(|times| {
            times.beginning += seconds;
            times.scenarios += batch.len();
            times.all_agents += batch.iter().map(|b| b.start.agents.len()).sum::<usize>();
            times.points += batch.iter().map(|b| points(&b.start.map)).sum::<usize>();
        });
        done
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        self.inner.end_batch(memories);
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let begun = Instant::now();
        let done = self.inner.plan(batch);
        let seconds = begun.elapsed().as_secs_f64();
        self.add(|times| {
            times.planning += seconds;
            times.plans += batch.len();
        });
        done
    }
}

fn points(map: &RoadMap) -> usize {
    let lanes = map.lanes.iter().map(|lane| lane.baseline.points().len());
    let edges = map.road_edges.iter().map(|edge| edge.points.len());
    let lines = map.road_lines.iter().map(|line| line.points.len());
    lanes.chain(edges).chain(lines).sum()
}
