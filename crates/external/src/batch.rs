//! A batch of episodes in one process, from `begin` to `end`.

use std::sync::Arc;

use reactsim_rollout::{Beginning, Episode, Identity, PlanError};
use reactsim_scene::Length;

use super::connection::RequestError;
use super::document::{Frame, FrameWriter, Values};
use super::workers::{Worker, Workers};
use super::{length, realised, replies, scenes};

/// A batch that is open in a process. Its worker goes back when it is ended, or dropped.
pub(super) struct OpenBatch {
    workers: Arc<Workers>,
    /// `None` after the connection broke.
    worker: Option<Worker>,
    /// Handles of the episodes.
    episodes: Vec<u64>,
    /// Seeds of the episodes.
    seeds: Vec<u64>,
    /// Largest number of agents.
    agents: usize,
    /// Number of lights of each episode.
    lights: Vec<usize>,
    /// Number of frames that the simulator has received.
    frames: usize,
    /// Whether the process has confirmed the end of the batch, or is the parent and has answered.
    has_ended: bool,
}

impl OpenBatch {
    /// Begins a batch of episodes of one length. `seeds` are the seeds of the episodes; `waits`: whether to
    /// wait for a process that is not free.
    ///
    /// # Errors
    /// [`PlanError::BrokenOff`] if the process fails, or none can be started.
    pub(super) fn begin(
        workers: &Arc<Workers>,
        batch: &[&Beginning<'_>],
        seeds: &[u64],
        waits: bool,
    ) -> Result<Self, PlanError> {
        let mut worker = workers.take(waits).map_err(|text| {
            // A process that cannot be started says nothing about the episodes.
            workers.failed(seeds, &text, false);
            PlanError::BrokenOff(text)
        })?;
        let episodes = worker.handles(batch.len());
        let starts: Vec<_> = batch.iter().map(|e| e.start).collect();
        let length = batch.first().map_or(Length::BENCHMARK, |episode| length::of(episode));
        let mut open = Self {
            workers: Arc::clone(workers),
            worker: Some(worker),
            agents: starts.iter().map(|s| s.agents.len()).max().unwrap_or(0),
            lights: starts.iter().map(|s| s.lights.len()).collect(),
            frames: length.history,
            has_ended: false,
            episodes,
            seeds: seeds.to_vec(),
        };
        let mut request = FrameWriter::new("begin");
        request
            .text("moves_av", if batch.iter().any(|e| e.moves_av) { "1" } else { "0" })
            .text("steps", batch.first().map_or(0, |e| e.steps).to_string())
            .tensor("episode", Values::u64(&[batch.len()], open.episodes.iter().copied()))
            .tensor("seed", Values::u64(&[batch.len()], seeds.iter().copied()));
        length::add(&mut request, length);
        scenes::add_scenes(&mut request, &starts);
        let identities: Option<Vec<Identity<'_>>> = batch.iter().map(|e| e.identity).collect();
        if let Some(identities) = identities {
            scenes::add_identities(&mut request, &identities, &starts);
        }
        match open.request(request, "begun", 0) {
            Ok(_) => Ok(open),
            Err(error) => {
                // Episodes may exist in the process although it answered `failed`.
                open.end();
                Err(PlanError::BrokenOff(error))
            }
        }
    }

    /// Plans the episodes, given by their index in the batch.
    pub(super) fn plan(&mut self, active: &mut [(usize, &mut Episode<'_>)]) -> Result<(), PlanError> {
        let (b, n) = (self.episodes.len(), self.agents);
        let (steps, frame) = active
            .first()
            .map_or((0, self.frames.saturating_sub(1)), |(_, e)| (e.plan.steps(), e.seen.frame()));
        let mut seen = vec![None; b];
        for (index, episode) in active.iter() {
            seen[*index] = Some(episode.seen);
        }
        let new = self.frames..frame + 1;
        let request = realised::request(&self.episodes, n, &self.lights, new, &seen, steps);
        self.frames = frame + 1;
        let planned = self.request(request, "planned", b * n * steps * 3 * size_of::<f64>());
        let planned = planned.map_err(PlanError::BrokenOff)?;
        if let Some(worker) = &mut self.worker {
            worker.has_planned = true;
        }
        replies::take_plans(&planned, (b, n), active).map_err(|e| {
            let text = format!("`planned` cannot be used: {e}");
            self.workers.failed(&self.seeds, &text, false);
            PlanError::BrokenOff(text)
        })
    }

    /// Ends the batch and gives the worker back.
    pub(super) fn end(mut self) {
        if self.worker.is_some() {
            let mut request = FrameWriter::new("end");
            request.tensor("episode", Values::u64(&[self.episodes.len()], self.episodes.iter().copied()));
            // A process that fails here is replaced; the plans of the batch are complete.
            let is_confirmed = self.request(request, "ended", 0).is_ok();
            if is_confirmed {
                self.workers.succeeded();
            }
            // The parent cannot be replaced, and its simulators have no open batch after any answer.
            self.has_ended = is_confirmed || self.workers.is_parent();
        }
    }

    fn request(&mut self, request: FrameWriter, wanted: &str, numbers: usize) -> Result<Frame, String> {
        let Some(worker) = &mut self.worker else { return Err("its process has ended".to_owned()) };
        let limits = self.workers.settings.limits;
        let limit = if worker.has_planned { limits.plan } else { limits.first };
        worker.connection.request(request, wanted, numbers, limit).map_err(|error| {
            let is_broken = matches!(error, RequestError::Broken(_));
            if is_broken {
                self.worker = None;
            }
            let text = error.text();
            self.workers.failed(&self.seeds, &text, is_broken);
            text
        })
    }
}

impl Drop for OpenBatch {
    fn drop(&mut self) {
        // Without a confirmed end, the state of the process is unknown, and another one takes its place.
        let worker = self.worker.take().filter(|_| self.has_ended);
        self.workers.put_back(worker);
    }
}
