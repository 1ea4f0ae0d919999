//! The training loop.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use burn::module::Module;
use serde_json::{Map, Value, json};

use super::adamw::AdamW;
use super::checkpoint::{Best, Checkpoint, Progress, named};
use super::folder::Folder;
use super::gradients::{BatchSum, Batches, Part, Prepared, norm};
use super::log::{Row, StepRow, ValidationRow, Wall};
use super::order::{Order, Split, split};
use super::parameters::{self, Layout};
use super::schedule::learning_rate;
use super::settings::LOSS;
use super::tensors::{NamedTensors, replace};
use super::{Execution, Settings, Source, Task, TrainingError};

/// A training: task, data and settings.
pub struct Learner<'a, T: Task, S: ?Sized> {
    /// The network and its loss.
    pub task: &'a T,
    /// Training data.
    pub source: &'a S,
    /// Settings that determine the result.
    pub settings: Settings,
    /// Settings that do not change the result.
    pub execution: Execution,
    /// Fields written to `training.json` in addition to settings, task and data.
    pub about: Map<String, Value>,
    /// Closed-loop evaluation at every validation, if any.
    pub closed_loop: Option<&'a ClosedLoop<'a, T::Model>>,
    /// Receiver of progress events.
    pub observer: &'a dyn Observer,
}

/// Evaluates a network in closed loop after a number of steps: metrics by name, or none if nothing is
/// due at this step. The network has no autodiff. The error is a message.
pub type ClosedLoop<'a, M> = dyn Fn(&M, u64) -> Result<BTreeMap<String, f64>, String> + 'a;

/// Receiver of the progress events of a training.
pub trait Observer {
    /// Called when the training begins or resumes, after `step` of `steps` steps.
    fn begun(&self, _step: u64, _steps: u64) {}
    /// Called for every row of the log.
    fn row(&self, _row: &Row) {}
    /// Called after a checkpoint was written.
    fn checkpoint(&self, _path: &Path) {}
    /// Called once for every example that yields no sample.
    fn passed_over(&self, _id: &str) {}
}

/// Observer that ignores all events.
impl Observer for () {}

/// Result of a training.
#[derive(Debug)]
pub struct Outcome<M> {
    /// Reason for the end.
    pub ending: Ending,
    /// The network after the last step.
    pub model: M,
    /// Number of steps taken, including those before an interruption.
    pub steps: u64,
    /// The best validation; `None` without held-out examples.
    pub best: Option<Best>,
}

/// Reason for the end of a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All epochs are done.
    Finished,
    /// Validations stopped improving.
    NoImprovement,
    /// It was interrupted on request; it can be resumed.
    Interrupted,
}

/// State of a running training.
struct Run<'a, T: Task, S: ?Sized> {
    batches: Batches<'a, T, S>,
    model: T::Model,
    held_out: Vec<Prepared<T::Sample>>,
    folder: Folder,
    order: Order,
    steps: u64,
    state: Checkpoint,
    begun: Instant,
    /// Numbers of the examples without a sample that the observer knows of.
    reported: BTreeSet<usize>,
    /// Whether any batch had items since the program began.
    learned: bool,
}

