//! Links between lanes that are too far apart to be driven.

use std::collections::BTreeSet;

use super::{RoadMap, Scenario};

/// Largest distance from the end of a lane to the start of its successor, metres. Of 58,110 links of Waymo
/// recordings, 57,992 meet within 1 cm. The others skip a lane that is not recorded: a vehicle finds its way
/// across a junction, which is up to about 20 m wide, but not farther.
const MAX_LINK_GAP: f64 = 20.0;

impl Scenario {
    /// Drops the links between lanes that do not meet, and counts them in [`Scenario::repairs`].
    pub(super) fn drop_distant_links(&mut self) {
        let distant = distant_links(&self.start.map);
        if distant.is_empty() {
            return;
        }
        for (i, lane) in self.start.map.lanes.iter_mut().enumerate() {
            lane.successors.retain(|next| !distant.contains(&(i, *next)));
            lane.predecessors.retain(|before| !distant.contains(&(*before, i)));
        }
        *self.repairs.entry("links between lanes that do not meet".to_owned()).or_default() +=
            distant.len() as u32;
    }
}

/// Returns the pairs of a lane and its successor that are too far apart.
fn distant_links(map: &RoadMap) -> BTreeSet<(usize, usize)> {
    let lanes = map.lanes.iter().enumerate();
    let links = lanes.flat_map(|(i, lane)| {
        let next = lane.successors.iter().map(move |next| (i, *next));
        next.chain(lane.predecessors.iter().map(move |before| (*before, i)))
    });
    let gap = |(from, to): (usize, usize)| {
        let (before, after) = (map.lanes[from].baseline.points(), map.lanes[to].baseline.points());
        (after[0] - before[before.len() - 1]).norm()
    };
    links.filter(|link| gap(*link) > MAX_LINK_GAP).collect()
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;
    use crate::{
        Agent, AgentKind, AgentState, FRAMES, LaneArea, LaneClass, LaneKind, LaneParts, LoggedAgent,
        MapParts, ScenarioParts,
    };

    #[test]
    fn links_across_a_gap_are_dropped_and_counted() {
        let lane = |id: &str, x: f64, y: f64, after: &[&str], before: &[&str]| LaneParts {
            id: id.to_owned(),
            kind: LaneKind::Lane,
            class: LaneClass::SurfaceStreet,
            speed_limit: None,
            points: vec![Vec2::new(x, y), Vec2::new(x + 50.0, y)],
            area: LaneArea::Corridor { half_width: 1.75 },
            successors: after.iter().map(|id| (*id).to_owned()).collect(),
            predecessors: before.iter().map(|id| (*id).to_owned()).collect(),
            left: Vec::new(),
            right: Vec::new(),
        };
        let lanes = vec![
            lane("a", 0.0, 0.0, &["near", "far"], &[]),
            lane("near", 50.0 + MAX_LINK_GAP, 0.0, &[], &["a"]),
            // Stated from both sides, and from one side only.
            lane("far", 50.0, 200.0, &[], &["a"]),
            lane("aside", 50.0, 21.0, &[], &["a"]),
        ];
        let state = AgentState { x: 0.0, y: 0.0, heading: 0.0, vx: 0.0, vy: 0.0 };
        let agent = Agent { id: "av".into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
        let scenario = Scenario::assemble(ScenarioParts {
            id: "made".into(),
            origin: Some(Vec2::zeros()),
            agents: vec![LoggedAgent { agent, track: vec![Some(state); FRAMES], heights: Vec::new() }],
            map: MapParts { lanes, ..MapParts::default() },
            ..ScenarioParts::default()
        })
        .unwrap();
        let lanes = &scenario.start.map.lanes;
        assert_eq!(lanes[0].successors, [1]);
        assert_eq!(lanes[1].predecessors, [0]);
        assert!(lanes[2].predecessors.is_empty() && lanes[3].predecessors.is_empty());
        assert_eq!(scenario.repairs["links between lanes that do not meet"], 2);
    }
}
