//! Training of any network on scenarios: arguments, files, ^C.

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anyhow::bail;
use burn::tensor::Device;
use clap::Args;
use serde_json::{Map, Value, json};

use super::data::Data;
use super::progress::{CURVES, Progress};
use crate::cli::duration::duration;
use crate::cli::{ExitStatus, note, say, stop_on_interrupt};
use crate::evaluation::{program_commit, program_version};
use crate::models::nn::{Backend, BackendError};
use crate::scene::Scenario;
use crate::training::{ABOUT, ClosedLoop, Ending, Execution, Learner, Settings, Task, WEIGHTS};
use crate::work::available_threads;

/// Arguments of every training.
#[derive(Debug, Args)]
pub(super) struct SessionArgs {
    /// Files or folders of scenarios, optionally with the number of times that their scenarios are
    /// seen per epoch (default 1), such as logs=4 or generated.parquet=0.5
    #[arg(required = true, value_name = "SCENARIOS[=TIMES]")]
    scenarios: Vec<String>,
    /// Folder of the training to write: log, curves, checkpoints, weights
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Continue the training in --out from its last checkpoint
    #[arg(long)]
    resume: bool,
    /// Folder for scenarios converted from other formats [default: cache in --out]
    #[arg(long, value_name = "FOLDER")]
    cache: Option<PathBuf>,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of epochs
    #[arg(long, default_value_t = Settings::default().epochs, value_name = "N")]
    epochs: f64,
    /// Scenarios per step
    #[arg(long, default_value_t = Settings::default().batch, value_name = "N")]
    batch: usize,
    /// Scenarios per forward pass of the network; more need more memory
    #[arg(long, default_value_t = Settings::default().together, value_name = "N")]
    together: usize,
    /// Peak learning rate
    #[arg(long, default_value_t = Settings::default().learning_rate, value_name = "RATE")]
    learning_rate: f64,
    /// Final learning rate as a fraction of the peak
    #[arg(long, default_value_t = Settings::default().floor, value_name = "PART")]
    floor: f64,
    /// Warm-up steps, in which the learning rate grows to its peak
    #[arg(long, default_value_t = Settings::default().warm_up, value_name = "STEPS")]
    warm_up: u64,
    /// Weight decay
    #[arg(long, default_value_t = Settings::default().weight_decay, value_name = "RATE")]
    weight_decay: f64,
    /// Norm to which larger gradients are clipped
    #[arg(long, default_value_t = Settings::default().clip, value_name = "NORM")]
    clip: f64,
    /// Steps between validations
    #[arg(long, default_value_t = Settings::default().validate_every, value_name = "STEPS")]
    validate_every: u64,
    /// Fraction of the scenarios held out for validation
    #[arg(long, default_value_t = Settings::default().held_out, value_name = "PART")]
    held_out: f64,
    /// Maximum number of scenarios per validation
    #[arg(long, default_value_t = Settings::default().most_held_out, value_name = "N")]
    most_held_out: usize,
    /// Validations without a lower loss after which the training ends (0: never)
    #[arg(long, default_value_t = Settings::default().patience, value_name = "N")]
    patience: u64,
    /// Tensor backend; `reactsim list backends` shows those of this program
    #[arg(long, default_value_t, value_name = "NAME")]
    backend: Backend,
    /// Threads; they do not change the result [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Time between checkpoints, such as 90s, 3m or 1h
    #[arg(long, default_value = "3m", value_name = "TIME", value_parser = duration)]
    checkpoint_every: Duration,
}

impl SessionArgs {
    /// Device of the network.
    pub(super) fn device(&self) -> Result<Device, BackendError> {
        self.backend.check()?;
        Ok(self.backend.device())
    }

    /// Number of threads.
    fn jobs(&self) -> usize {
        self.jobs.map_or_else(available_threads, usize::from)
    }

    fn settings(&self) -> Settings {
        Settings {
            seed: self.seed,
            epochs: self.epochs,
            batch: self.batch,
            together: self.together,
            learning_rate: self.learning_rate,
            floor: self.floor,
            warm_up: self.warm_up,
            weight_decay: self.weight_decay,
            clip: self.clip,
            validate_every: self.validate_every,
            held_out: self.held_out,
            most_held_out: self.most_held_out,
            patience: self.patience,
            ..Settings::default()
        }
    }
}

/// Trains the network of a simulator with the settings of the arguments.
pub(super) fn train<T: Task<Example = Scenario>>(
    args: &SessionArgs,
    id: &str,
    task: &T,
    closed_loop: Option<&ClosedLoop<'_, T::Model>>,
) -> anyhow::Result<ExitStatus> {
    let stop = stop_on_interrupt("writing a checkpoint after this step")?;
    let status = train_until(args, task, closed_loop, &stop)?;
    if status == ExitStatus::Done {
        let folder = args.out.display();
        note(format_args!(
            "next: reactsim run --models {id},{id}@mine --model-weights {id}@mine={folder}/{WEIGHTS}"
        ));
    }
    Ok(status)
}

fn train_until<T: Task<Example = Scenario>>(
    args: &SessionArgs,
    task: &T,
    closed_loop: Option<&ClosedLoop<'_, T::Model>>,
    stop: &AtomicBool,
) -> anyhow::Result<ExitStatus> {
    let cache = args.cache.clone().unwrap_or_else(|| args.out.join("cache"));
    let data = Data::open(&args.scenarios, &cache)?;
    let about = Map::from_iter([
        ("program".to_owned(), json!({ "version": program_version(), "commit": program_commit() })),
        ("scenarios".to_owned(), json!(args.scenarios)),
        ("backend".to_owned(), json!(args.backend.name())),
    ]);
    if args.resume {
        refuse_other_backend(args)?;
    }
    let progress = Progress::new(&args.out);
    let learner = Learner {
        task,
        source: &data,
        settings: args.settings(),
        execution: Execution { jobs: args.jobs(), checkpoint_every: args.checkpoint_every },
        about,
        closed_loop,
        observer: &progress,
    };
    let outcome = learner.learn(&args.out, args.resume, stop);
    progress.end();
    let outcome = outcome?;
    let (steps, folder) = (outcome.steps, args.out.display());
    if outcome.ending == Ending::Interrupted {
        say(format_args!("interrupted after step {steps}; to continue, repeat the command with --resume"));
        return Ok(ExitStatus::Interrupted);
    }
    if outcome.ending == Ending::NoImprovement {
        say(format_args!(
            "ended early: the validation loss did not decrease in {} validations",
            args.patience
        ));
    }
    let best = outcome.best.map_or_else(String::new, |best| {
        format!("; lowest validation loss {:.4} after step {}", best.loss, best.step)
    });
    say(format_args!("trained {steps} steps, {:.1} scenarios/s{best}", progress.per_second()));
    say(format_args!("weights: {folder}/{WEIGHTS}; curves: {folder}/{CURVES}"));
    Ok(ExitStatus::Done)
}

/// Refuses to continue a training on another backend: its result would be that of neither.
fn refuse_other_backend(args: &SessionArgs) -> anyhow::Result<()> {
    let about = fs::read(args.out.join(ABOUT)).ok().and_then(|b| serde_json::from_slice::<Value>(&b).ok());
    let before = about.as_ref().and_then(|a| a.get("backend")).and_then(Value::as_str);
    match before {
        Some(before) if before != args.backend.name() => bail!(
            "{}: the training was begun on the backend `{before}`: give --backend {before}",
            args.out.display()
        ),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
