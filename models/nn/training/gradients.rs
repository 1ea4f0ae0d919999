//! Loss and gradient of one batch, bit-identical on any number of threads.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use burn::module::Module;
use parking_lot::Mutex;

use super::averages::Observed;
use super::parameters::{self, Layout};
use super::stream::stream;
use super::{Output, Settings, Source, Sums, Task, TrainingError};

/// Sums over the examples of a batch.
#[derive(Debug, Default)]
pub(super) struct BatchSum {
    /// Loss, summed over items.
    pub(super) loss: f64,
    pub(super) items: f64,
    pub(super) metrics: Sums,
    /// Gradient of the loss with respect to all parameters; empty in validation.
    pub(super) gradient: Vec<f32>,
    /// Observations of running averages; empty in validation.
    pub(super) averages: Observed,
    /// Number of examples that yielded a sample.
    pub(super) samples: usize,
    /// Numbers of the examples that yielded none.
    pub(super) passed_over: Vec<usize>,
}

impl BatchSum {
    fn add(&mut self, other: Self) {
        self.loss += other.loss;
        self.items += other.items;
        self.metrics.extend(&other.metrics);
        self.samples += other.samples;
        self.passed_over.extend(&other.passed_over);
        self.averages.add(other.averages);
        if self.gradient.is_empty() {
            self.gradient = other.gradient;
        } else {
            self.gradient.iter_mut().zip(&other.gradient).for_each(|(sum, g)| *sum += g);
        }
    }

    /// Returns the mean loss over items.
    pub(super) fn mean_loss(&self) -> f64 {
        self.loss / self.items
    }
}

/// Examples of one forward pass: place in the order, and number.
pub(super) type Part = Vec<(u64, usize)>;

/// Samples of one forward pass.
#[derive(Debug)]
pub(super) struct Prepared<S> {
    samples: Vec<S>,
    /// Names of their examples.
    ids: Vec<String>,
    /// Numbers of the examples that yielded no sample.
    passed_over: Vec<usize>,
}

impl<S> Default for Prepared<S> {
    fn default() -> Self {
        Self { samples: Vec::new(), ids: Vec::new(), passed_over: Vec::new() }
    }
}

/// Prepared parts by the place of their first example.
type Ahead<S> = BTreeMap<u64, Result<Prepared<S>, TrainingError>>;

/// Runs the network on batches.
pub(super) struct Batches<'a, T: Task, S: ?Sized> {
    pub(super) task: &'a T,
    pub(super) source: &'a S,
    pub(super) settings: &'a Settings,
    pub(super) layout: &'a Layout,
    pub(super) jobs: usize,
    /// Parts of the next batch that are already prepared.
    ahead: Mutex<Ahead<T::Sample>>,
}

