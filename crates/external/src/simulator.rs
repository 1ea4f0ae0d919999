//! A simulator whose plans come from a process.

use std::sync::Arc;

use parking_lot::Mutex;
use rand::Rng;
use reactsim_rollout::{
    Beginning, Continuation, Controller, Episode, Memory, PlanError, Request, Settings, Simulator, roll_out,
};
use reactsim_scene::Length;

use super::ExternalError;
use super::batch::OpenBatch;
use super::length;
use super::processes::Processes;
use super::replies::Role;
use super::settings::{DEFAULT_BATCH, ExternalSettings, RunOutline};

/// A simulator that runs as a program of its own, in one or several processes. Clones share the processes,
/// which end when the last clone is dropped.
#[derive(Clone)]
pub struct ExternalSimulator {
    processes: Processes,
}

/// Memory of an episode: the batch that it is part of, and its index there.
struct EpisodeMemory {
    /// Shared by the episodes of the batch; it ends with the last one.
    batch: Arc<Mutex<OpenBatch>>,
    index: usize,
}

/// Episodes that began together, with their indices in the batch.
struct Together<'a, 'b> {
    batch: Arc<Mutex<OpenBatch>>,
    episodes: Vec<(usize, &'a mut Episode<'b>)>,
}

impl ExternalSimulator {
    /// Starts one process, which states what it is and whether it supports the run.
    ///
    /// # Errors
    /// [`ExternalError`] for wrong settings, if the process does not start or greet, or does not support the
    /// replan intervals of the run.
    pub fn start(settings: ExternalSettings, outline: RunOutline) -> Result<Self, ExternalError> {
        let intervals = outline.intervals.clone();
        let processes = Processes::start(settings, outline, Role::Simulator)?;
        let own = &processes.description.intervals;
        let unsupported = intervals.iter().find(|steps| !own.contains(steps));
        let nearest = |asked: usize| own.iter().min_by_key(|own| own.abs_diff(asked));
        if let Some((asked, hint)) = unsupported.and_then(|asked| Some((asked, nearest(*asked)?))) {
            let supported = own.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
            return Err(ExternalError(format!(
                "external program `{}` plans every {supported} steps, this run every {asked}: give `replan` \
                 {hint}steps",
                processes.name()
            )));
        }
        Ok(Self { processes })
    }

    /// Returns the number of episodes per batch: that of the settings, else the one that it asks for, else
    /// 16.
    pub fn batch(&self) -> usize {
        let asked = self.processes.description.batch;
        self.processes.workers.settings.batch.or(asked).unwrap_or(DEFAULT_BATCH)
    }

    /// Returns its processes.
    pub fn processes(&self) -> &Processes {
        &self.processes
    }

    /// Rolls out a batch together and singly and compares the positions: a network on a graphics processor
    /// may give other last bits in another batch. Scenarios that fail are left out.
    pub fn compare_batches(&self, batch: &[Request<'_>], settings: &Settings) -> BatchDifference {
        let controller = Controller::Fair(Box::new(self.clone()));
        let parts = batch.chunk_by(|a, b| a.scenario.length() == b.scenario.length());
        let together = parts.flat_map(|part| roll_out(part.to_vec(), &controller, settings));
        let mut difference = BatchDifference::default();
        for (request, together) in batch.iter().zip(together) {
            let alone = roll_out(vec![request.clone()], &controller, settings).pop();
            let (Ok(together), Some(Ok(alone))) = (together, alone) else { continue };
            difference.scenarios += 1;
            let states = together.tracks.iter().flatten().zip(alone.tracks.iter().flatten());
            for (a, b) in states.filter_map(|(a, b)| a.zip(*b)) {
                difference.largest = difference.largest.max((a.position() - b.position()).norm());
            }
        }
        difference
    }
}

/// Difference between rollouts of a batch and of its scenarios singly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BatchDifference {
    /// Number of scenarios that were compared.
    pub scenarios: usize,
    /// Largest distance between positions of an agent at the same step, metres.
    pub largest: f64,
}

impl ExternalSimulator {
    /// Begins episodes. `waits`: whether to wait for the first process.
    fn begin(&self, batch: &mut [Beginning<'_>], waits: bool) -> Result<(), PlanError> {
        if batch.is_empty() {
            return Ok(());
        }
        let seeds: Vec<u64> = batch.iter_mut().map(|episode| episode.stream.next_u64()).collect();
        // Arrays of a message have one length.
        let mut lengths: Vec<Length> = Vec::new();
        for length in batch.iter().map(|episode| length::of(episode)) {
            length::check(&self.processes.description, length).map_err(PlanError::Failed)?;
            if !lengths.contains(&length) {
                lengths.push(length);
            }
        }
        for (opened, length) in lengths.into_iter().enumerate() {
            let members: Vec<usize> = (0..batch.len()).filter(|&i| length::of(&batch[i]) == length).collect();
            let (own, seeds): (Vec<_>, Vec<_>) = members.iter().map(|&i| (&batch[i], seeds[i])).unzip();
            let open = OpenBatch::begin(&self.processes.workers, &own, &seeds, waits && opened == 0)?;
            let open = Arc::new(Mutex::new(open));
            for (index, member) in members.into_iter().enumerate() {
                batch[member].memory = Memory::new(EpisodeMemory { batch: Arc::clone(&open), index });
            }
        }
        Ok(())
    }

    /// Takes episodes out of their batches, which end with their last episode. Returns whether all did.
    fn end(memories: impl IntoIterator<Item = Memory>) -> bool {
        let mut batches = Vec::new();
        for mut memory in memories {
            let Some(EpisodeMemory { batch, .. }) = memory.take() else { continue };
            batches.push(Arc::downgrade(&batch));
            if let Some(open) = Arc::into_inner(batch) {
                open.into_inner().end();
            }
        }
        batches.iter().all(|batch| batch.strong_count() == 0)
    }
}

impl Simulator for ExternalSimulator {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        self.begin(batch, true)
    }

    fn wants_identity(&self) -> bool {
        self.processes.reveals_ids()
    }

    fn history(&self) -> Option<usize> {
        None
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        // Episodes that began together are planned together.
        let mut all: Vec<Together<'_, '_>> = Vec::new();
        for episode in batch {
            let Some(EpisodeMemory { batch: own, index }) = episode.memory.get() else {
                episode.error = Some(PlanError::ForeignMemory("external"));
                continue;
            };
            let (own, index) = (Arc::clone(own), *index);
            match all.iter_mut().find(|together| Arc::ptr_eq(&together.batch, &own)) {
                Some(together) => together.episodes.push((index, episode)),
                None => all.push(Together { batch: own, episodes: vec![(index, episode)] }),
            }
        }
        all.iter_mut().try_for_each(|together| together.batch.lock().plan(&mut together.episodes))
    }

    /// The process of a batch of which only some episodes continue is not free.
    fn continue_batch(&self, batch: &mut [Continuation<'_>]) -> Result<(), PlanError> {
        let have_ended = Self::end(Continuation::take_memories(batch));
        Continuation::begin_anew(batch, |begun| self.begin(begun, have_ended))
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        Self::end(memories);
    }
}
