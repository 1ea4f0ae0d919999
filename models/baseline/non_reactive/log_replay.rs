//! Log replay: every agent follows its log, whatever the AV does. An oracle, because it sees the
//! future.

use reactsim_rollout::{Controller, Episode, Memory, Oracle, PlanError};
use reactsim_scene::{Frame, Scenario};

use crate::{Baseline, ModelError, Setup};

/// Its entry in the list of baselines.
pub const ENTRY: Baseline = Baseline {
    oracle: true,
    takes_stage: false,
    ..Baseline::of_rules("log-replay", include_str!("log_replay/card.toml"), "", make)
};

fn make(_: Setup) -> Result<Controller, ModelError> {
    Ok(Controller::Oracle(Box::new(LogReplay)))
}

/// Simulator that replays the log; an agent is absent where its log is.
#[derive(Clone, Copy, Debug)]
pub struct LogReplay;

impl Oracle for LogReplay {
    fn begin(&self, scenario: &Scenario) -> Memory {
        Memory::new(scenario.log_future.tracks.clone())
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        for episode in batch {
            let Some(future) = episode.memory.get::<Vec<Vec<Frame>>>() else {
                episode.error = Some(PlanError::ForeignMemory(ENTRY.id));
                continue;
            };
            let now = episode.seen.step();
            for (agent, track) in future.iter().enumerate() {
                for k in 0..episode.plan.steps() {
                    episode.plan.set(agent, k, track.get(now + k).copied().flatten());
                }
            }
        }
        Ok(())
    }
}
