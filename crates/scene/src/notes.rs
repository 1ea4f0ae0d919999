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

#[cfg(test)]
mod tests {
    use crate::{Agent, AgentKind, AgentState, FRAMES, LoggedAgent, Scenario, ScenarioParts};

    /// Returns the notes of a scenario with agents of 4 m, of these kinds and at these places on the x axis.
    fn notes(agents: &[(AgentKind, f64)]) -> Vec<(&'static str, u32)> {
        let agent = |(i, &(kind, x)): (usize, &(AgentKind, f64))| LoggedAgent {
            agent: Agent { id: i.to_string(), kind, length: 4.0, width: 2.0 },
            track: vec![Some(AgentState { x, y: 0.0, heading: 0.0, vx: 0.0, vy: 0.0 }); FRAMES],
        };
        let agents = agents.iter().enumerate().map(agent).collect();
        let parts = ScenarioParts { id: "notes".to_owned(), agents, ..ScenarioParts::default() };
        let scenario = Scenario::assemble(parts).unwrap();
        scenario.notes().iter().map(|(what, n)| (*what, *n)).collect()
    }

    #[test]
    fn overlapping_agents_are_noted() {
        use AgentKind::{Cyclist, Other, Pedestrian, Vehicle};
        let count = |agents: &[(AgentKind, f64)]| {
            let found = notes(agents);
            let overlaps = found.iter().find(|(what, _)| what.starts_with("agents overlap another one"));
            overlaps.map(|(_, n)| *n)
        };
        let av = (Vehicle, 0.0);
        // Touching boxes do not overlap.
        assert_eq!(count(&[av, (Vehicle, 4.0), (Vehicle, 20.0)]), None);
        assert_eq!(count(&[av, (Vehicle, 20.0), (Vehicle, 23.0)]), Some(2));
        assert_eq!(count(&[av, (Vehicle, 3.0), (Vehicle, 6.0), (Vehicle, 20.0)]), Some(3));
        assert_eq!(count(&[av, (Vehicle, 20.0), (Cyclist, 21.0)]), Some(2));
        assert_eq!(count(&[av, (Pedestrian, 20.0), (Cyclist, 21.0), (Pedestrian, 20.5)]), None);
        assert_eq!(count(&[av, (Other, 1.0)]), None);
    }
}
