//! The loss and the gradient of one batch, on several threads, to the same bits on any number of them.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use burn::module::Module;

use super::parameters::{self, Layout};
use super::stream::stream;
use super::{Output, Settings, Source, Sums, Task, TrainingError, View};

/// What a batch came to.
#[derive(Debug, Default)]
pub(super) struct BatchSum {
    /// Loss, summed over items.
    pub(super) loss: f64,
    pub(super) items: f64,
    pub(super) metrics: Sums,
    /// Gradient of the loss by all parameters; empty while validating.
    pub(super) gradient: Vec<f32>,
    /// Examples in which there was something to learn.
    pub(super) samples: usize,
    /// Numbers of those in which there was nothing.
    pub(super) passed_over: Vec<usize>,
}

impl BatchSum {
    fn add(&mut self, other: &Self) {
        self.loss += other.loss;
        self.items += other.items;
        self.metrics.extend(&other.metrics);
        self.samples += other.samples;
        self.passed_over.extend(&other.passed_over);
        if self.gradient.is_empty() {
            self.gradient.clone_from(&other.gradient);
        } else {
            self.gradient.iter_mut().zip(&other.gradient).for_each(|(sum, g)| *sum += g);
        }
    }

    /// Mean of the loss over items.
    pub(super) fn mean_loss(&self) -> f64 {
        self.loss / self.items
    }
}

/// Examples by place in the order and number, that the network sees together.
pub(super) type Part = Vec<(u64, usize)>;

/// Samples that the network sees together.
#[derive(Debug)]
pub(super) struct Prepared<S> {
    samples: Vec<S>,
    /// The names of the examples that they were made of.
    ids: Vec<String>,
    /// Numbers of the examples that nothing was made of.
    passed_over: Vec<usize>,
}

impl<S> Default for Prepared<S> {
    fn default() -> Self {
        Self { samples: Vec::new(), ids: Vec::new(), passed_over: Vec::new() }
    }
}

/// Parts by the place of their first example.
type Ahead<S> = BTreeMap<u64, Result<Prepared<S>, TrainingError>>;

/// Runs the network on batches.
pub(super) struct Batches<'a, T: Task, S> {
    pub(super) task: &'a T,
    pub(super) source: &'a S,
    pub(super) settings: &'a Settings,
    pub(super) layout: &'a Layout,
    pub(super) jobs: usize,
    /// What was prepared ahead.
    ahead: Mutex<Ahead<T::Sample>>,
}

