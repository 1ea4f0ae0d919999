//! `reactsim verify`: checks that this program, on this machine, reproduces the numbers of a reference.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use super::inputs::find_inputs;
use super::output::{ExitStatus, say, stop_on_interrupt, write_result};
use super::progress::Progress;
use super::reference;
use super::subject::ExecutionArgs;
use crate::evaluation::paper::{PAPER, PaperComparison};
use crate::evaluation::reference::{self as comparing, Reference, RerunInputs};
use crate::evaluation::{
    AvChoice, Deviations, FinishedRun, NuplanSpec, ScenarioFiles, Source, limited, limited_shipped, weights,
};
use crate::formats::Input;
use crate::report::{paper, verification};
use crate::scene::Scenario;

/// Stride in scenarios at which `--quick` runs networks.
const QUICK_STRIDE: usize = 15;
/// Maximum number of differences to list.
const MAX_LISTED_DIFFERENCES: usize = 20;

const AFTER: &str = "\
Examples:
  reactsim verify
  reactsim verify --quick
  reactsim verify references/reactsim-bench-v2-full --scenarios bench-v2-full.parquet
  reactsim verify reactsim-bench-paper --run runs/official --scenarios official.selection.json

Exit codes: 0 equal; 1 something differs; 2 the reference is damaged, or for another program or \
benchmark.

Simulators without a network must agree bit for bit. So must networks on the processor class and \
backend of the reference; elsewhere, their mean paired differences must stay within its bounds.

reactsim-bench-paper stands for the numbers that the paper ReactSim-Bench prints. Log replay of --run is compared with \
them; where a number is not equal, the kept rollouts are scored again with other metric options.";

/// Arguments of `verify`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct VerifyArgs {
    /// Name or folder of the reference of a run or study, or reactsim-bench-paper [default: that of the shipped
    /// benchmark]
    #[arg(value_name = "REFERENCE")]
    reference: Option<String>,
    /// Finished run to compare with reactsim-bench-paper, with log replay and kept rollouts
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Run networks only on every 15th scenario
    #[arg(long)]
    quick: bool,
    /// Scenarios of the runs, unless they ship with the program; may be repeated
    #[arg(long, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    #[command(flatten)]
    nuplan: NuplanSpec,
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
    match (&args.run, args.reference.as_deref()) {
        (None, Some(PAPER)) => bail!("{PAPER}: give the run to compare with --run"),
        (Some(run), Some(PAPER)) => return compare_with_paper(args, run),
        (Some(_), _) => bail!("--run is compared with {PAPER} only: `reactsim compare` compares runs"),
        (None, _) => {}
    }
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

/// Compares log replay of a run with the paper.
fn compare_with_paper(args: &VerifyArgs, run: &Path) -> anyhow::Result<ExitStatus> {
    let others = [
        ("--quick", args.quick),
        ("--deviations", args.deviations.is_some()),
        ("--model-weights", !args.model_weights.is_empty()),
    ];
    if let Some((option, _)) = others.iter().find(|(_, is_given)| *is_given) {
        bail!("{option}: {PAPER} is compared with what --run has; leave {option} out");
    }
    let finished = FinishedRun::open(run)?;
    let scenarios = ScenarioFiles::of_runs(&[run], &inputs(args)?)?;
    let progress = Progress::new();
    progress.set_total(Some(finished.tally().entries.len()));
    let jobs = args.work.execution().jobs;
    let compared = PaperComparison::of(&finished, &scenarios, jobs, &|n| progress.set_done(n));
    progress.end();
    let compared = compared.with_context(|| format!("could not compare {}", run.display()))?;
    write_result(None, |out| paper::write(&compared, out))?;
    Ok(if compared.passed() { ExitStatus::Done } else { ExitStatus::SomeFailed })
}

/// Finds the files of scenarios.
fn inputs(args: &VerifyArgs) -> anyhow::Result<Vec<Input>> {
    let mut inputs = find_inputs(&args.scenarios)?;
    inputs.extend(args.nuplan.input()?);
    Ok(inputs)
}

fn given(args: &VerifyArgs, reference: &Reference) -> anyhow::Result<RerunInputs> {
    args.nuplan.check()?;
    let stated = &reference.provenance;
    let deviations = args.deviations.as_deref().map(Deviations::read).transpose()?;
    let tracks = deviations.as_ref().map(|deviations| &deviations.tracks);
    let selection = &stated.settings.selection;
    let falls_back = matches!(stated.settings.av.parse(), Ok(AvChoice::DeviatedOrLog));
    let is_run = |scenario: &Scenario| selection.has(scenario, tracks, falls_back);
    let leaves_out = selection.leaves_out(tracks.is_some(), falls_back);
    let is_run = leaves_out.then_some(&is_run as &dyn Fn(&Scenario) -> bool);
    let is_shipped = args.scenarios.is_empty() && args.nuplan.filter.is_none();
    let sources = match (is_shipped, stated.settings.limit) {
        (true, limit) => vec![limited_shipped(limit, is_run)?],
        (false, limit) => {
            let mut inputs = inputs(args)?;
            // The provenance holds the current frames and the length of each file.
            for (input, file) in inputs.iter_mut().zip(&stated.inputs) {
                (input.frames, input.length) = (file.frames(), file.length());
                input.all_agents = file.all_agents;
            }
            Source::of_inputs(limited(inputs, limit, is_run))?
        }
    };
    Ok(RerunInputs { sources, deviations, weights: weights(&args.model_weights)? })
}
