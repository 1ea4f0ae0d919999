//! `reactsim train open-loop`: prediction errors of a motion predictor on recorded scenarios.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::Context;
use clap::Args;

use super::reader::Reader;
use crate::cli::inputs::find_inputs;
use crate::cli::output::{ExitStatus, count, nothing, say, stop_on_interrupt, write_result};
use crate::cli::progress::Progress;
use crate::evaluation::weights_file;
use crate::models::nn::{Backend, check_backend, device_of};
use crate::models::qp_regression::Policy;
use crate::models::qp_regression::learn::{MEASURES, Recipe, Regression};
use crate::models::weights;
use crate::training::{Sums, Task};

const AFTER: &str = "\
All agents within 80 m of the AV that are not parked are predicted from the current frame on. \
minADE and minFDE: mean and final displacement of the best of six modes over 8 s, in metres. \
Miss rate: fraction of agents whose best mode ends outside the bounds of the Waymo Open Motion \
challenge at 8 s.

Examples:
  reactsim train open-loop logs.parquet
  reactsim train open-loop logs.parquet --weights regression/weights.safetensors";

/// Arguments of `train open-loop`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct OpenLoopArgs {
    /// Files or folders of scenarios
    #[arg(required = true, value_name = "SCENARIOS")]
    scenarios: Vec<PathBuf>,
    /// Weights of `train qp-regression` [default: the shipped ones]
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Also predict parked agents
    #[arg(long)]
    with_parked: bool,
    /// Only the first N scenarios, over all files [default: all]
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// Tensor backend of the networks; `reactsim list backends` shows which this program has
    #[arg(long, default_value_t, value_name = "NAME")]
    backend: Backend,
}

pub(super) fn open_loop(args: &OpenLoopArgs) -> anyhow::Result<ExitStatus> {
    let inputs = find_inputs(&args.scenarios)?;
    let weights = match &args.weights {
        Some(path) => weights_file(path)?,
        None => weights::shipped("qp-regression")?
            .context("no weights ship for `qp-regression`: give --weights FILE")?,
    };
    check_backend(args.backend)?;
    let device = device_of(args.backend);
    let name =
        || args.weights.as_ref().map_or_else(|| "shipped weights".to_owned(), |p| p.display().to_string());
    let policy = Policy::read(&weights.bytes, &device).with_context(name)?;
    let recipe = Recipe { network: policy.config, agents: usize::MAX, ..Recipe::default() };
    let task = Regression::new(recipe, policy.intentions, &device);
    let task = if args.with_parked { task.with_parked() } else { task };
    let stop = stop_on_interrupt("printing the results so far")?;
    let progress = Progress::new();
    let mut reader = Reader::new(&inputs, args.limit, &progress, &stop);
    let mut sums = Sums::new();
    let read = reader.each(usize::MAX, |scenario| {
        if let Some(sample) = task.prepare(scenario, None) {
            sums.extend(&task.validate(&policy.network, &[sample]).metrics);
        }
    });
    progress.end();
    if read == 0 {
        return Err(nothing("no scenario could be read"));
    }
    write_result(None, |out| {
        writeln!(
            out,
            "| Class | Agents | minADE (m) ↓ | minFDE (m) ↓ | Miss rate ↓ |\n|---|--:|--:|--:|--:|"
        )?;
        for (class, [ade, fde, miss]) in MEASURES {
            let Some(mean) = sums.mean(ade) else { continue };
            let value = |name| sums.mean(name).map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
            let agents = sums.weight(ade);
            writeln!(out, "| {class} | {agents} | {mean:.3} | {} | {} |", value(fde), value(miss))?;
        }
        writeln!(out, "\n{}, best of six modes over 8 s.", count(read, "scenario"))
    })?;
    if stop.load(Ordering::Relaxed) {
        say(format_args!("interrupted: the results cover the scenarios read so far"));
        return Ok(ExitStatus::Interrupted);
    }
    Ok(reader.status("the results cover the others"))
}
