//! The network's part of a plan of `ntp-reactive`, for a comparison with PyTorch: `benches/pytorch.py` runs
//! this program, `cargo bench --bench pytorch -- FILE`, which writes the input, the output and its own times.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use mimalloc::MiMalloc;
use reactsim::formats;
use reactsim::models::nn::device;
use reactsim::models::ntp::reactive::{CachedStep, Policy};
use reactsim::models::perception::KnownMotion;
use serde_json::{Value, json};

// As in the program.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Frame of the measured step, and the time between two steps.
const FRAME: usize = 40;
const STEP: usize = 5;
/// Number of steps that are attended to.
const PAST: usize = 4;
/// Steps per round, and rounds.
const STEPS: usize = 20;
const ROUNDS: usize = 15;

fn main() -> Result<()> {
    let file = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    let file = file.context("expected the name of the file to write: see benches/pytorch.py")?;
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/bench.parquet");
    let scenarios = formats::open(Path::new(path))?.collect::<Result<Vec<_>, _>>()?;
    let scenario = scenarios.into_iter().max_by_key(|s| s.start.agents.len()).context("no scenarios ship")?;
    let tracks: Vec<_> = (0..scenario.start.agents.len()).map(|a| scenario.logged(a)).collect();
    let lights: Vec<_> = (0..scenario.start.lights.len()).map(|l| scenario.light_states(l)).collect();
    let known = KnownMotion { start: &scenario.start, tracks: &tracks, lights: &lights, av_lookahead: true };
    let weights = concat!(env!("CARGO_MANIFEST_DIR"), "/weights/ntp-reactive.safetensors");
    let policy = Policy::read(&std::fs::read(weights)?, &device())?;
    let frames: Vec<usize> = (0..=PAST).rev().map(|k| FRAME - k * STEP).collect();
    let step = policy.cached_step(&known, &frames, &device()).context("a step")?;

    let rates: BTreeMap<usize, f64> =
        [1, 2].into_iter().map(|threads| (threads, rate(&step, threads))).collect();
    let input: BTreeMap<String, Value> = step
        .input()
        .into_iter()
        .map(|(name, tensor)| {
            let (shape, values) = (tensor.dims(), tensor.into_data().iter::<f32>().collect::<Vec<_>>());
            (name, json!({ "shape": shape, "values": values }))
        })
        .collect();
    let classes: Vec<usize> = step.classes().iter().map(|class| class.index()).collect();
    let all = json!({
        "weights": weights, "heads": policy.config.heads, "steps_per_second": rates, "classes": classes,
        "input": input, "logits": step.logits(),
    });
    serde_json::to_writer(BufWriter::new(File::create(file)?), &all)?;
    Ok(())
}

/// Returns the steps per second of the fastest round; each thread computes its own steps, as in runs.
fn rate(step: &CachedStep<'_>, threads: usize) -> f64 {
    let round = || {
        let start = Instant::now();
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| (0..STEPS).for_each(|_| drop(std::hint::black_box(step.logits()))));
            }
        });
        (threads * STEPS) as f64 / start.elapsed().as_secs_f64()
    };
    (0..ROUNDS).map(|_| round()).fold(0.0, f64::max)
}