impl<T, S> Learner<'_, T, S>
where
    T: Task,
    S: Source<Example = T::Example> + ?Sized,
{
    /// Trains in a folder until all epochs are done, validations stop improving, or `stop` is set.
    ///
    /// # Errors
    /// [`TrainingError`]; the last checkpoint stays, and the training can be resumed from it once the
    /// cause is fixed.
    pub fn learn(
        &self,
        folder: &Path,
        resume: bool,
        stop: &AtomicBool,
    ) -> Result<Outcome<T::Model>, TrainingError> {
        let settings = &self.settings;
        if let Some(refusal) = settings.refuse() {
            return Err(TrainingError::Setting(refusal));
        }
        let split = split(self.source, settings);
        let order = Order::new(settings.seed, &split.learned);
        if order.length() == 0 {
            let held = split.held_out.len();
            return Err(TrainingError::NoData(format!("no scenario is left to train on ({held} held out)")));
        }
        if settings.best_by != LOSS && self.closed_loop.is_none() {
            let name = &settings.best_by;
            return Err(TrainingError::Setting(format!(
                "best_by is `{name}`, but there is no closed-loop evaluation: give its scenarios, or choose by `{LOSS}`"
            )));
        }
        let model = self.task.init(settings.seed);
        let (layout, values) = parameters::read(&model);
        let identity = self.identity(&split);
        let (folder, old) = if resume {
            Folder::resume(folder, identity, &self.about, &layout)?
        } else {
            (Folder::create(folder, identity, &self.about)?, None)
        };
        let new = || {
            let adamw = AdamW::new(layout.len);
            Checkpoint { progress: Progress::default(), values, adamw }
        };
        let begins = old.is_none();
        let batches = Batches::new(self.task, self.source, settings, &layout, self.execution.jobs);
        let mut run = Run {
            held_out: batches.prepare_plain(&split.held_out)?,
            batches,
            model,
            folder,
            steps: (order.length() as f64 * settings.epochs / settings.batch as f64).ceil() as u64,
            order,
            state: old.unwrap_or_else(new),
            begun: Instant::now(),
            reported: BTreeSet::new(),
            learned: false,
        };
        self.find_weights(&run)?;
        self.observer.begun(run.state.progress.step, run.steps);
        if begins {
            if self.task.begins_trained() {
                self.validate(&mut run)?;
            }
            // Detect a folder that cannot hold a checkpoint before the first step.
            self.checkpoint(&mut run)?;
            self.keep(&run)?;
        }
        self.run(&mut run, stop)
    }

    fn run(&self, run: &mut Run<'_, T, S>, stop: &AtomicBool) -> Result<Outcome<T::Model>, TrainingError> {
        let settings = &self.settings;
        let first = run.state.progress.step;
        let (mut kept, mut kept_at) = (first, Instant::now());
        let ending = loop {
            let step = run.state.progress.step;
            if settings.patience > 0 && run.state.progress.stale >= settings.patience {
                break Ending::NoImprovement;
            } else if step >= run.steps {
                break Ending::Finished;
            } else if stop.load(Ordering::Relaxed) {
                break Ending::Interrupted;
            }
            self.step(run)?;
            let step = step + 1;
            let places = (step - first).saturating_mul(settings.batch as u64);
            if !run.learned && places >= run.order.length() as u64 {
                return Err(TrainingError::NoData(format!(
                    "none of {} scenarios yields a training sample",
                    run.reported.len()
                )));
            }
            if step.is_multiple_of(settings.validate_every) || step == run.steps {
                self.validate(run)?;
            }
            if step != run.steps {
                self.keep(run)?;
            }
            if kept_at.elapsed() >= self.execution.checkpoint_every {
                self.checkpoint(run)?;
                (kept, kept_at) = (step, Instant::now());
            }
        };
        let progress = &run.state.progress;
        let (steps, best) = (progress.step, progress.best);
        if steps > kept {
            self.checkpoint(run)?;
        }
        if self.execution.keep_every > 0 && ending != Ending::Interrupted {
            self.put_kept(run)?;
        }
        if run.held_out.is_empty() && ending != Ending::Interrupted {
            self.put_weights(run)?;
        }
        let model = parameters::write(run.model.clone(), &run.state.values);
        Ok(Outcome { ending, model, steps, best })
    }

    /// One step of the optimiser.
    fn step(&self, run: &mut Run<'_, T, S>) -> Result<(), TrainingError> {
        let began = Instant::now();
        let step = run.state.progress.step;
        let parts = self.parts(&mut run.order, step);
        let next = if step + 1 < run.steps { self.parts(&mut run.order, step + 1) } else { Vec::new() };
        let mut batch = run.batches.learn(step, &run.model, &run.state.values, &parts, &next)?;
        for number in std::mem::take(&mut batch.passed_over) {
            if run.reported.insert(number) {
                self.observer.passed_over(self.source.id(number));
            }
        }
        let rate = learning_rate(&self.settings, step, run.steps);
        let gradient_norm = self.descend(run.batches.layout, &mut run.state, rate, &mut batch);
        run.state.progress.step += 1;
        run.state.progress.updates = run.state.adamw.updates;
        run.learned |= batch.items > 0.0;
        let seconds = began.elapsed().as_secs_f64();
        let row = Row::Step(StepRow {
            step: step + 1,
            epoch: self.epoch(run),
            loss: (batch.items > 0.0).then(|| batch.mean_loss()),
            learning_rate: rate,
            gradient_norm,
            items: batch.items,
            samples: batch.samples,
            metrics: batch.metrics.means(),
            wall: Self::wall(run, batch.samples, seconds),
        });
        self.log(run, &row)
    }

    /// Updates the parameters. Returns the norm of the gradient before clipping.
    fn descend(&self, layout: &Layout, state: &mut Checkpoint, rate: f64, batch: &mut BatchSum) -> f64 {
        if batch.items <= 0.0 {
            return 0.0;
        }
        batch.averages.apply(layout, &mut state.values);
        let length = norm(&batch.gradient) / batch.items;
        let clipped = if length > self.settings.clip { self.settings.clip / length } else { 1.0 };
        let scale = clipped / batch.items;
        batch.gradient.iter_mut().for_each(|g| *g = (f64::from(*g) * scale) as f32);
        state.adamw.update(&self.settings, layout, rate, &mut state.values, &batch.gradient);
        length
    }

    /// Validates on the held-out examples, and writes the weights if they are the best so far.
    fn validate(&self, run: &mut Run<'_, T, S>) -> Result<(), TrainingError> {
        if run.held_out.is_empty() {
            return Ok(());
        }
        let began = Instant::now();
        let step = run.state.progress.step;
        let sum = run.batches.validate(step, &run.model, &run.state.values, &run.held_out)?;
        let seconds = began.elapsed().as_secs_f64();
        if sum.items <= 0.0 {
            return Ok(());
        }
        let closed_loop = match self.closed_loop {
            Some(measure) => {
                let model = parameters::write(run.model.clone(), &run.state.values).valid();
                measure(&model, step).map_err(TrainingError::ClosedLoop)?
            }
            None => BTreeMap::new(),
        };
        let loss = sum.mean_loss();
        let value = self.criterion(loss, &closed_loop)?;
        let best = run.state.progress.best.is_none_or(|best| value < best.value);
        if best {
            run.state.progress.best = Some(Best { step, value });
            run.state.progress.stale = 0;
            self.put_weights(run)?;
        } else {
            run.state.progress.stale += 1;
        }
        let row = Row::Validation(ValidationRow {
            step,
            epoch: self.epoch(run),
            loss,
            best,
            items: sum.items,
            samples: sum.samples,
            metrics: sum.metrics.means(),
            closed_loop,
            wall: Self::wall(run, sum.samples, seconds),
        });
        self.log(run, &row)
    }

    /// Returns the value that the best network is lowest in.
    fn criterion(&self, loss: f64, closed_loop: &BTreeMap<String, f64>) -> Result<f64, TrainingError> {
        match self.settings.best_by.as_str() {
            LOSS => Ok(loss),
            name => closed_loop.get(name).copied().ok_or_else(|| {
                TrainingError::Setting(format!(
                    "best_by is `{name}`, which the closed-loop evaluation has no value of"
                ))
            }),
        }
    }

    fn checkpoint(&self, run: &mut Run<'_, T, S>) -> Result<(), TrainingError> {
        let mut state = run.state.clone();
        state.progress.seconds = Self::seconds(run);
        let path = run.folder.keep(&state, run.batches.layout)?;
        self.observer.checkpoint(&path);
        Ok(())
    }

    /// Keeps the current network, if its step is one of those to keep.
    fn keep(&self, run: &Run<'_, T, S>) -> Result<(), TrainingError> {
        let (step, every) = (run.state.progress.step, self.execution.keep_every);
        if every == 0 || !step.is_multiple_of(every) { Ok(()) } else { self.put_kept(run) }
    }

    fn put_kept(&self, run: &Run<'_, T, S>) -> Result<(), TrainingError> {
        self.write_network(run, &run.folder.weights_of(run.state.progress.step), self.weights(run))
    }

    /// Writes the current network as the best one.
    fn put_weights(&self, run: &Run<'_, T, S>) -> Result<(), TrainingError> {
        let mut weights = self.weights(run);
        let name = match self.settings.best_by.as_str() {
            LOSS => "validation_loss",
            name => name,
        };
        weights.about.insert(name.to_owned(), json!(run.state.progress.best.map(|b| b.value)));
        self.write_network(run, &run.folder.weights(), weights)
    }

    /// Writes the current network, whose parameters are `weights`, in the file format of the task.
    fn write_network(
        &self,
        run: &Run<'_, T, S>,
        path: &Path,
        weights: NamedTensors,
    ) -> Result<(), TrainingError> {
        let mut about = weights.about.clone();
        about.insert("training".to_owned(), run.folder.identity().clone());
        let model = parameters::write(run.model.clone(), &run.state.values).valid();
        let metadata = BTreeMap::from([("made".to_owned(), Value::Object(about).to_string())]);
        match self.task.file(&model, &metadata) {
            Some(bytes) => replace(path, &bytes),
            None => run.folder.put_weights(path, weights),
        }
    }

    /// Checks that the best weights so far are still there, or writes them again if
    /// they are those of the checkpoint.
    fn find_weights(&self, run: &Run<'_, T, S>) -> Result<(), TrainingError> {
        let Progress { step, best: Some(best), .. } = run.state.progress else { return Ok(()) };
        match run.folder.weights() {
            path if path.exists() => Ok(()),
            _ if best.step == step => self.put_weights(run),
            path => Err(TrainingError::WeightsLost { path, best: best.step, step }),
        }
    }

    /// Returns the network's current parameters.
    fn weights(&self, run: &Run<'_, T, S>) -> NamedTensors {
        let mut weights = NamedTensors::default();
        weights.tensors.extend(named(run.batches.layout, &run.state.values, ""));
        weights.about.insert("step".to_owned(), run.state.progress.step.into());
        weights
    }

    /// Returns the identity of the training: settings, task and data.
    fn identity(&self, split: &Split) -> Value {
        let learned: usize = split.learned.iter().map(|(numbers, _)| numbers.len()).sum();
        json!({
            "settings": self.settings,
            "task": self.task.describe(),
            "data": { "digest": self.source.digest(), "learned": learned, "held_out": split.held_out.len() },
        })
    }

    /// Returns the parts of a step's batch.
    fn parts(&self, order: &mut Order, step: u64) -> Vec<Part> {
        let places = step * self.settings.batch as u64..(step + 1) * self.settings.batch as u64;
        let examples: Vec<(u64, usize)> = places.clone().zip(order.at(places)).collect();
        examples.chunks(self.settings.together).map(<[_]>::to_vec).collect()
    }

    /// Returns the number of epochs done, fractional.
    fn epoch(&self, run: &Run<'_, T, S>) -> f64 {
        (run.state.progress.step * self.settings.batch as u64) as f64 / run.order.length() as f64
    }

    /// Adds a row to the log.
    fn log(&self, run: &mut Run<'_, T, S>, row: &Row) -> Result<(), TrainingError> {
        run.folder.append(row)?;
        self.observer.row(row);
        Ok(())
    }

    /// Returns the times and the memory of a row whose samples took these seconds.
    fn wall(run: &Run<'_, T, S>, samples: usize, seconds: f64) -> Wall {
        let per_second = samples as f64 / seconds.max(1e-9);
        Wall { seconds: Self::seconds(run), per_second, memory: memory() }
    }

    /// Returns the seconds since the training began, without interruptions.
    fn seconds(run: &Run<'_, T, S>) -> f64 {
        run.state.progress.seconds + run.begun.elapsed().as_secs_f64()
    }
}

/// Returns the memory in use by the program, bytes; 0 if unknown.
fn memory() -> u64 {
    memory_stats::memory_stats().map_or(0, |stats| stats.physical_mem as u64)
}
