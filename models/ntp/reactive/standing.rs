//! Agents that stand throughout the outlook of a plan: most of a scene, on which the network spends no more work.

use burn::tensor::{Int, Tensor, TensorData};
use reactsim_perception::Body;
use reactsim_scene::{AgentState, Frame};

use super::super::tokens::TOKEN_FRAMES;

/// Distance in metres: an agent that moved less in the last executed half second stood.
const MAX_DISPLACEMENT: f64 = 0.05;
/// Largest probability of a token that sets off with which an agent is taken to stand.
const MAX_DEPARTURE: f64 = 0.01;

/// Agents that stand, and how others perceive them.
#[derive(Debug, Default)]
pub(crate) struct Standing {
    /// Slots and bodies at the last executed step.
    pub bodies: Vec<(usize, Body)>,
    /// For each block, the agents as others attend to them, `[agents, hidden]`.
    pub features: Vec<Tensor<2>>,
}

impl Standing {
    /// Takes agents to stand from here on: rows of the last executed step, whose nodes have these slots and
    /// bodies. `meeting` are the features of the nodes for each block, of which this step begins at row `first`.
    pub(crate) fn of(
        rows: &[usize],
        slots: &[usize],
        bodies: &[Body],
        meeting: &[Tensor<2>],
        first: usize,
    ) -> Self {
        let index: Vec<i32> = rows.iter().map(|row| (first + row) as i32).collect();
        let select = |features: &Tensor<2>| {
            let index = TensorData::new(index.clone(), [index.len()]);
            features.clone().select(0, Tensor::<1, Int>::from_data(index, &features.device()))
        };
        Self {
            bodies: rows.iter().map(|&row| (slots[row], bodies[row])).collect(),
            features: meeting.iter().map(select).collect(),
        }
    }

    /// Extends the tracks of the agents by half a second at standstill.
    pub(crate) fn stay(&self, tracks: &mut [Vec<Frame>]) {
        for (slot, _) in &self.bodies {
            let track = &mut tracks[*slot];
            let stays = track.last().copied().flatten().map(|state| AgentState { vx: 0.0, vy: 0.0, ..state });
            track.resize(track.len() + TOKEN_FRAMES, stays);
        }
    }
}

/// Returns whether an agent stood in the last half second of its track, and does not set off with a probability
/// that counts. `departure` is evaluated only for agents that stood.
pub(crate) fn stands(track: &[Frame], departure: impl FnOnce() -> f64) -> bool {
    let back = track.len().checked_sub(TOKEN_FRAMES + 1).and_then(|frame| track[frame]);
    let (Some(from), Some(Some(to))) = (back, track.last()) else { return false };
    (to.position() - from.position()).norm() < MAX_DISPLACEMENT && departure() < MAX_DEPARTURE
}

/// Returns whether a token, of this displacement in metres, sets off.
pub(crate) fn sets_off(displacement: f64) -> bool {
    displacement >= MAX_DISPLACEMENT
}
