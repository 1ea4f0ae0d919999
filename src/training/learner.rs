//! The loop.

use std::sync::atomic::{AtomicBool, Ordering};

use super::adamw::AdamW;
use super::gradients::{BatchSum, Batches, Part, norm};
use super::order::{Order, split};
use super::parameters::{self, Layout};
use super::schedule::learning_rate;
use super::{Execution, Settings, Source, Task, TrainingError};

/// What is trained, on what and how.
pub struct Learner<'a, T, S> {
    /// The network.
    pub task: &'a T,
    /// What it learns from.
    pub source: &'a S,
    /// What decides about the outcome.
    pub settings: Settings,
    /// What does not.
    pub execution: Execution,
}

/// How a training ended.
#[derive(Debug)]
pub struct Outcome<M> {
    /// The network as it is now.
    pub model: M,
    /// Steps that were taken.
    pub steps: u64,
    /// Mean loss of the last step.
    pub loss: f64,
}

impl<T, S> Learner<'_, T, S>
where
    T: Task,
    S: Source<Example = T::Example>,
{
    /// Trains until the data were gone through as often as asked, or until `stop` is set.
    ///
    /// # Errors
    /// [`TrainingError`] for settings that can not be, for data without anything to learn, and where the loss is no number any more.
    pub fn learn(&self, stop: &AtomicBool) -> Result<Outcome<T::Model>, TrainingError> {
        let settings = &self.settings;
        if let Some(refusal) = settings.refuse() {
            return Err(TrainingError::Setting(refusal));
        }
        let split = split(self.source, settings);
        let mut order = Order::new(settings.seed, &split.learned);
        if order.length() == 0 {
            return Err(TrainingError::NoData("no example is left after holding some out".to_owned()));
        }
        let model = self.task.init(settings.seed);
        let (layout, mut values) = parameters::read(&model);
        let batches = Batches::new(self.task, self.source, settings, &layout, self.execution.jobs);
        let held_out = batches.plain(&split.held_out)?;
        let mut adamw = AdamW::new(layout.len);
        let steps = (order.length() as f64 * settings.epochs / settings.batch as f64).ceil() as u64;
        let mut last = f64::NAN;
        let mut step = 0;
        while step < steps && !stop.load(Ordering::Relaxed) {
            let parts = self.parts(&mut order, step);
            let next = if step + 1 < steps { self.parts(&mut order, step + 1) } else { Vec::new() };
            let batch = batches.learn(step, &model, &values, &parts, &next)?;
            last = batch.mean_loss();
            Self::descend(
                settings,
                &layout,
                &mut adamw,
                learning_rate(settings, step, steps),
                &mut values,
                batch,
            );
            step += 1;
            if step % settings.validate_every == 0 || step == steps {
                batches.judge(&model, &values, &held_out)?;
            }
        }
        Ok(Outcome { model: parameters::write(model, &values), steps: step, loss: last })
    }

    /// The parts of a step's batch.
    fn parts(&self, order: &mut Order, step: u64) -> Vec<Part> {
        let places = step * self.settings.batch as u64..(step + 1) * self.settings.batch as u64;
        let examples: Vec<(u64, usize)> = places.clone().zip(order.at(places)).collect();
        examples.chunks(self.settings.together).map(<[_]>::to_vec).collect()
    }

    /// One step of the optimiser; the norm of the gradient before clipping.
    fn descend(
        settings: &Settings,
        layout: &Layout,
        adamw: &mut AdamW,
        rate: f64,
        values: &mut [f32],
        batch: BatchSum,
    ) -> f64 {
        if batch.items <= 0.0 {
            return 0.0;
        }
        let mut gradient = batch.gradient;
        let length = norm(&gradient) / batch.items;
        let scale = (settings.clip / length).min(1.0) / batch.items;
        gradient.iter_mut().for_each(|g| *g = (f64::from(*g) * scale) as f32);
        adamw.update(settings, layout, rate, values, &gradient);
        length
    }
}
