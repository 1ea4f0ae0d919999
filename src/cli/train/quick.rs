//! `reactsim train quick`: from scratch to a trained network in the table, in a few minutes.

mod data;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;

use super::recipe::RecipeArgs;
use super::session::{self, SessionArgs, run_arguments};
use super::task;
use crate::cli::output::{ExitStatus, lock_folder, note, say, stop_on_interrupt};
use crate::cli::run::{RunArgs, run_until};
use crate::cli::subject::JobsArg;
use crate::models::learning::learning_settings;
use crate::training::WEIGHTS;

/// Task and recipe of the quick training.
const TASK: &str = "ntp-reactive";
const RECIPE: &str = "quick";
/// How often the scenarios in which agents react to a deviated AV are seen per epoch.
const REACTIONS_PER_EPOCH: f64 = 3.0;
/// Name of the new network in the table.
const VARIANT: &str = "quick";

const AFTER: &str = "\
1. Generates 800 logs, and 900 others in which the AV deviates and the agents react to it as `idm` does.
2. Trains a reactive network of 0.2 million weights on them.
3. Runs it on the shipped benchmark next to the baselines.

The files in --out are the files of `generate`, `train` and `run`, so that every step can be repeated \
and changed; the guide on training continues from there.";

/// Arguments of `train quick`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct QuickArgs {
    /// Folder to write: scenarios, training, run
    #[arg(long, default_value = "quick", value_name = "FOLDER")]
    out: PathBuf,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// Continue in --out where it was interrupted
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    jobs: JobsArg,
}

pub(super) fn quick(args: &QuickArgs) -> anyhow::Result<ExitStatus> {
    let _lock = lock_folder(&args.out)?;
    let stop = stop_on_interrupt("keeping what is finished")?;
    let mut session = SessionArgs::within(args.out.join("training"), args.seed, args.resume, args.jobs);
    let Some(files) = data::make(&args.out, args.jobs.count(), &stop)? else {
        say(format_args!("interrupted; to continue, repeat the command with --resume"));
        return Ok(ExitStatus::Interrupted);
    };
    let (logs, reactions) = (files.logs.display(), files.reactions.display());
    session.scenarios = vec![logs.to_string(), format!("{reactions}={REACTIONS_PER_EPOCH}")];

    let task = task::find(TASK)?;
    let recipe = RecipeArgs::of(RECIPE).read(task)?;
    let settings = learning_settings(&recipe, args.seed)?;
    let training = task::build(task, recipe, &[], None, session.backend)?;
    let trained = session.folder()?.join(WEIGHTS);
    let status = session::train(&session, training.as_ref(), settings, None, &stop)?;
    if status != ExitStatus::Done {
        return Ok(status);
    }
    let status = table(args, &trained, &stop)?;
    if status == ExitStatus::Done {
        show_next_steps(&args.out, &trained);
    }
    Ok(status)
}

/// Runs the baselines and the new network on the shipped benchmark and prints the table.
fn table(args: &QuickArgs, weights: &Path, stop: &AtomicBool) -> anyhow::Result<ExitStatus> {
    let (raw, projected) = (format!("{TASK}-raw@{VARIANT}"), format!("{TASK}@{VARIANT}"));
    let models = format!("log-replay,constant-velocity,stop,idm,{TASK}-raw,{TASK},{raw},{projected}");
    let mut line: Vec<OsString> = ["run", "--models", &models].map(OsString::from).to_vec();
    for id in [raw, projected] {
        line.push("--model-weights".into());
        let mut value = OsString::from(format!("{id}="));
        value.push(weights);
        line.push(value);
    }
    line.extend(run_arguments(&args.out.join("run"), args.resume, args.jobs));
    run_until(RunArgs::parse(line)?, stop)
}

fn show_next_steps(out: &Path, weights: &Path) {
    let (out, weights) = (out.display(), weights.display());
    note(format_args!(
        "\nnext:\n  \
         reactsim view {out}/run                                     look at its scenes\n  \
         reactsim train {TASK} --print-recipe --recipe {RECIPE}          see what can be changed\n  \
         reactsim train {TASK} YOUR-LOGS --recipe {RECIPE} --from {weights} --out further\n  \
         reactsim train {TASK} {out}/logs.parquet {out}/reactions.parquet={REACTIONS_PER_EPOCH} --out large"
    ));
}
