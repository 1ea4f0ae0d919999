//! Replay of the log by tokens: what a vocabulary can express, and what it does to the motion. An oracle,
//! because it sees the future.

use reactsim_baseline::{ModelError, Setup};
use reactsim_rollout::{Controller, Episode, Memory, Oracle, PlanError};
use reactsim_scene::{CURRENT, Frame, Scenario};
use serde::{Deserialize, Serialize};

use super::drive::drive;
use super::execute::Executor;
use super::tokens::{TOKEN_FRAMES, Vocabulary};

/// Id of the simulator.
pub(super) const ID: &str = "token-replay";

/// Simulator in which every agent follows its log by the nearest tokens of a vocabulary.
///
/// Tokens start at the current frame, each where the previous one ended. An agent is present from its first
/// whole step of half a second to its last one. Agents without a class replay their log.
#[derive(Clone, Debug)]
pub struct TokenReplay {
    vocabulary: Vocabulary,
    parameters: TokenReplayParameters,
}

/// Parameters on the card.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TokenReplayParameters {
    /// Whether vehicles drive tokens within the limits of the metrics.
    pub projection: bool,
}

pub(super) fn make(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    let vocabulary = Vocabulary::read(&setup.weights()?.bytes).map_err(|e| setup.refuse_weights(e))?;
    Ok(Controller::Oracle(Box::new(TokenReplay::new(vocabulary, parameters))))
}

impl TokenReplay {
    /// Builds the simulator of a vocabulary.
    pub fn new(vocabulary: Vocabulary, parameters: TokenReplayParameters) -> Self {
        Self { vocabulary, parameters }
    }

    /// Returns the track of an agent after the current frame.
    fn future(&self, scenario: &Scenario, agent: usize, executor: &mut Executor) -> Vec<Frame> {
        let logged = scenario.logged(agent);
        let driven = drive(&scenario.start.agents[agent], &logged, CURRENT, &self.vocabulary, executor, None);
        let mut future = driven.track[CURRENT + 1..].to_vec();
        let is_replayed = driven.labels.iter().any(Option::is_some);
        for (step, label) in driven.labels.iter().enumerate() {
            if is_replayed && label.is_none() {
                future[step * TOKEN_FRAMES..][..TOKEN_FRAMES].fill(None);
            }
        }
        future
    }
}

impl Oracle for TokenReplay {
    fn begin(&self, scenario: &Scenario) -> Memory {
        let mut executor = Executor::new(self.parameters.projection);
        let tracks: Vec<Vec<Frame>> = (0..scenario.start.agents.len())
            .map(|agent| self.future(scenario, agent, &mut executor))
            .collect();
        Memory::new(tracks)
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        for episode in batch {
            let Some(tracks) = episode.memory.get::<Vec<Vec<Frame>>>() else {
                episode.error = Some(PlanError::ForeignMemory(ID));
                continue;
            };
            let now = episode.seen.step();
            for (agent, track) in tracks.iter().enumerate() {
                for k in 0..episode.plan.steps() {
                    episode.plan.set(agent, k, track[now + k]);
                }
            }
        }
        Ok(())
    }
}
