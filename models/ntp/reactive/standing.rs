//! Agents that stand, and on which the network spends no work: throughout the outlook of a plan, and in the
//! next plan. These are most of a scene.

use burn::tensor::Tensor;
use reactsim_nn::indices;
use reactsim_nn::perception::Body;
use reactsim_scene::{AgentState, Frame};

use super::super::tokens::TOKEN_FRAMES;

/// Distance in metres: an agent that moved less in the last executed half second stood.
const MAX_DISPLACEMENT: f64 = 0.05;
/// Largest probability of a token that sets off with which an agent is taken to stand.
const MAX_DEPARTURE: f64 = 0.01;

/// Agents that stand, and how others perceive them.
#[derive(Clone, Debug, Default)]
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
        let index: Vec<usize> = rows.iter().map(|row| first + row).collect();
        Self {
            bodies: rows.iter().map(|&row| (slots[row], bodies[row])).collect(),
            features: meeting.iter().map(|features| select(features, &index)).collect(),
        }
    }

    /// Keeps the agents that stood in the last half second of their tracks.
    pub(crate) fn retain_standing(&mut self, tracks: &[Vec<Frame>]) {
        let kept: Vec<usize> = (0..self.bodies.len()).filter(|&i| stood(&tracks[self.bodies[i].0])).collect();
        if kept.is_empty() {
            *self = Self::default();
        } else if kept.len() < self.bodies.len() {
            self.bodies = kept.iter().map(|&i| self.bodies[i]).collect();
            self.features.iter_mut().for_each(|features| *features = select(features, &kept));
        }
    }

    /// Adds further agents.
    pub(crate) fn extend(&mut self, other: &Self) {
        if self.bodies.is_empty() {
            self.clone_from(other);
        } else if !other.bodies.is_empty() {
            self.bodies.extend_from_slice(&other.bodies);
            for (own, more) in self.features.iter_mut().zip(&other.features) {
                *own = Tensor::cat(vec![own.clone(), more.clone()], 0);
            }
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

fn select(features: &Tensor<2>, rows: &[usize]) -> Tensor<2> {
    features.clone().select(0, indices(rows.iter().copied(), &features.device()))
}

/// Returns whether an agent stood in the last half second of its track.
fn stood(track: &[Frame]) -> bool {
    let back = track.len().checked_sub(TOKEN_FRAMES + 1).and_then(|frame| track[frame]);
    let (Some(from), Some(Some(to))) = (back, track.last()) else { return false };
    (to.position() - from.position()).norm() < MAX_DISPLACEMENT
}

/// Returns whether an agent stood in the last half second of its track, and does not set off with a probability
/// that counts. `departure` is evaluated only for agents that stood.
pub(crate) fn stands(track: &[Frame], departure: impl FnOnce() -> f64) -> bool {
    stood(track) && departure() < MAX_DEPARTURE
}

/// Returns whether a token, of this displacement in metres, sets off.
pub(crate) fn sets_off(displacement: f64) -> bool {
    displacement >= MAX_DISPLACEMENT
}
