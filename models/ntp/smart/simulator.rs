//! The network as a simulator.

use burn::tensor::Tensor;
use reactsim::rollout::{PlanError, Planning, SingleEpisode, Stream};
use reactsim::scene::{Frame, Start};
use serde::{Deserialize, Serialize};

use super::super::execute::Executor;
use super::super::sampling::Sampling;
use super::super::tokens::TOKEN_FRAMES;
use super::observed::{Participant, identities, map_tokens, step_at};
use super::{EncodedMap, Episode, InputError, SmartPolicy};

/// Parameters on the cards.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmartParameters {
    /// Whether vehicles drive tokens within the limits of the benchmark; otherwise tokens are executed
    /// exactly.
    pub projection: bool,
    /// Radius of the known map around the AV's position at the current frame, metres.
    pub map_radius: f64,
    /// Height of all agents, metres; scenarios do not record it.
    pub height: f64,
    /// Settings for drawing tokens.
    pub sampling: Sampling,
}

/// Simulator that moves agents by tokens drawn from the published network.
///
/// Every 0.5 s, the realized motion of agents and the AV is matched to tokens again, and the network
/// computes one more step on top of the cached earlier ones. If plans are not 0.5 s apart, there is one
/// chain of steps, 0.5 s apart, for each of the five frames at which it can begin: every plan sees steps
/// that end at the current frame, and no step is computed twice.
#[derive(Debug)]
pub struct SmartSimulator {
    id: &'static str,
    policy: SmartPolicy,
    parameters: SmartParameters,
}

/// Memory of an episode between plans.
#[derive(Debug)]
pub struct EpisodeMemory {
    participants: Vec<Participant>,
    /// The episode before its first step.
    fresh: Episode,
    /// Chains of steps, by the frame of their last step modulo 5.
    chains: [Option<StepChain>; TOKEN_FRAMES],
}

/// A chain of steps 0.5 s apart.
#[derive(Clone, Debug)]
struct StepChain {
    /// Frame of the last step.
    frame: usize,
    episode: Episode,
}

impl SmartSimulator {
    /// Builds a simulator of this policy, under the id of its baseline.
    pub fn new(id: &'static str, policy: SmartPolicy, parameters: SmartParameters) -> Self {
        Self { id, policy, parameters }
    }

    fn begin(&self, start: &Start) -> Result<EpisodeMemory, InputError> {
        let SmartPolicy { network, tables, vocabulary, map_vocabulary } = &self.policy;
        let participants = Participant::all(start, vocabulary);
        let map = map_tokens(start, map_vocabulary, self.parameters.map_radius);
        let map: EncodedMap = network.encode_map(tables, &map)?;
        let agents = identities(start, &participants, self.parameters.height);
        let fresh = network.begin(tables, map, agents)?;
        Ok(EpisodeMemory { participants, fresh, chains: [const { None }; TOKEN_FRAMES] })
    }

    /// Adds the step at a frame and returns its scores.
    fn step(
        &self,
        participants: &[Participant],
        tracks: &[Vec<Frame>],
        frame: usize,
        episode: &mut Episode,
    ) -> Result<Tensor<2>, InputError> {
        let step = step_at(participants, tracks, frame, &self.policy.vocabulary);
        self.policy.network.step(&self.policy.tables, episode, step)
    }

    /// Brings the chain of steps that ends at `now` up to date. Returns the scores of the newest step,
    /// and the episode.
    fn advance_chain(
        &self,
        memory: &mut EpisodeMemory,
        tracks: &[Vec<Frame>],
        now: usize,
    ) -> Result<(Tensor<2>, Episode), InputError> {
        let slot = &mut memory.chains[now % TOKEN_FRAMES];
        let (first, mut episode) = match slot.take() {
            Some(chain) if chain.frame < now => (chain.frame + TOKEN_FRAMES, chain.episode),
            _ => (TOKEN_FRAMES + now % TOKEN_FRAMES, memory.fresh.clone()),
        };
        for frame in (first..now).step_by(TOKEN_FRAMES) {
            let step = step_at(&memory.participants, tracks, frame, &self.policy.vocabulary);
            self.policy.network.advance(&self.policy.tables, &mut episode, step)?;
        }
        let scores = self.step(&memory.participants, tracks, now, &mut episode)?;
        *slot = Some(StepChain { frame: now, episode: episode.clone() });
        Ok((scores, episode))
    }

    /// Draws a token for every participant and executes it.
    fn move_participants(
        &self,
        participants: &[Participant],
        tracks: &mut [Vec<Frame>],
        scores: Tensor<2>,
        executor: &mut Executor,
        episode: &mut Planning<'_, '_>,
    ) -> Result<(), PlanError> {
        let width = scores.dims()[1];
        let scores: Vec<f32> = scores.into_data().iter::<f32>().collect();
        let agents = &episode.seen.start().agents;
        for (i, (participant, track)) in participants.iter().zip(tracks).enumerate() {
            let (agent, vocabulary) = (&agents[participant.slot], &self.policy.vocabulary);
            // Classes may have fewer tokens than there are columns.
            let own = &scores[i * width..][..vocabulary.tokens(participant.class)];
            let Some(token) = self.parameters.sampling.draw(own, episode.stream) else {
                let (id, frame) = (&agent.id, episode.seen.frame());
                return Err(PlanError::Failed(format!(
                    "the network's scores for agent `{id}` after frame {frame} are not numbers"
                )));
            };
            let end = track.len() + TOKEN_FRAMES;
            executor.execute(agent, participant.class, vocabulary.poses(participant.class, token), track);
            // Absent agents stay absent.
            track.resize(end, None);
        }
        Ok(())
    }
}

impl SingleEpisode for SmartSimulator {
    type Memory = Result<EpisodeMemory, InputError>;

    fn id(&self) -> &'static str {
        self.id
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> Self::Memory {
        self.begin(start)
    }

    fn plan_one(&self, memory: &mut Self::Memory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let failed = |e: InputError| PlanError::Failed(format!("the network cannot read the scene: {e}"));
        let memory = memory.as_mut().map_err(|e| failed(e.clone()))?;
        let (now, steps) = (episode.seen.frame(), episode.plan.steps());
        let mut tracks: Vec<Vec<Frame>> =
            memory.participants.iter().map(|p| p.track(&episode.seen)).collect();
        let (mut scores, mut planned) = self.advance_chain(memory, &tracks, now).map_err(failed)?;
        let mut executor = Executor::new(self.parameters.projection);
        for token in 0..steps.div_ceil(TOKEN_FRAMES) {
            if token > 0 {
                // Planned steps are not kept. In planned steps the AV moves by its own tokens.
                let frame = now + token * TOKEN_FRAMES;
                scores = self.step(&memory.participants, &tracks, frame, &mut planned).map_err(failed)?;
            }
            self.move_participants(
                &memory.participants,
                &mut tracks,
                scores.clone(),
                &mut executor,
                episode,
            )?;
        }
        for (participant, track) in memory.participants.iter().zip(&tracks) {
            for k in 0..steps {
                episode.plan.set(participant.slot, k, track.get(now + 1 + k).copied().flatten());
            }
        }
        Ok(())
    }
}
