//! Properties of a scenario that readers of its results must be told.

use std::collections::BTreeMap;

use reactsim_geometry::rounded_distance;

use super::{AgentKind, Scenario};

/// Counts by description, e.g. `agents whose velocity is unknown`.
pub type Notes = BTreeMap<&'static str, u32>;

/// Counts one property of a scenario; the property is noted unless the count is 0.
type Note = (&'static str, fn(&Scenario) -> u32);

/// All properties that are noted.
const NOTES: [Note; 1] = [(
    "agents overlap another one at the current frame (towed, or boxes that are too large): \
     the metric option exclude_initial_overlap leaves such pairs out",
    overlapping_agents,
)];

/// Corner rounding of boxes, the default of the collision metrics.
const CORNER_ROUNDING: f64 = 0.7;

/// Returns the number of agents, including the AV, in pairs with a vehicle that overlap at the current frame.
fn overlapping_agents(scenario: &Scenario) -> u32 {
    let agents = &scenario.start.agents;
    let boxes: Vec<_> = (0..agents.len()).map(|i| scenario.start.now(i).footprint(&agents[i])).collect();
    let sized = |i: usize| agents[i].length > 0.0 && agents[i].width > 0.0;
    let overlap = |i: usize, j: usize| {
        let kinds = [agents[i].kind, agents[j].kind];
        kinds.contains(&AgentKind::Vehicle)
            && !kinds.contains(&AgentKind::Other)
            && sized(i)
            && sized(j)
            && (boxes[i].center - boxes[j].center).norm() <= boxes[i].radius() + boxes[j].radius()
            && rounded_distance(&boxes[i], &boxes[j], CORNER_ROUNDING) < 0.0
    };
    let in_pair = |i: usize| (0..agents.len()).any(|j| i != j && overlap(i, j));
    (0..agents.len()).filter(|&i| in_pair(i)).count() as u32
}

impl Scenario {
    /// Returns what readers of results of this scenario must be told, with counts. Most scenarios have no
    /// notes. They are computed at the first call.
    pub fn notes(&self) -> &Notes {
        self.notes.get_or_init(|| {
            let counts = NOTES.iter().map(|(what, count)| (*what, count(self)));
            counts.filter(|(_, n)| *n > 0).collect()
        })
    }
}
