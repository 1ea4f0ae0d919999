//! Speed of planning by networks for batches of episodes, on a backend of choice.
//!
//! `cargo bench --bench batches [-- BACKEND [SIZES]]`, for instance
//! `cargo bench --features cuda --bench batches -- cuda 1,4,16,64,256`. Without arguments: the default
//! backend and batches of 1, 4, 16, 64 and 256. Episodes are rollouts of the shipped scenarios, replanned at
//! 2 Hz, on one thread. Times are by the wall clock, the best of several rounds.
#![expect(clippy::print_stdout, reason = "the table is what this program is for")]

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use reactsim::formats;
use reactsim::geometry::Vec2;
use reactsim::models::find;
use reactsim::models::learning::Provenance;
use reactsim::models::nn::{Backend, Initializer, check_backend, device_of};
use reactsim::models::ntp::Sampling;
use reactsim::models::ntp::smart::{Smart, SmartConfig, SmartParameters, SmartPolicy, SmartSimulator};
use reactsim::models::ntp::tokens::{CURVE_POINTS, Kinematic, MapVocabulary, TokenPoses, Vocabulary};
use reactsim::models::perception::Class;
use reactsim::rollout::{
    Beginning, Controller, Episode, LogAv, Memory, PlanError, Request, Settings, Simulator, roll_out,
};
use reactsim::scene::{FUTURE, Scenario};

/// Number of measured rounds, after one that is not measured.
const ROUNDS: usize = 3;
/// Sizes of batches if none are given.
const SIZES: &str = "1,4,16,64,256";

/// The published network of 7 million parameters.
const SMART_7M: &str = r#"{"hidden_dim": 128, "num_freq_bands": 64, "num_heads": 8, "head_dim": 16, "dropout": 0.1,
    "num_map_layers": 3, "num_agent_layers": 6, "pl2pl_radius": 10, "pl2a_radius": 30, "a2a_radius": 60, "time_span": 30,
    "n_token_agent": 2048, "n_params": 7001024}"#;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1).filter(|a| !a.starts_with("--"));
    let backend: Backend = arguments.next().map_or(Ok(Backend::default()), |name| name.parse())?;
    check_backend(backend)?;
    let sizes = arguments.next().unwrap_or_else(|| SIZES.to_owned());
    let size = |s: &str| s.parse().with_context(|| format!("batch size `{s}`: expected a number"));
    let sizes: Vec<usize> = sizes.split(',').map(size).collect::<Result<_>>()?;
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/bench.parquet"));
    let scenarios = formats::open(path)?.collect::<Result<Vec<_>, _>>()?;

    println!("Backend {backend}\n");
    println!("| network | batch | agents | start | plan | agent-steps/s | agent-steps/s with the start |");
    println!("|---|--:|--:|--:|--:|--:|--:|");
    for name in ["ntp-reactive", "smart-small", "smart 7 M, random weights"] {
        let times = Arc::<Mutex<Times>>::default();
        let inner = match name {
            "smart 7 M, random weights" => Box::new(published(backend)?),
            id => shipped(id, backend)?,
        };
        let controller = Controller::Fair(Box::new(Timed { inner, times: times.clone() }));
        for &size in &sizes {
            measure(name, &controller, &times, &scenarios, size)?;
        }
    }
    Ok(())
}

/// Returns a baseline with its shipped weights.
fn shipped(id: &'static str, backend: Backend) -> Result<Box<dyn Simulator>> {
    let baseline = find(id).with_context(|| format!("no baseline `{id}`"))?;
    let mut setup = baseline.setup()?;
    setup.backend = backend;
    match (baseline.make)(setup)? {
        Controller::Fair(simulator) => Ok(simulator),
        Controller::Oracle(_) => anyhow::bail!("`{id}` is an oracle"),
    }
}

