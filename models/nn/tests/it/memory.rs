//! Amount of data in memory at a time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use reactsim_nn::training::{Execution, Learner, Output, Settings, Source, Stream, Task};
use serde_json::Map;

use super::toy::{Net, Toy, settings};

/// Counts the living objects among those that it handed out.
#[derive(Default)]
struct Counter {
    alive: AtomicUsize,
    most: AtomicUsize,
}

struct Counted(Arc<Counter>);

impl Counted {
    fn new(counter: &Arc<Counter>) -> Self {
        let alive = counter.alive.fetch_add(1, Ordering::Relaxed) + 1;
        counter.most.fetch_max(alive, Ordering::Relaxed);
        Self(Arc::clone(counter))
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.alive.fetch_sub(1, Ordering::Relaxed);
    }
}

struct Many {
    ids: Vec<String>,
    examples: Arc<Counter>,
}

impl Source for Many {
    type Example = (f32, Counted);

    fn len(&self) -> usize {
        self.ids.len()
    }

    fn id(&self, number: usize) -> &str {
        &self.ids[number]
    }

    fn digest(&self) -> String {
        String::new()
    }

    fn read(&self, number: usize) -> Result<Self::Example, String> {
        Ok((number as f32 / self.len() as f32, Counted::new(&self.examples)))
    }
}

struct Counting(Arc<Counter>);

impl Task for Counting {
    type Example = (f32, Counted);
    type Sample = ((f32, f32), Counted);
    type Model = Net;

    fn init(&self, seed: u64) -> Net {
        Toy::default().init(seed)
    }

    fn prepare(&self, example: &Self::Example, stream: Option<&mut Stream>) -> Option<Self::Sample> {
        Some((Toy::default().prepare(&example.0, stream)?, Counted::new(&self.0)))
    }

    fn loss(&self, model: &Net, samples: &[Self::Sample], stream: Option<&mut Stream>) -> Output {
        let samples: Vec<(f32, f32)> = samples.iter().map(|s| s.0).collect();
        Toy::default().loss(model, &samples, stream)
    }
}

#[test]
fn only_two_batches_are_in_memory_however_many_examples_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let (examples, samples) = (Arc::new(Counter::default()), Arc::new(Counter::default()));
    let source = Many { ids: (0..2000).map(|i| i.to_string()).collect(), examples: Arc::clone(&examples) };
    let settings =
        Settings { epochs: 1.0, batch: 16, together: 2, held_out: 0.01, most_held_out: 20, ..settings() };
    let learner = Learner {
        task: &Counting(Arc::clone(&samples)),
        source: &source,
        settings,
        execution: Execution {
            jobs: 4,
            checkpoint_every: std::time::Duration::from_secs(3600),
            keep_every: 0,
        },
        about: Map::new(),
        closed_loop: None,
        observer: &(),
    };
    learner.learn(folder.path(), false, &AtomicBool::new(false)).unwrap();
    let most = |counter: &Counter| counter.most.load(Ordering::Relaxed);
    // One example per thread; samples of this batch and the next, and those that are held out.
    assert!(most(&examples) <= 4, "{}", most(&examples));
    assert!(most(&samples) <= 16 + 16 + 20, "{}", most(&samples));
    assert_eq!(samples.alive.load(Ordering::Relaxed), 0);
}
