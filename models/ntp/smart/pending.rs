//! An episode whose plan is being made.

use reactsim_rollout::{Episode, JointPlan, Observation, PlanError, Stream};
use reactsim_scene::Frame;

use super::super::execute::Executor;
use super::super::sampling::Sampling;
use super::super::tokens::{TOKEN_FRAMES, TOKEN_STEPS};
use super::observed::{Participant, step_at};
use super::{CachedScene, InputError, SmartPolicy, Step};

/// Memory of an episode between plans.
#[derive(Clone, Debug)]
pub(super) struct EpisodeMemory {
    participants: Vec<Participant>,
    /// The scene before its first step.
    fresh: CachedScene,
    /// Chains of steps, by the frame of their last step modulo 5.
    chains: [Option<StepChain>; TOKEN_FRAMES],
}

/// Memory of an episode between plans, or why the network cannot read the scene.
pub(super) type BegunMemory = Result<EpisodeMemory, InputError>;

/// A chain of steps 0.5 s apart.
#[derive(Clone, Debug)]
struct StepChain {
    /// Frame of the last step.
    frame: usize,
    scene: CachedScene,
}

/// An episode whose plan is being made.
pub(super) struct PendingPlan<'e> {
    seen: Observation<'e>,
    stream: &'e mut Stream,
    plan: &'e mut JointPlan,
    error: &'e mut Option<PlanError>,
    memory: &'e mut EpisodeMemory,
    /// Frame of the episode with which the tracks begin.
    first: usize,
    /// The latest realized frames of every participant, then planned ones.
    tracks: Vec<Vec<Frame>>,
    /// The scene with the steps that the network has seen.
    pub(super) scene: CachedScene,
    /// Frame of the next step.
    next: usize,
}

impl EpisodeMemory {
    pub(super) fn new(participants: Vec<Participant>, fresh: CachedScene) -> Self {
        Self { participants, fresh, chains: [const { None }; TOKEN_FRAMES] }
    }
}

/// Returns the frame of the first step of a chain that leads to a frame: as early as there are steps, but no
/// more of them than a network was trained with.
fn first_step(now: usize) -> usize {
    (TOKEN_FRAMES + now % TOKEN_FRAMES).max(now.saturating_sub(TOKEN_FRAMES * (TOKEN_STEPS - 1)))
}

/// Returns the failure of an episode that the network cannot read.
fn unreadable(error: &InputError) -> PlanError {
    PlanError::Failed(format!("the network cannot read the scene: {error}"))
}

impl<'e> PendingPlan<'e> {
    /// Begins a plan; `None`, with the error in the episode, if its memory is none of the simulator `id`.
    pub(super) fn of(id: &'static str, episode: &'e mut Episode<'_>) -> Option<Self> {
        let Episode { seen, memory, stream, plan, error, .. } = episode;
        let memory = match memory.get::<BegunMemory>() {
            Some(Ok(memory)) => memory,
            Some(Err(cause)) => {
                *error = Some(unreadable(cause));
                return None;
            }
            None => {
                *error = Some(PlanError::ForeignMemory(id));
                return None;
            }
        };
        let now = seen.frame();
        let (next, scene) = match memory.chains[now % TOKEN_FRAMES].take() {
            Some(chain) if chain.frame < now => (chain.frame + TOKEN_FRAMES, chain.scene),
            _ => (first_step(now), memory.fresh.clone()),
        };
        let first = next - TOKEN_FRAMES;
        let tracks = memory.participants.iter().map(|p| p.track(seen, first)).collect();
        Some(Self { seen: *seen, stream, plan, error, memory, first, tracks, scene, next })
    }

    /// Returns whether the network has to see a step before the present one.
    pub(super) fn is_behind(&self) -> bool {
        self.error.is_none() && self.next < self.seen.frame()
    }

    /// Returns whether the plan includes the `token`-th half second.
    pub(super) fn has(&self, token: usize) -> bool {
        self.error.is_none() && token * TOKEN_FRAMES < self.plan.steps()
    }

    /// Returns the number of agents that the network knows.
    pub(super) fn agents(&self) -> usize {
        self.memory.participants.len()
    }

    /// Returns the next step; `None`, with the error in the episode, if the network cannot read it.
    pub(super) fn next_step(&mut self, policy: &SmartPolicy) -> Option<Step> {
        let step =
            step_at(&self.memory.participants, &self.tracks, self.first, self.next, &policy.vocabulary);
        match self.scene.check(policy.network.config(), &step) {
            Ok(()) => {
                self.next += TOKEN_FRAMES;
                Some(step)
            }
            Err(cause) => {
                *self.error = Some(unreadable(&cause));
                None
            }
        }
    }

    /// Keeps the steps up to the present one for the next plan. Planned ones are not kept.
    pub(super) fn remember(&mut self) {
        let frame = self.seen.frame();
        let chain = StepChain { frame, scene: self.scene.clone() };
        self.memory.chains[frame % TOKEN_FRAMES] = Some(chain);
    }

    /// Draws a token for every participant from its scores, `[participants, width]`, and executes it.
    pub(super) fn move_participants(
        &mut self,
        scores: &[f32],
        width: usize,
        policy: &SmartPolicy,
        sampling: &Sampling,
        executor: &mut Executor,
    ) {
        let agents = &self.seen.start().agents;
        for (i, (participant, track)) in self.memory.participants.iter().zip(&mut self.tracks).enumerate() {
            let (agent, vocabulary) = (&agents[participant.slot], &policy.vocabulary);
            // Classes may have fewer tokens than there are columns.
            let own = &scores[i * width..][..vocabulary.tokens(participant.class)];
            let Some(token) = sampling.draw(own, self.stream) else {
                let (id, frame) = (&agent.id, self.seen.frame());
                *self.error = Some(PlanError::Failed(format!(
                    "the network's scores for agent `{id}` after frame {frame} are not numbers"
                )));
                return;
            };
            let end = track.len() + TOKEN_FRAMES;
            executor.execute(agent, participant.class, vocabulary.poses(participant.class, token), track);
            // Absent agents stay absent.
            track.resize(end, None);
        }
    }

    /// Fills in the plan, unless planning failed.
    pub(super) fn finish(self) {
        if self.error.is_some() {
            return;
        }
        let planned = self.seen.frame() + 1 - self.first;
        for (participant, track) in self.memory.participants.iter().zip(&self.tracks) {
            for k in 0..self.plan.steps() {
                self.plan.set(participant.slot, k, track.get(planned + k).copied().flatten());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_have_at_most_the_steps_of_a_training() {
        // Of the 18 steps of 91 frames, the first ends at frame 5.
        assert_eq!([10, 13, 89, 90].map(first_step), [5, 8, 9, 5]);
        for now in [91, 500, 6010] {
            let first = first_step(now);
            assert_eq!((now - first) / TOKEN_FRAMES + 1, TOKEN_STEPS, "{now}");
            assert!((now - first).is_multiple_of(TOKEN_FRAMES));
        }
    }
}