impl<'a, T, S> Batches<'a, T, S>
where
    T: Task,
    S: Source<Example = T::Example>,
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

    /// Loss and gradient of a batch. Threads that find nothing more to do in it prepare parts of the `next` one.
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
            let prepared = lock(&self.ahead).remove(&place(part)).unwrap_or_else(|| self.prepare(part));
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
            lock(&self.ahead).insert(place(part), prepared);
            true
        };
        let models = (0..self.jobs.min(parts.len()).max(1)).map(|_| model.clone()).collect();
        let begin = |model: T::Model| parameters::write(model, values);
        self.sum(models, parts.len(), begin, work, idle)
    }

    /// What the network without its gradients comes to on samples after `step` steps.
    pub(super) fn judge(
        &self,
        step: u64,
        model: &T::Model,
        values: &[f32],
        parts: &[Prepared<T::Sample>],
    ) -> Result<BatchSum, TrainingError> {
        let work = |model: &T::Model, number: usize| {
            let part: &Prepared<T::Sample> = &parts[number];
            let sum = Self::judged(&self.task.validate(model, &part.samples), part);
            if sum.loss.is_finite() {
                Ok(sum)
            } else {
                Err(not_finite("validation loss", sum.loss, step, part))
            }
        };
        let models = (0..self.jobs.min(parts.len()).max(1)).map(|_| model.clone()).collect();
        let begin = |model: T::Model| parameters::write(model, values).valid();
        self.sum(models, parts.len(), begin, work, || false)
    }

    /// Samples of examples as they are, some at a time; examples in which there is nothing are left out.
    pub(super) fn plain(&self, examples: &[usize]) -> Result<Vec<Prepared<T::Sample>>, TrainingError> {
        let mut parts: Result<Vec<Prepared<T::Sample>>, TrainingError> = Ok(Vec::new());
        let workers = vec![(); self.jobs.min(examples.len()).max(1)];
        let work = |(): &(), i: usize| -> Result<_, TrainingError> {
            let sample = self.task.prepare(&self.read(examples[i])?, View::Plain);
            Ok(sample.map(|sample| (sample, self.source.id(examples[i]).to_owned())))
        };
        share(
            workers,
            examples.len(),
            |()| (),
            work,
            || false,
            |made| {
                let Ok(list) = &mut parts else { return };
                match made {
                    Ok(None) => {}
                    Ok(Some((sample, id))) => {
                        if list.last().is_none_or(|part| part.samples.len() == self.settings.together) {
                            list.push(Prepared::default());
                        }
                        let part = list.last_mut().expect("one was pushed where there was none");
                        part.samples.push(sample);
                        part.ids.push(id);
                    }
                    Err(error) => parts = Err(error),
                }
            },
        );
        parts
    }

    /// Adds up what the parts of a batch come to, in their order.
    fn sum(
        &self,
        models: Vec<T::Model>,
        parts: usize,
        begin: impl Fn(T::Model) -> T::Model + Sync,
        work: impl Fn(&T::Model, usize) -> Result<BatchSum, TrainingError> + Sync,
        idle: impl Fn() -> bool + Sync,
    ) -> Result<BatchSum, TrainingError> {
        let mut sum = Ok(BatchSum::default());
        share(models, parts, begin, work, idle, |result| match (&mut sum, result) {
            (Ok(sum), Ok(part)) => sum.add(&part),
            (Ok(_), Err(error)) => sum = Err(error),
            (Err(_), _) => {}
        });
        sum
    }

    fn read(&self, number: usize) -> Result<T::Example, TrainingError> {
        let refuse = |cause| TrainingError::Read { example: self.source.id(number).to_owned(), cause };
        self.source.read(number).map_err(refuse)
    }

    fn prepare(&self, part: &Part) -> Result<Prepared<T::Sample>, TrainingError> {
        let mut prepared = Prepared::default();
        for &(place, number) in part {
            let example = self.read(number)?;
            let id = self.source.id(number);
            let mut stream = stream(self.settings.seed, "vary", place, id);
            match self.task.prepare(&example, View::Varied(&mut stream)) {
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
        let mut sum = Self::judged(&output, prepared);
        if !sum.loss.is_finite() {
            return Err(not_finite("loss", sum.loss, step + 1, prepared));
        }
        sum.gradient = parameters::gradients(model, output.loss.backward(), self.layout.len);
        let norm = norm(&sum.gradient);
        if norm.is_finite() {
            Ok(sum)
        } else {
            Err(not_finite("norm of the gradient", norm, step + 1, prepared))
        }
    }

    fn judged(output: &Output, prepared: &Prepared<T::Sample>) -> BatchSum {
        BatchSum {
            loss: f64::from(output.loss.clone().into_scalar::<f32>()),
            items: output.items,
            metrics: output.metrics.clone(),
            gradient: Vec::new(),
            samples: prepared.samples.len(),
            passed_over: prepared.passed_over.clone(),
        }
    }
}

fn not_finite<S>(what: &'static str, value: f64, step: u64, prepared: &Prepared<S>) -> TrainingError {
    TrainingError::NotFinite { what, value, step, examples: prepared.ids.clone() }
}

/// Euclidean norm of a list.
pub(super) fn norm(list: &[f32]) -> f64 {
    list.iter().map(|g| f64::from(*g) * f64::from(*g)).sum::<f64>().sqrt()
}

fn place(part: &Part) -> u64 {
    part.first().map_or(0, |(place, _)| *place)
}

/// What a mutex guards. A thread that panicked while it held it ends the program anyway.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Shares the numbers below `end` among threads, one for each seed of a worker, and hands the results over in the order of the numbers. A
/// thread that finds no number any more asks for `idle` work until there is none.
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
            let mut guard = lock(&results);
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
