//! `reactsim verify`: whether this program, on this machine, gives the numbers of a reference.

use std::path::PathBuf;

use clap::Args;

use super::progress::Progress;
use super::subject::{Work, given_weights, open_sources};
use super::{ExitStatus, find_inputs, reference, say, stop_on_interrupt, write_result};
use crate::evaluation::reference::{self as comparing, Given, Reference};
use crate::evaluation::{Deviations, Source};
use crate::report::verification;

/// A quick check runs networks on every so many scenarios.
const QUICK: usize = 15;
/// Differences that are listed.
const LISTED: usize = 20;

const AFTER: &str = "\
  reactsim verify
  reactsim verify --quick
  reactsim verify references/bench-v2-full --scenarios bench-v2-full.parquet

Exit codes: 0 equal; 1 something differs; 2 the reference is damaged, or of another program or
benchmark.

Simulators without a network must agree bit for bit, networks too on the class of processor and the
backend of the reference; elsewhere their mean paired differences must stay within its bounds.";

/// Arguments of `verify`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct VerifyArgs {
    /// Name or folder of the reference, of a run or of a study [default: that of the shipped benchmark]
    #[arg(value_name = "REFERENCE")]
    reference: Option<String>,
    /// Run networks on every 15th scenario only
    #[arg(long)]
    quick: bool,
    /// Scenarios of the reference, where they do not ship; may be repeated
    #[arg(long, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    /// Deviated AVs of the reference, where it has a file of them
    #[arg(long, value_name = "FILE")]
    deviations: Option<PathBuf>,
    /// Weights of a simulator that do not ship, such as pufferdrive=puffer.safetensors; may be repeated
    #[arg(long = "model-weights", value_name = "ID=FILE")]
    model_weights: Vec<String>,
    #[command(flatten)]
    work: Work,
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
        let every = args.quick.then_some(QUICK);
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
            verification::write(reference, &done, LISTED, out)
        })?;
        passed &= done.passed();
    }
    Ok(if passed { ExitStatus::Done } else { ExitStatus::SomeFailed })
}

fn given(args: &VerifyArgs, reference: &Reference) -> anyhow::Result<Given> {
    let stated = &reference.provenance;
    let most = stated.settings.limit.unwrap_or(usize::MAX);
    let sources = if args.scenarios.is_empty() {
        vec![Source::shipped(most)]
    } else {
        let mut inputs = find_inputs(&args.scenarios)?;
        // Which frame is the current one stands in the provenance of each file.
        for (input, file) in inputs.iter_mut().zip(&stated.inputs) {
            input.current_frame = file.current_frame;
        }
        open_sources(inputs, most)?
    };
    let deviations = args.deviations.as_deref().map(Deviations::read).transpose()?;
    Ok(Given { sources, deviations, weights: given_weights(&args.model_weights)? })
}
