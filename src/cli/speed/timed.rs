//! A simulator whose time is measured.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::rollout::{Beginning, Episode, Memory, PlanError, Simulator};

/// Time that all threads together spent in a simulator.
#[derive(Debug, Default)]
pub(super) struct NetworkTime {
    nanoseconds: AtomicU64,
}

impl NetworkTime {
    pub(super) fn reset(&self) {
        self.nanoseconds.store(0, Ordering::Relaxed);
    }

    pub(super) fn total(&self) -> Duration {
        Duration::from_nanos(self.nanoseconds.load(Ordering::Relaxed))
    }

    fn add(&self, began: Instant) {
        let nanoseconds = u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.nanoseconds.fetch_add(nanoseconds, Ordering::Relaxed);
    }
}

/// Passes calls on to a simulator, and adds up their time.
pub(super) struct Timed {
    inner: Box<dyn Simulator>,
    time: Arc<NetworkTime>,
}

impl Timed {
    pub(super) fn new(inner: Box<dyn Simulator>, time: Arc<NetworkTime>) -> Self {
        Self { inner, time }
    }
}

impl Simulator for Timed {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let began = Instant::now();
        let result = self.inner.begin_batch(batch);
        self.time.add(began);
        result
    }

    fn wants_identity(&self) -> bool {
        self.inner.wants_identity()
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        self.inner.end_batch(memories);
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let began = Instant::now();
        let result = self.inner.plan(batch);
        self.time.add(began);
        result
    }
}
