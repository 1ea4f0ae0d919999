//! Histories of agents as input features.

use reactsim_nn::perception::{SceneView, velocity_at};
use reactsim_scene::{Agent, AgentKind, AgentState, DT, Frame, HISTORY};

use super::frame::{LocalFrame, PolylineFeatures};
use crate::regression::network::{Attributes, Config};

/// Returns the number of features of an agent at a frame.
pub(crate) const fn agent_numbers(attributes: Attributes) -> usize {
    match attributes {
        // Position and size in space, class, target flag, AV flag, frame, time, heading, velocity,
        // acceleration, presence.
        Attributes::Published => 3 + 3 + 5 + (HISTORY + 1) + 2 + 2 + 2 + 1,
        Attributes::Own => 2 + 2 + 5 + (HISTORY + 1) + 2 + 2 + 2 + 1,
    }
}

/// Returns the typical height of a kind of agent, metres; heights are not recorded.
const fn height(kind: AgentKind) -> f64 {
    match kind {
        AgentKind::Vehicle => 1.6,
        _ => 1.75,
    }
}

/// Returns the histories of the agents of these slots, the predicted one first, in its frame.
pub(super) fn histories(
    view: &SceneView<'_>,
    slots: &[usize],
    frame: &LocalFrame,
    config: &Config,
) -> PolylineFeatures {
    let (rows, numbers) = (config.agents, agent_numbers(config.attributes));
    let mut features = PolylineFeatures::absent(HISTORY, rows, numbers);
    for (row, &slot) in slots.iter().enumerate() {
        let history = AgentHistory {
            agent: &view.agents[slot],
            track: &view.tracks[slot],
            now: view.now,
            is_target: row == 0,
            is_av: slot == 0,
        };
        for k in 0..HISTORY {
            let at = k * rows + row;
            let out = &mut features.points[at * numbers..(at + 1) * numbers];
            if history.write(k, frame, config.attributes, out) {
                features.there[at] = 1.0;
            }
        }
    }
    features
}

/// History of an agent.
#[derive(Clone, Copy, Debug)]
struct AgentHistory<'a> {
    agent: &'a Agent,
    track: &'a [Frame],
    now: usize,
    is_target: bool,
    is_av: bool,
}

impl AgentHistory<'_> {
    /// Writes the features of the `k`-th of the eleven frames up to now. Returns false if the agent was
    /// absent.
    fn write(&self, k: usize, frame: &LocalFrame, attributes: Attributes, out: &mut [f32]) -> bool {
        let Some(at) = (self.now + k).checked_sub(HISTORY - 1) else { return false };
        let Some(state) = self.track.get(at).copied().flatten() else { return false };
        let velocity = velocity_at(self.track, at);
        let change = |f: usize| {
            let known = f > 0 && self.track[f].is_some() && self.track[f - 1].is_some();
            known.then(|| (velocity_at(self.track, f) - velocity_at(self.track, f - 1)) / DT)
        };
        // The first frame gets the acceleration of the second.
        let acceleration = change(if k == 0 { at + 1 } else { at }).unwrap_or_default();
        let mut values = [0.0; 30];
        let mut n = 0;
        let mut put = |v: f64| {
            values[n] = v;
            n += 1;
        };
        let own = attributes == Attributes::Own;
        self.place_and_size(state, frame, own, &mut put);
        for kind in [AgentKind::Vehicle, AgentKind::Pedestrian, AgentKind::Cyclist] {
            // The public code misspells one class, so that its networks never see that flag on
            // pedestrians.
            let marked = own || kind != AgentKind::Pedestrian;
            put(f64::from(self.agent.kind == kind && marked));
        }
        put(f64::from(self.is_target));
        put(f64::from(self.is_av));
        (0..HISTORY).for_each(|i| put(f64::from(i == k)));
        put(k as f64 * DT);
        let toward = frame.toward(state.heading);
        put(toward.y);
        put(toward.x);
        let (v, a) = (frame.vector(velocity), frame.vector(acceleration));
        let (per_v, per_a) = if own { (10.0, 5.0) } else { (1.0, 1.0) };
        [v.x / per_v, v.y / per_v, a.x / per_a, a.y / per_a].into_iter().for_each(&mut put);
        put(1.0);
        for (slot, value) in out.iter_mut().zip(values) {
            *slot = value as f32;
        }
        true
    }

    fn place_and_size(&self, state: AgentState, frame: &LocalFrame, own: bool, put: &mut impl FnMut(f64)) {
        let at = frame.point(state.position());
        if own {
            [at.x / 20.0, at.y / 20.0, self.agent.length / 5.0, self.agent.width / 2.0]
                .into_iter()
                .for_each(put);
        } else {
            [at.x, at.y, 0.0, self.agent.length, self.agent.width, height(self.agent.kind)]
                .into_iter()
                .for_each(put);
        }
    }
}
