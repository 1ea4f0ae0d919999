//! `reactsim train TASK`: trains the network of a task.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use clap::Args;

use super::closed_loop::ClosedLoopArgs;
use super::recipe::RecipeArgs;
use super::session::{self, SessionArgs};
use crate::cli::output::{ExitStatus, note, stop_on_interrupt, write_result};
use crate::evaluation::suggestion::did_you_mean;
use crate::evaluation::{Adjustments, PlannedSimulator, weights_file};
use crate::files::read_regular;
use crate::models::learning::{TaskSetup, Trainable, TrainingTask, learning_settings, recipe_document};
use crate::models::nn::{Backend, check_backend, device_of};
use crate::models::{self, Baseline, Parameters, TASKS, WeightsFile, find_task};
use crate::training::WEIGHTS;

/// Arguments of a training.
#[derive(Debug, Args)]
pub(super) struct TaskArgs {
    /// Training task; `reactsim list tasks` names the tasks
    task: Option<String>,
    /// Print the recipe with all values, units and ranges (TOML), and end
    #[arg(long)]
    print_recipe: bool,
    #[command(flatten)]
    recipe: RecipeArgs,
    /// File that the task is given, such as vocabulary=tokens.safetensors; may be repeated
    #[arg(long, value_name = "NAME=FILE")]
    input: Vec<String>,
    /// Start from the weights of an earlier training, or of a model that ships, instead of new ones
    #[arg(long, value_name = "FILE|ID")]
    from: Option<PathBuf>,
    #[command(flatten)]
    session: SessionArgs,
    #[command(flatten)]
    closed_loop: ClosedLoopArgs,
}

pub(super) fn task(args: &TaskArgs) -> anyhow::Result<ExitStatus> {
    let Some(id) = &args.task else {
        bail!("give a task and scenarios; `reactsim list tasks` names the tasks");
    };
    let task = find(id)?;
    let recipe = args.recipe.read(task)?;
    if args.print_recipe {
        let text = recipe_document(&recipe)?;
        write_result(None, |out| {
            writeln!(out, "# Recipe of the task `{}`, with all values.\n\n{text}", task.id)
        })?;
        return Ok(ExitStatus::Done);
    }
    let settings = learning_settings(&recipe, args.session.seed)?;
    let training = build(task, recipe, &args.input, args.from.as_deref(), args.session.backend)?;
    let closed_loop = args.closed_loop.read()?;
    if closed_loop.is_some() && task.simulators.is_empty() {
        bail!("--closed-loop: no simulator runs the networks of `{id}`, which plan for the AV: omit it");
    }
    let stop = stop_on_interrupt("writing a checkpoint after this step")?;
    let status = session::train(&args.session, training.as_ref(), settings, closed_loop.as_ref(), &stop)?;
    if status == ExitStatus::Done
        && let Some(baseline) = reader(task, &args.session.folder()?.join(WEIGHTS))?
    {
        let (folder, id) = (args.session.folder()?.display(), baseline.id);
        let shipped = if baseline.is_complete() { format!("{id},") } else { String::new() };
        note(format_args!(
            "next: reactsim run --models {shipped}{id}@mine --model-weights {id}@mine={folder}/{WEIGHTS}"
        ));
    }
    Ok(status)
}

/// Returns the first simulator of a task that reads these weights: those of some tasks are of several
/// networks.
fn reader(task: &TrainingTask, weights: &Path) -> anyhow::Result<Option<&'static Baseline>> {
    let weights = weights_file(weights)?;
    let reads = |baseline: &&Baseline| {
        let weights = vec![(baseline.id.to_owned(), weights.clone())];
        let adjustments = Adjustments { weights, ..Adjustments::default() };
        PlannedSimulator::adjusted(&[baseline.id.to_owned()], &adjustments).is_ok()
    };
    Ok(task.simulators.iter().filter_map(|id| models::find(id)).find(reads))
}

/// Returns the task with this id.
pub(super) fn find(id: &str) -> anyhow::Result<&'static TrainingTask> {
    find_task(id).ok_or_else(|| {
        let known: Vec<&str> = TASKS.iter().map(|task| task.id).collect();
        let meant = did_you_mean(id, known.iter().copied());
        anyhow!("there is no task `{id}`; the tasks are {}{meant}", known.join(", "))
    })
}

/// Builds the training of a task.
pub(super) fn build(
    task: &TrainingTask,
    recipe: Parameters,
    inputs: &[String],
    from: Option<&Path>,
    backend: Backend,
) -> anyhow::Result<Box<dyn Trainable>> {
    if backend.name() == "cuda" {
        bail!(
            "--backend cuda: training fills the memory of the card step by step until it fails; leave --backend \
             out to train on processors, and use the card in `run`"
        );
    }
    check_backend(backend)?;
    let mut files = BTreeMap::new();
    for text in inputs {
        let Some((name, path)) = text.split_once('=') else {
            bail!("--input `{text}`: write NAME=FILE, such as vocabulary=tokens.safetensors");
        };
        let known = || task.inputs.iter().map(|input| input.name);
        let Some(name) = known().find(|known| *known == name) else {
            let meant = did_you_mean(name, known());
            let list: Vec<&str> = known().collect();
            let list = if list.is_empty() { "no files".to_owned() } else { list.join(", ") };
            bail!("--input {text}: the task `{}` takes {list}{meant}", task.id);
        };
        files.insert(name, file(Path::new(path))?);
    }
    let from = from.map(parent).transpose()?;
    Ok((task.make)(TaskSetup { recipe, inputs: files, from, device: device_of(backend) })?)
}

/// Returns a file of weights, or those of a model that ships if there is no file of this name.
fn parent(name: &Path) -> anyhow::Result<WeightsFile> {
    let baseline = name.to_str().filter(|_| !name.exists()).and_then(models::find);
    let Some(baseline) = baseline else { return file(name) };
    let shipped = models::weights::shipped(baseline.id)?;
    shipped.with_context(|| format!("--from {}: this program has no weights of it: give a file", baseline.id))
}

fn file(path: &Path) -> anyhow::Result<WeightsFile> {
    let bytes = read_regular(path).with_context(|| format!("could not read {}", path.display()))?;
    Ok(WeightsFile::new(path.display().to_string(), bytes))
}
