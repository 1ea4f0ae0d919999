//! The network as a simulator.

use burn::tensor::Tensor;
use reactsim::rollout::{PlanError, Planning, SingleEpisode, Stream};
use reactsim::scene::{Frame, Start};
use serde::{Deserialize, Deserializer, Serialize};

use super::super::execute::Executor;
use super::super::sampling::Sampling;
use super::super::tokens::TOKEN_FRAMES;
use super::observed::{Participant, identities, map_tokens, step_at};
use super::{EncodedMap, Episode, InputError, SmartPolicy};

/// What the cards set.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SmartParameters {
    /// Whether vehicles drive tokens within the limits of the benchmark, or jump as tokens do.
    pub projection: bool,
    /// How far from the AV, at the current frame, the map is known, metres.
    #[serde(deserialize_with = "metres")]
    pub map_radius: f64,
    /// Height of all agents, metres; scenarios have none.
    #[serde(deserialize_with = "metres")]
    pub height: f64,
    /// How tokens are drawn.
    pub sampling: Sampling,
}

fn metres<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    let value = f64::deserialize(from)?;
    if value > 0.0 && value < 1e5 {
        return Ok(value);
    }
    Err(serde::de::Error::custom(format!("{value} is no length; expected metres, above 0 and below 100000")))
}

/// Agents that move by tokens that the published network thinks probable.
///
/// Every 0.5 s, what agents and the AV truly did is matched to tokens anew, and a step of the network goes on from what it kept of the
/// earlier ones. Plans that do not come every 0.5 s have steps of their own: there is one row of steps, 0.5 s apart, for each of the five
/// frames at which it can begin, so that every plan sees steps that end now, and no step is computed twice.
#[derive(Debug)]
pub struct SmartSimulator {
    id: &'static str,
    policy: SmartPolicy,
    parameters: SmartParameters,
}

/// What is kept of an episode.
#[derive(Debug)]
pub struct Mind {
    participants: Vec<Participant>,
    /// The episode before its first step.
    fresh: Episode,
    /// The rows of steps, by the frame of their last step modulo 5.
    rows: [Option<Row>; TOKEN_FRAMES],
}

/// Steps 0.5 s apart.
#[derive(Clone, Debug)]
struct Row {
    /// Frame of the last step.
    frame: usize,
    episode: Episode,
}

impl SmartSimulator {
    /// A simulator of this policy, under the id of its baseline.
    pub fn new(id: &'static str, policy: SmartPolicy, parameters: SmartParameters) -> Self {
        Self { id, policy, parameters }
    }

    fn begin(&self, start: &Start) -> Result<Mind, InputError> {
        let SmartPolicy { network, tables, vocabulary, map_vocabulary } = &self.policy;
        let participants = Participant::all(start, vocabulary);
        let map = map_tokens(start, map_vocabulary, self.parameters.map_radius);
        let map: EncodedMap = network.encode_map(tables, &map)?;
        let agents = identities(start, &participants, self.parameters.height);
        let fresh = network.begin(tables, map, agents)?;
        Ok(Mind { participants, fresh, rows: [const { None }; TOKEN_FRAMES] })
    }

    /// Adds the step at a frame; its scores.
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

    /// Brings the row of steps that ends now up to date; its scores, and the row.
    fn look(
        &self,
        mind: &mut Mind,
        tracks: &[Vec<Frame>],
        now: usize,
    ) -> Result<(Tensor<2>, Episode), InputError> {
        let place = &mut mind.rows[now % TOKEN_FRAMES];
        let (first, mut episode) = match place.take() {
            Some(row) if row.frame < now => (row.frame + TOKEN_FRAMES, row.episode),
            _ => (TOKEN_FRAMES + now % TOKEN_FRAMES, mind.fresh.clone()),
        };
        for frame in (first..now).step_by(TOKEN_FRAMES) {
            let step = step_at(&mind.participants, tracks, frame, &self.policy.vocabulary);
            self.policy.network.advance(&self.policy.tables, &mut episode, step)?;
        }
        let scores = self.step(&mind.participants, tracks, now, &mut episode)?;
        *place = Some(Row { frame: now, episode: episode.clone() });
        Ok((scores, episode))
    }

    /// Draws a token for everybody and moves them so.
    fn act(
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
        for (i, (who, track)) in participants.iter().zip(tracks).enumerate() {
            let (agent, vocabulary) = (&agents[who.slot], &self.policy.vocabulary);
            // Classes may have fewer tokens than there are columns.
            let own = &scores[i * width..][..vocabulary.tokens(who.class)];
            let Some(token) = self.parameters.sampling.draw(own, episode.stream) else {
                let (id, frame) = (&agent.id, episode.seen.frame());
                return Err(PlanError::Failed(format!(
                    "the network's scores for agent `{id}` after frame {frame} are no numbers"
                )));
            };
            let end = track.len() + TOKEN_FRAMES;
            executor.execute(agent, who.class, vocabulary.poses(who.class, token), track);
            // Who is absent stays so.
            track.resize(end, None);
        }
        Ok(())
    }
}

impl SingleEpisode for SmartSimulator {
    type Memory = Result<Mind, InputError>;

    fn id(&self) -> &'static str {
        self.id
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> Self::Memory {
        self.begin(start)
    }

    fn plan_one(&self, memory: &mut Self::Memory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let failed = |e: InputError| PlanError::Failed(format!("the network can not read the scene: {e}"));
        let mind = memory.as_mut().map_err(|e| failed(e.clone()))?;
        let (now, steps) = (episode.seen.frame(), episode.plan.steps());
        let mut tracks: Vec<Vec<Frame>> = mind.participants.iter().map(|p| p.track(&episode.seen)).collect();
        let (mut scores, mut row) = self.look(mind, &tracks, now).map_err(failed)?;
        let mut executor = Executor::new(self.parameters.projection);
        for token in 0..steps.div_ceil(TOKEN_FRAMES) {
            if token > 0 {
                // Steps that are only planned are not kept. The AV goes on by its own tokens.
                let frame = now + token * TOKEN_FRAMES;
                scores = self.step(&mind.participants, &tracks, frame, &mut row).map_err(failed)?;
            }
            self.act(&mind.participants, &mut tracks, scores.clone(), &mut executor, episode)?;
        }
        for (who, track) in mind.participants.iter().zip(&tracks) {
            for k in 0..steps {
                episode.plan.set(who.slot, k, track.get(now + 1 + k).copied().flatten());
            }
        }
        Ok(())
    }
}
