//! `reactsim verify`: checks that this program, on this machine, reproduces the numbers of a reference.

use std::path::PathBuf;

use clap::Args;

use super::progress::Progress;
use super::subject::{ExecutionArgs, read_weights};
use super::{ExitStatus, find_inputs, reference, say, stop_on_interrupt, write_result};
use crate::evaluation::reference::{self as comparing, Reference, RerunInputs};
use crate::evaluation::{Deviations, Source};
use crate::report::verification;

/// Stride in scenarios at which `--quick` runs networks.
const QUICK_STRIDE: usize = 15;
/// Maximum number of differences to list.
const MAX_LISTED_DIFFERENCES: usize = 20;

const AFTER: &str = "\
Examples:
  reactsim verify
  reactsim verify --quick
  reactsim verify references/bench-v2-full --scenarios bench-v2-full.parquet

Exit codes: 0 equal; 1 something differs; 2 the reference is damaged, or for another program or \
benchmark.

Simulators without a network must agree bit for bit. So must networks on the processor class and \
backend of the reference; elsewhere, their mean paired differences must stay within its bounds.";

/// Arguments of `verify`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct VerifyArgs {
    /// Name or folder of the reference of a run or study [default: that of the shipped benchmark]
    #[arg(value_name = "REFERENCE")]
    reference: Option<String>,
    /// Run networks only on every 15th scenario
    #[arg(long)]
    quick: bool,
    /// Scenarios of the runs, unless they ship with the program; may be repeated
    #[arg(long, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    /// File of deviated AVs, if the reference has one
    #[arg(long, value_name = "FILE")]
    deviations: Option<PathBuf>,
    /// Weights that do not ship with the program, such as pufferdrive=puffer.safetensors; may be
    /// repeated
    #[arg(long = "model-weights", value_name = "ID=FILE")]
    model_weights: Vec<String>,
    #[command(flatten)]
    work: ExecutionArgs,
}

pub(super) fn verify(args: &VerifyArgs) -> anyhow::Result<ExitStatus> {
    let stop = stop_on_interrupt("stopping")?;
    let mut passed = true;
    let references = reference::find_all(args.reference.as_deref())?;
    for (i, reference) in references.iter().enumerate() {
        if references.len() > 1 {
            say(format_args!("{} of {}: {}", i + 1, references.len(), reference.record.title));
        }
        let given = given(args, reference)?;
        let progress = Progress::new();
        let every = args.quick.then_some(QUICK_STRIDE);
        let done = comparing::verify(reference, given, every, args.work.execution(), &progress, &stop);
        progress.end();
        let Some(done) = done? else {
            say(format_args!("interrupted; nothing was compared"));
            return Ok(ExitStatus::Interrupted);
        };
        write_result(None, |out| {
            if i > 0 {
                writeln!(out)?;
            }
            verification::write(reference, &done, MAX_LISTED_DIFFERENCES, out)
        })?;
        passed &= done.passed();
    }
    Ok(if passed { ExitStatus::Done } else { ExitStatus::SomeFailed })
}

fn given(args: &VerifyArgs, reference: &Reference) -> anyhow::Result<RerunInputs> {
    let stated = &reference.provenance;
    let most = stated.settings.limit.unwrap_or(usize::MAX);
    let sources = if args.scenarios.is_empty() {
        vec![Source::shipped(most)]
    } else {
        let mut inputs = find_inputs(&args.scenarios)?;
        // The provenance holds the current frames of each file.
        for (input, file) in inputs.iter_mut().zip(&stated.inputs) {
            input.frames = file.frames();
            input.all_agents = file.all_agents;
        }
        Source::of_inputs(inputs, most)?
    };
    let deviations = args.deviations.as_deref().map(Deviations::read).transpose()?;
    Ok(RerunInputs { sources, deviations, weights: read_weights(&args.model_weights)? })
}
