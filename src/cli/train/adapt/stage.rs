//! One training of an adaptation, as long as time allows.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::Map;

use super::model::AdaptableModel;
use super::{AdaptArgs, MOST_EPOCHS, RECIPE, REWARD_RECIPE, TRAINED_AT};
use crate::cli::output::{ExitStatus, say, write_result};
use crate::cli::train::data::Data;
use crate::cli::train::exclusion::Exclusion;
use crate::cli::train::recipe::RecipeArgs;
use crate::cli::train::session::{self, SessionArgs};
use crate::cli::train::task;
use crate::models;
use crate::models::learning::{Trainable, Training, TrainingTask, learning_settings, recipe_document};
use crate::models::nn::Backend;
use crate::training::{Execution, Settings};

/// Changes of a recipe for a number of epochs and steps.
type Changes<'a> = Box<dyn Fn(f64, u64) -> Vec<String> + 'a>;

/// A training: its task, the weights that it begins with, and when it is to end.
pub(super) struct Stage<'a> {
    task: &'static TrainingTask,
    recipe: Option<&'static str>,
    changes: Changes<'a>,
    /// Inputs of the task that the weights contain.
    inputs: &'static [&'static str],
    from: PathBuf,
    /// Name of the recipe in the folder.
    file: &'static str,
    /// Share of the time that may have passed at the end.
    until: f64,
    /// Number of steps with which the speed is measured, and the smallest number of steps.
    pace_steps: u64,
    least_steps: u64,
    /// Time that its validations take, in steps.
    validation_steps: f64,
}

impl<'a> Stage<'a> {
    /// Continues the training of a model on recordings, from these weights.
    pub(super) fn of_model(model: &'a AdaptableModel, from: &Path, until: f64) -> anyhow::Result<Self> {
        Ok(Self {
            task: task::find(model.task)?,
            recipe: model.recipe,
            changes: Box::new(move |epochs, steps| model.changes(epochs, steps)),
            inputs: model.inputs,
            from: from.to_owned(),
            file: RECIPE,
            until,
            pace_steps: 6,
            least_steps: 20,
            validation_steps: 0.0,
        })
    }

    /// Fine-tunes by a reward, from these weights.
    pub(super) fn of_reward(task: &'static TrainingTask, from: &Path) -> Self {
        let changes = |epochs: f64, steps: u64| {
            let learning = [
                format!("epochs={epochs:.7}"),
                format!("validate_every={}", (steps / 3).max(1)),
                format!("warm_up={}", (steps / 20).min(20)),
                "held_out=0.1".to_owned(),
                "most_held_out=8".to_owned(),
            ];
            learning.map(|change| format!("learning.{change}")).to_vec()
        };
        Self {
            task,
            recipe: None,
            changes: Box::new(changes),
            inputs: &[],
            from: from.to_owned(),
            file: REWARD_RECIPE,
            until: TRAINED_AT,
            pace_steps: 2,
            least_steps: 1,
            // Up to four of eight scenarios, which only drive.
            validation_steps: 6.0,
        }
    }

    /// Trains as long as time allows.
    pub(super) fn train(
        &self,
        args: &AdaptArgs,
        session: &SessionArgs,
        begun: Instant,
        stop: &AtomicBool,
    ) -> anyhow::Result<ExitStatus> {
        let recipe = RecipeArgs::of(self.recipe(args, session, begun)?.display()).read(self.task)?;
        let settings = learning_settings(&recipe, args.seed)?;
        session::train(session, self.build(recipe)?.as_ref(), settings, None, stop)
    }

    fn build(&self, recipe: models::Parameters) -> anyhow::Result<Box<dyn Trainable>> {
        let from = &self.from;
        let inputs: Vec<String> =
            self.inputs.iter().map(|name| format!("{name}={}", from.display())).collect();
        task::build(self.task, recipe, &inputs, Some(from), Backend::default())
    }

    /// Writes the recipe, unless it was written before; returns its file. The number of epochs follows from
    /// the time that is left and the measured speed.
    fn recipe(&self, args: &AdaptArgs, session: &SessionArgs, begun: Instant) -> anyhow::Result<PathBuf> {
        let path = args.out.join(self.file);
        if path.exists() {
            return Ok(path);
        }
        let read =
            |changes| RecipeArgs { recipe: self.recipe.map(str::to_owned), set: changes }.read(self.task);
        let data = Data::open(&session.scenarios, Exclusion::read(&[])?, &args.out.join("cache"))?;
        let length = data.length();
        let batch = learning_settings(&read(Vec::new())?, args.seed)?.batch as f64;
        // A short training, of which nothing stays, tells the speed.
        let recipe = read((self.changes)(self.pace_steps as f64 * batch / length, self.pace_steps))?;
        let settings = learning_settings(&recipe, args.seed)?;
        let settings = Settings { held_out: 0.0, ..settings };
        let folder = args.out.join("pace");
        fs::remove_dir_all(&folder).ok();
        let start = Instant::now();
        self.build(recipe)?.learn(Training {
            source: &data,
            settings,
            execution: Execution {
                jobs: session.jobs.count(),
                checkpoint_every: Duration::from_secs(3600),
                keep_every: 0,
            },
            about: Map::new(),
            measure: None,
            observer: &(),
            folder: &folder,
            resume: false,
            stop: &AtomicBool::new(false),
        })?;
        fs::remove_dir_all(&folder).with_context(|| format!("could not remove {}", folder.display()))?;
        let per_second = self.pace_steps as f64 / start.elapsed().as_secs_f64();
        let left = 60.0 * args.minutes * self.until - begun.elapsed().as_secs_f64();
        let steps = (left * per_second - self.validation_steps)
            .max(self.least_steps as f64)
            .min(MOST_EPOCHS * length / batch);
        let recipe = read((self.changes)(steps * batch / length, steps as u64))?;
        say(format_args!(
            "training: {steps:.0} steps of {batch} of {length:.0} scenarios, {per_second:.2} steps/s"
        ));
        let text = recipe_document(&recipe)?;
        write_result(Some(&path), |out| out.write_all(text.as_bytes()))?;
        Ok(path)
    }
}