impl<'a, T, S> Batches<'a, T, S>
where
    T: Task,
    S: Source<Example = T::Example> + ?Sized,
{
    pub(super) fn new(
        task: &'a T,
        source: &'a S,
        settings: &'a Settings,
        layout: &'a Layout,
        jobs: usize,
    ) -> Self {
        Self { task, source, settings, layout, jobs, ahead: Mutex::default() }
    }

    /// Computes loss and gradient of a batch. Idle threads prepare parts of the `next` batch.
    pub(super) fn learn(
        &self,
        step: u64,
        model: &T::Model,
        values: &[f32],
        parts: &[Part],
        next: &[Part],
    ) -> Result<BatchSum, TrainingError> {
        let unfinished = AtomicUsize::new(parts.len());
        let begun_ahead = AtomicUsize::new(0);
        let work = |model: &T::Model, number: usize| {
            let part = &parts[number];
            let prepared = self.ahead.lock().remove(&place(part)).unwrap_or_else(|| self.prepare(part));
            let result = prepared.and_then(|prepared| self.run(step, model, number, &prepared));
            unfinished.fetch_sub(1, Ordering::Relaxed);
            result
        };
        let idle = || {
            if unfinished.load(Ordering::Relaxed) == 0 {
                return false;
            }
            let Some(part) = next.get(begun_ahead.fetch_add(1, Ordering::Relaxed)) else { return false };
            let prepared = self.prepare(part);
            self.ahead.lock().insert(place(part), prepared);
            true
        };
        let begin = |model: T::Model| parameters::write(model, values);
        self.sum(model, parts.len(), begin, work, idle)
    }

    /// Validates the network, without gradients, on samples after `step` steps.
    pub(super) fn validate(
        &self,
        step: u64,
        model: &T::Model,
        values: &[f32],
        parts: &[Prepared<T::Sample>],
    ) -> Result<BatchSum, TrainingError> {
        let work = |model: &T::Model, number: usize| {
            let part: &Prepared<T::Sample> = &parts[number];
            let output = self.task.validate(model, &part.samples);
            if let Some(cause) = output.failure {
                return Err(TrainingError::Failed { step, cause });
            }
            let sum = Self::batch_sum(&output, part);
            if sum.loss.is_finite() {
                Ok(sum)
            } else {
                Err(not_finite("validation loss", sum.loss, step, part))
            }
        };
        let begin = |model: T::Model| parameters::write(model, values).valid();
        self.sum(model, parts.len(), begin, work, || false)
    }

    /// Prepares samples of unvaried examples, grouped for forward passes; examples without a sample are
    /// left out.
    pub(super) fn prepare_plain(
        &self,
        examples: &[usize],
    ) -> Result<Vec<Prepared<T::Sample>>, TrainingError> {
        let mut parts: Result<Vec<Prepared<T::Sample>>, TrainingError> = Ok(Vec::new());
        let workers = vec![(); self.jobs.min(examples.len()).max(1)];
        let work = |(): &(), i: usize| -> Result<_, TrainingError> {
            let sample = self.task.prepare(&self.read(examples[i])?, None);
            Ok(sample.map(|sample| (sample, self.source.id(examples[i]).to_owned())))
        };
        share(
            workers,
            examples.len(),
            |()| (),
            work,
            || false,
            |sample| {
                let Ok(list) = &mut parts else { return };
                match sample {
                    Ok(None) => {}
                    Ok(Some((sample, id))) => {
                        if list.last().is_none_or(|part| part.samples.len() == self.settings.together) {
                            list.push(Prepared::default());
                        }
                        let part = list.last_mut().expect("one was pushed if there was none");
                        part.samples.push(sample);
                        part.ids.push(id);
                    }
                    Err(error) => parts = Err(error),
                }
            },
        );
        parts
    }

    /// Adds up the results of the parts of a batch, in their order. Every thread begins with a copy of the network.
    fn sum(
        &self,
        model: &T::Model,
        parts: usize,
        begin: impl Fn(T::Model) -> T::Model + Sync,
        work: impl Fn(&T::Model, usize) -> Result<BatchSum, TrainingError> + Sync,
        idle: impl Fn() -> bool + Sync,
    ) -> Result<BatchSum, TrainingError> {
        let models = vec![model.clone(); self.jobs.min(parts).max(1)];
        let mut sum = Ok(BatchSum::default());
        share(models, parts, begin, work, idle, |result| match (&mut sum, result) {
            (Ok(sum), Ok(part)) => sum.add(part),
            (Ok(_), Err(error)) => sum = Err(error),
            (Err(_), _) => {}
        });
        sum
    }

    fn read(&self, number: usize) -> Result<T::Example, TrainingError> {
        let refuse = |cause| TrainingError::Read { example: self.source.id(number).to_owned(), cause };
        let example = self.source.read(number).map_err(refuse)?;
        self.task.check(&example).map_err(refuse)?;
        Ok(example)
    }

    fn prepare(&self, part: &Part) -> Result<Prepared<T::Sample>, TrainingError> {
        let mut prepared = Prepared::default();
        for &(place, number) in part {
            let example = self.read(number)?;
            let id = self.source.id(number);
            let mut stream = stream(self.settings.seed, "vary", place, id);
            match self.task.prepare(&example, Some(&mut stream)) {
                Some(sample) => {
                    prepared.samples.push(sample);
                    prepared.ids.push(id.to_owned());
                }
                None => prepared.passed_over.push(number),
            }
        }
        Ok(prepared)
    }

    fn run(
        &self,
        step: u64,
        model: &T::Model,
        part: usize,
        prepared: &Prepared<T::Sample>,
    ) -> Result<BatchSum, TrainingError> {
        if prepared.samples.is_empty() {
            return Ok(BatchSum { passed_over: prepared.passed_over.clone(), ..BatchSum::default() });
        }
        let mut stream = stream(self.settings.seed, "loss", step, &part.to_string());
        let output = self.task.loss(model, &prepared.samples, Some(&mut stream));
        if let Some(cause) = output.failure {
            return Err(TrainingError::Failed { step: step + 1, cause });
        }
        let mut sum = Self::batch_sum(&output, prepared);
        if !sum.loss.is_finite() {
            return Err(not_finite("loss", sum.loss, step + 1, prepared));
        }
        let Output { loss, items, averages, .. } = output;
        // Nothing was judged, so there is nothing to learn from, and the loss has no gradient.
        if items == 0.0 {
            sum.gradient = vec![0.0; self.layout.len];
            return Ok(sum);
        }
        sum.gradient = parameters::gradients(model, loss.backward(), self.layout.len);
        let norm = norm(&sum.gradient);
        if !norm.is_finite() {
            return Err(not_finite("norm of the gradient", norm, step + 1, prepared));
        }
        sum.averages = Observed::of(averages, items);
        match sum.averages.not_finite() {
            None => Ok(sum),
            Some(value) => Err(not_finite("value of a running average", value.into(), step + 1, prepared)),
        }
    }

    fn batch_sum(output: &Output, prepared: &Prepared<T::Sample>) -> BatchSum {
        BatchSum {
            loss: f64::from(output.loss.clone().into_scalar::<f32>()),
            items: output.items,
            metrics: output.metrics.clone(),
            gradient: Vec::new(),
            averages: Observed::default(),
            samples: prepared.samples.len(),
            passed_over: prepared.passed_over.clone(),
        }
    }
}

