//! A training on scenarios: data, files, progress.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use serde_json::{Map, Value, json};

use super::closed_loop::ClosedLoop;
use super::data::Data;
use super::exclusion::Exclusion;
use super::progress::{CURVES, Progress};
use crate::cli::output::{ExitStatus, say};
use crate::cli::subject::JobsArg;
use crate::evaluation::Time;
use crate::evaluation::{program_commit, program_version};
use crate::models::learning::{Trainable, Training};
use crate::models::nn::Backend;
use crate::rollout::Controller;
use crate::training::{ABOUT, Ending, Execution, LOSS, Settings, WEIGHTS};

/// Arguments of every training.
#[derive(Debug, Args)]
pub(super) struct SessionArgs {
    /// Files or folders of scenarios, optionally with the number of times that their scenarios are
    /// seen per epoch (default 1), such as logs=4 or generated.parquet=0.5
    #[arg(value_name = "SCENARIOS[=TIMES]")]
    pub(super) scenarios: Vec<String>,
    /// Folder of the training to write: log, curves, checkpoints, weights
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Continue the training in --out from its last checkpoint
    #[arg(long)]
    resume: bool,
    /// Folder for scenarios converted from other formats [default: cache in --out]
    #[arg(long, value_name = "FOLDER")]
    cache: Option<PathBuf>,
    /// Files or folders of scenarios that are not learned from, even if they are among the others; may
    /// be repeated
    #[arg(long, value_name = "SCENARIOS")]
    exclude: Vec<PathBuf>,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Tensor backend of the networks; `reactsim list backends` shows which this program has
    #[arg(long, default_value_t, value_name = "NAME")]
    pub(super) backend: Backend,
    #[command(flatten)]
    pub(super) jobs: JobsArg,
    /// Time between checkpoints, such as 90s, 3m or 1h
    #[arg(long, default_value = "3m", value_name = "TIME")]
    checkpoint_every: Time,
    /// Steps between networks that are kept besides the best one, for `study realism-reactivity`
    #[arg(long, value_name = "STEPS", default_value_t = 0, hide_default_value = true)]
    keep_every: u64,
}

impl SessionArgs {
    /// Returns the arguments of a training in a folder, without scenarios.
    pub(super) fn within(folder: PathBuf, seed: u64, resume: bool, jobs: JobsArg) -> Self {
        Self {
            scenarios: Vec::new(),
            out: Some(folder),
            resume,
            cache: None,
            exclude: Vec::new(),
            seed,
            backend: Backend::default(),
            jobs,
            checkpoint_every: Time(Duration::from_secs(30)),
            keep_every: 0,
        }
    }

    /// Returns the folder of the training.
    pub(super) fn folder(&self) -> anyhow::Result<&Path> {
        self.out.as_deref().context("give --out FOLDER for log, curves, checkpoints and weights")
    }
}

/// Returns the options of `run` that keep rollouts in a folder, continue it on `--resume` if it exists, and
/// set the threads.
pub(super) fn run_arguments(out: &Path, resume: bool, jobs: JobsArg) -> Vec<OsString> {
    let mut line: Vec<OsString> = vec!["--out".into(), out.into(), "--keep-rollouts".into()];
    if resume && out.exists() {
        line.push("--resume".into());
    }
    if let Some(jobs) = jobs.jobs {
        line.extend(["--jobs".into(), jobs.to_string().into()]);
    }
    line
}

/// Trains a network with these settings, until `stop` is set.
pub(super) fn train(
    args: &SessionArgs,
    training: &dyn Trainable,
    settings: Settings,
    closed_loop: Option<&ClosedLoop>,
    stop: &AtomicBool,
) -> anyhow::Result<ExitStatus> {
    let out = args.folder()?;
    if args.scenarios.is_empty() {
        bail!("give files or folders of scenarios to learn from");
    }
    let cache = args.cache.clone().unwrap_or_else(|| out.join("cache"));
    let data = Data::open(&args.scenarios, Exclusion::read(&args.exclude)?, &cache)?;
    if let Some(id) = closed_loop.and_then(|driven| driven.ids().find(|id| data.contains(id))) {
        bail!(
            "scenario `{id}` is both learned from and driven in to judge the network: give --exclude with the \
             scenarios of --closed-loop"
        );
    }
    let about = Map::from_iter([
        ("program".to_owned(), json!({ "version": program_version(), "commit": program_commit() })),
        ("scenarios".to_owned(), json!(args.scenarios)),
        ("backend".to_owned(), json!(args.backend.name())),
    ]);
    if args.resume {
        refuse_other_backend(args, out)?;
    }
    let progress = Progress::new(out);
    let best_by = settings.best_by.clone();
    let measure = closed_loop
        .map(|scenarios| |controller: Controller| scenarios.measure(controller, args.jobs.count()));
    let outcome = training.learn(Training {
        source: &data,
        settings,
        execution: Execution {
            jobs: args.jobs.count(),
            checkpoint_every: args.checkpoint_every.0,
            keep_every: args.keep_every,
        },
        about,
        measure: measure.as_ref().map(|measure| measure as _),
        observer: &progress,
        folder: out,
        resume: args.resume,
        stop,
    });
    progress.end();
    let outcome = outcome?;
    let (steps, folder) = (outcome.steps, out.display());
    if outcome.ending == Ending::Interrupted {
        say(format_args!("interrupted after step {steps}; to continue, repeat the command with --resume"));
        return Ok(ExitStatus::Interrupted);
    }
    if outcome.ending == Ending::NoImprovement {
        say(format_args!("ended early: no validation was better than that of the best network for too long"));
    }
    let best = outcome.best.map_or_else(String::new, |best| {
        let what = if best_by == LOSS { "validation loss" } else { best_by.as_str() };
        format!("; lowest {what} {:.4} after step {}", best.value, best.step)
    });
    say(format_args!("trained {steps} steps, {:.1} scenarios/s{best}", progress.per_second()));
    if outcome.best.is_some_and(|best| best.step == 0) {
        say(format_args!("warning: nothing was gained: the weights are those that the training began with"));
    }
    say(format_args!("weights: {folder}/{WEIGHTS}; curves: {folder}/{CURVES}"));
    Ok(ExitStatus::Done)
}

/// Refuses to continue a training on another backend: its result would be that of neither.
fn refuse_other_backend(args: &SessionArgs, folder: &Path) -> anyhow::Result<()> {
    let about = fs::read(folder.join(ABOUT)).ok().and_then(|b| serde_json::from_slice::<Value>(&b).ok());
    let before = about.as_ref().and_then(|a| a.get("backend")).and_then(Value::as_str);
    match before {
        Some(before) if before != args.backend.name() => bail!(
            "{}: the training was begun on the backend `{before}`: give --backend {before}",
            folder.display()
        ),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
