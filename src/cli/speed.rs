//! `reactsim speed`: speed of networks on tensor backends, and agreement of the backends.

mod agreement;
mod timed;

use std::num::NonZeroUsize;
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Args;

use self::agreement::Agreement;
use self::timed::{NetworkTime, Timed};
use super::duration::duration;
use super::subject::{JobsArg, read_parameters, read_weights};
use super::{ExitStatus, find_inputs, say, write_result};
use crate::evaluation::{Adjustments, PlannedSimulator, Source};
use crate::models::nn::{Backend, check_backend};
use crate::rollout::{Controller, LogAv, Request, Rollout, Settings, roll_out};
use crate::scene::{FUTURE, Scenario};
use crate::work::available_threads;

const AFTER: &str = "\
For every size of --batches, that many episodes are rolled out at once: 8 s, replanned at 2 Hz, with the \
recorded AV, without metrics. A processor divides them among threads; a graphics processor plans all of \
them together, from one thread. Times are by the wall clock. The first round contains the compilation \
of kernels; the speed is that of the best of the other rounds. \"In the network\" is the share of \
the threads' time in which the simulator plans; the rest is the protocol's.

The last columns compare the rollouts of each other backend with the rollouts of the first: positions of all \
agents at all steps, agents at all steps, and the largest distances. The exit code is 1 if less than \
--agreement of the positions are within 1 mm.

Examples:
  reactsim speed
  reactsim speed --backends flex,cuda --batches 1,16,256
  reactsim speed --backends flex,cuda --models smart \\
      --model-weights smart=training/weights.safetensors";

const HEADER: &str = "\
| Network | Backend | Threads | Batch | Agents | First round (s) | Best round (s) | In the network \
| Agent-steps/s | Positions within 1 mm | Agents within 1 mm | Difference in first plan (m) \
| Difference in 8 s (m) |
|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|";

/// Arguments of `speed`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct SpeedArgs {
    /// Files, folders or URLs of scenarios [default: the shipped benchmark]
    #[arg(value_name = "SCENARIOS")]
    scenarios: Vec<PathBuf>,
    /// Only the first N scenarios of every file; larger batches contain further rollouts of them
    #[arg(long, value_name = "N", default_value = "64")]
    limit: NonZeroUsize,
    /// Networks, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "IDS", default_value = "ntp-reactive,smart-small")]
    models: Vec<String>,
    /// Weights of a network, such as smart=training/weights.safetensors; may be repeated
    #[arg(long = "model-weights", value_name = "ID=FILE")]
    model_weights: Vec<String>,
    /// Override a parameter of a network's card, such as smart-small.sampling.top_k=1; may be repeated
    #[arg(long, value_name = "ID.KEY=VALUE")]
    set: Vec<String>,
    /// Tensor backends, separated by commas; `reactsim list backends` shows which this program has
    #[arg(long, value_delimiter = ',', value_name = "NAMES", default_value = "flex")]
    backends: Vec<Backend>,
    /// Numbers of episodes that are rolled out at once, separated by commas
    #[arg(long, value_delimiter = ',', value_name = "SIZES", default_value = "1,4,16,64,256")]
    batches: Vec<NonZeroUsize>,
    /// Rounds after the first one
    #[arg(long, value_name = "N", default_value = "3")]
    rounds: NonZeroUsize,
    /// Time after which no further round of a batch begins, such as 20s
    #[arg(long, default_value = "20s", value_name = "TIME", value_parser = duration)]
    time: Duration,
    /// Smallest share of positions that must be within 1 mm of those of the first backend
    #[arg(long, default_value_t = 0.99, value_name = "SHARE")]
    agreement: f64,
    #[command(flatten)]
    jobs: JobsArg,
}

/// Speed of a network on a backend for one size of batches.
struct Speed {
    backend: Backend,
    batch: usize,
    threads: usize,
    /// Number of agents that the network moves.
    agents: usize,
    first: Duration,
    best: Duration,
    /// Share of the threads' time in which the simulator plans, in the best round.
    in_network: f64,
}

impl Speed {
    /// Returns the first cells of a row of the table.
    fn cells(&self, id: &str) -> String {
        let Self { backend, threads, batch, agents, .. } = self;
        let (first, best) = (self.first.as_secs_f64(), self.best.as_secs_f64());
        let (share, rate) = (100.0 * self.in_network, (agents * FUTURE) as f64 / best);
        format!(
            "| `{id}` | {backend} | {threads} | {batch} | {agents} | {first:.2} | {best:.3} | {share:.0} % | {rate:.0} |"
        )
    }
}