fn not_finite<S>(what: &'static str, value: f64, step: u64, prepared: &Prepared<S>) -> TrainingError {
    TrainingError::NotFinite { what, value, step, examples: prepared.ids.clone() }
}

/// Returns the Euclidean norm of a list.
pub(super) fn norm(list: &[f32]) -> f64 {
    list.iter().map(|g| f64::from(*g) * f64::from(*g)).sum::<f64>().sqrt()
}

fn place(part: &Part) -> u64 {
    part.first().map_or(0, |(place, _)| *place)
}

/// Distributes the numbers below `end` to threads, one thread per seed of a worker, and passes the
/// results to `take` in the order of the numbers. A thread without a further number does `idle` work
/// until there is none.
fn share<W: Send, V, R: Send>(
    seeds: Vec<W>,
    end: usize,
    begin: impl Fn(W) -> V + Sync,
    work: impl Fn(&V, usize) -> R + Sync,
    idle: impl Fn() -> bool + Sync,
    take: impl FnMut(R) + Send,
) {
    struct Results<R, F> {
        next: usize,
        waiting: BTreeMap<usize, R>,
        take: F,
    }
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Results { next: 0, waiting: BTreeMap::new(), take });
    let run = |seed: W| {
        let worker = begin(seed);
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= end {
                break;
            }
            let result = work(&worker, number);
            let mut guard = results.lock();
            let results = &mut *guard;
            results.waiting.insert(number, result);
            while let Some(result) = results.waiting.remove(&results.next) {
                (results.take)(result);
                results.next += 1;
            }
        }
        while idle() {}
    };
    std::thread::scope(|scope| {
        let mut seeds = seeds.into_iter();
        let own = seeds.next();
        for seed in seeds {
            scope.spawn(|| run(seed));
        }
        own.into_iter().for_each(run);
    });
}