/// Returns the published network with random weights, with as many tokens as it has.
fn published(backend: Backend) -> Result<SmartSimulator> {
    let device = device_of(backend);
    let config = SmartConfig::from_json(SMART_7M)?;
    let counts = config.n_token_agent.of_classes();
    let motions = Kinematic::default().build()?;
    let tokens = Class::ALL.map(|class| -> Vec<TokenPoses> {
        let count = counts[class as usize];
        (0..count).map(|token| *motions.poses(class, token % motions.tokens(class))).collect()
    });
    let curve = |token: usize| -> [Vec2; CURVE_POINTS] {
        let bend = 0.1 * (token as f64 / config.n_token_map as f64 - 0.5);
        let point = |x: f64| Vec2::new(x, bend * x * x);
        std::array::from_fn(|k| point(0.5 * k as f64))
    };
    let curves: Vec<_> = (0..config.n_token_map).map(curve).collect();
    let policy = SmartPolicy::new(
        Smart::init(&config, &mut Initializer::new(1, &device))?,
        Vocabulary::new(tokens, Provenance::default())?,
        MapVocabulary::new(&curves, Provenance::default())?,
        &device,
    )?;
    let sampling = Sampling { top_k: 5, temperature: 1.0 };
    let parameters = SmartParameters { projection: false, map_radius: 150.0, height: 1.8, sampling };
    Ok(SmartSimulator::new("smart", policy, parameters))
}

/// Times that a simulator took.
#[derive(Clone, Copy, Debug, Default)]
struct Times {
    /// For the start of all episodes.
    begin: Duration,
    /// For all plans.
    plan: Duration,
    /// Number of plans of the batch.
    plans: u32,
}

/// A simulator whose time is measured, without that of the protocol.
struct Timed {
    inner: Box<dyn Simulator>,
    times: Arc<Mutex<Times>>,
}

impl Simulator for Timed {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let before = Instant::now();
        let result = self.inner.begin_batch(batch);
        self.times.lock().unwrap_or_else(PoisonError::into_inner).begin += before.elapsed();
        result
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        self.inner.end_batch(memories);
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let before = Instant::now();
        let result = self.inner.plan(batch);
        let mut times = self.times.lock().unwrap_or_else(PoisonError::into_inner);
        times.plan += before.elapsed();
        times.plans += 1;
        result
    }
}

/// Prints the speed for batches of this size: as many scenarios as there are, then further rollouts of them.
fn measure(
    name: &str,
    controller: &Controller,
    times: &Mutex<Times>,
    scenarios: &[Scenario],
    size: usize,
) -> Result<()> {
    let scenario = |i: usize| &scenarios[i % scenarios.len()];
    // The AV is moved from outside.
    let agents: usize = (0..size).map(|i| scenario(i).start.agents.len() - 1).sum();
    let mut best: Option<Times> = None;
    for round in 0..=ROUNDS {
        let request = |i: usize| -> Result<Request<'_>> {
            let av = Arc::new(LogAv::new(scenario(i))?);
            Ok(Request { scenario: scenario(i), av: Some(av), rollout: (i / scenarios.len()) as u32 })
        };
        let batch = (0..size).map(request).collect::<Result<Vec<_>>>()?;
        *times.lock().unwrap_or_else(PoisonError::into_inner) = Times::default();
        for rollout in roll_out(batch, controller, &Settings::default()) {
            rollout?;
        }
        let own = *times.lock().unwrap_or_else(PoisonError::into_inner);
        if round > 0 && best.is_none_or(|best| own.plan < best.plan) {
            best = Some(own);
        }
    }
    let Times { begin, plan, plans } = best.context("no round was measured")?;
    let rate = |time: Duration| (agents * FUTURE) as f64 / time.as_secs_f64();
    let per_plan = plan / plans.max(1);
    let (begin_ms, plan_ms) = (begin.as_secs_f64() * 1e3, per_plan.as_secs_f64() * 1e3);
    let (alone, all) = (rate(plan), rate(begin + plan));
    println!("| {name} | {size} | {agents} | {begin_ms:.1} ms | {plan_ms:.2} ms | {alone:.0} | {all:.0} |");
    Ok(())
}