pub(super) fn speed(args: &SpeedArgs) -> anyhow::Result<ExitStatus> {
    if !(0.0..=1.0).contains(&args.agreement) {
        bail!("--agreement is {}, expected 0 to 1", args.agreement);
    }
    for backend in &args.backends {
        check_backend(*backend)?;
    }
    let scenarios = read_scenarios(args)?;
    let weights = read_weights(&args.model_weights)?;
    let parameters = read_parameters(&args.set)?;
    let adjusted = weights.iter().map(|(id, _)| id).chain(parameters.iter().map(|(id, ..)| id));
    if let Some(id) = adjusted.into_iter().find(|id| !args.models.contains(id)) {
        bail!("weights or parameters for `{id}`, which --models does not name");
    }
    let first = args.backends[0];
    write_result(None, |out| writeln!(out, "{HEADER}"))?;
    let mut status = ExitStatus::Done;
    for id in &args.models {
        let mut reference: Vec<Vec<Rollout>> = Vec::new();
        for (number, &backend) in args.backends.iter().enumerate() {
            let adjustments = Adjustments {
                weights: weights.iter().filter(|(of, _)| of == id).cloned().collect(),
                parameters: parameters.iter().filter(|(of, ..)| of == id).cloned().collect(),
                backend,
                ..Adjustments::default()
            };
            let (controller, time) = timed(id, &adjustments)?;
            for (index, batch) in args.batches.iter().enumerate() {
                let (speed, rollouts) = measure(args, &controller, &time, &scenarios, backend, batch.get())?;
                if number == 0 {
                    // Rows appear as they are measured, which takes minutes.
                    write_result(None, |out| writeln!(out, "{} - | - | - | - |", speed.cells(id)))?;
                    reference.push(rollouts);
                    continue;
                }
                let agreement = Agreement::of(&reference[index], &rollouts);
                write_result(None, |out| writeln!(out, "{}{}", speed.cells(id), agreement.cells()))?;
                let (share, wanted) = (100.0 * agreement.positions(), 100.0 * args.agreement);
                // A share that is no number must not pass.
                if !(share >= wanted) {
                    say(format_args!(
                        "warning: `{id}` on {backend}, batch {batch}: {share:.3} % of the positions are within \
                         1 mm of those on {first}, expected {wanted} %"
                    ));
                    status = ExitStatus::SomeFailed;
                }
            }
        }
    }
    Ok(status)
}

fn read_scenarios(args: &SpeedArgs) -> anyhow::Result<Vec<Scenario>> {
    let most = args.limit.get();
    let sources = match args.scenarios.as_slice() {
        [] => vec![Source::shipped(most)],
        paths => Source::of_inputs(find_inputs(paths)?, most)?,
    };
    let mut scenarios = Vec::new();
    for source in &sources {
        for scenario in source.scenarios()? {
            scenarios.push(scenario?);
        }
    }
    if scenarios.is_empty() {
        bail!("there are no scenarios in the given files");
    }
    Ok(scenarios)
}

/// Builds a simulator whose time is measured.
fn timed(id: &str, adjustments: &Adjustments) -> anyhow::Result<(Controller, Arc<NetworkTime>)> {
    let simulators = PlannedSimulator::adjusted(&[id.to_owned()], adjustments)?;
    let planned = simulators.into_iter().next().with_context(|| format!("no simulator `{id}`"))?;
    if planned.backend.is_none() {
        bail!("`{id}` has no network: its speed does not depend on backends");
    }
    match planned.controller {
        Controller::Fair(inner) => {
            let time = Arc::<NetworkTime>::default();
            Ok((Controller::Fair(Box::new(Timed::new(inner, time.clone()))), time))
        }
        Controller::Oracle(_) => bail!("`{id}` reads the recorded future and has no network"),
    }
}

/// Rolls out a batch several times. Returns its speed, and the rollouts of the first round.
fn measure(
    args: &SpeedArgs,
    controller: &Controller,
    time: &NetworkTime,
    scenarios: &[Scenario],
    backend: Backend,
    batch: usize,
) -> anyhow::Result<(Speed, Vec<Rollout>)> {
    let threads = if backend.is_gpu() { 1 } else { args.jobs.or(available_threads()).min(batch) };
    let request = |i: usize| -> anyhow::Result<Request<'_>> {
        let scenario = &scenarios[i % scenarios.len()];
        let av = Arc::new(LogAv::new(scenario)?);
        Ok(Request { scenario, av: Some(av), rollout: (i / scenarios.len()) as u32 })
    };
    let requests = (0..batch).map(request).collect::<anyhow::Result<Vec<_>>>()?;
    // The AV is moved from outside.
    let agents = requests.iter().map(|request| request.scenario.start.agents.len() - 1).sum();
    let round = || -> anyhow::Result<_> {
        time.reset();
        let began = Instant::now();
        let rollouts = roll_out_on_threads(&requests, controller, threads)?;
        let elapsed = began.elapsed();
        Ok((elapsed, time.total().as_secs_f64() / (threads as f64 * elapsed.as_secs_f64()), rollouts))
    };
    let (first, mut in_network, rollouts) = round()?;
    // On processors nothing is compiled: a first round that took long is as good as others.
    let rounds = if !backend.is_gpu() && first > args.time { 0 } else { args.rounds.get() };
    let began = Instant::now();
    let mut best = None;
    for _ in 0..rounds {
        let (elapsed, share, _) = round()?;
        if best.is_none_or(|best| elapsed < best) {
            (best, in_network) = (Some(elapsed), share);
        }
        if began.elapsed() > args.time {
            break;
        }
    }
    let best = best.unwrap_or(first);
    Ok((Speed { backend, batch, threads, agents, first, best, in_network }, rollouts))
}

/// Rolls out episodes, divided evenly among threads.
fn roll_out_on_threads(
    requests: &[Request<'_>],
    controller: &Controller,
    threads: usize,
) -> anyhow::Result<Vec<Rollout>> {
    let roll = |part: &[Request<'_>]| roll_out(part.to_vec(), controller, &Settings::default());
    let parts: Vec<_> = thread::scope(|scope| {
        let parts = requests.chunks(requests.len().div_ceil(threads));
        let running: Vec<_> = parts.map(|part| scope.spawn(move || roll(part))).collect();
        running.into_iter().map(|part| part.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    Ok(parts.into_iter().flatten().collect::<Result<Vec<_>, _>>()?)
}
