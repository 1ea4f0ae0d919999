//! Agents appear and vanish only at the border of the map.

use reactsim::geometry::{Bounds, Vec2};
use reactsim::scene::{AgentKind, FRAMES, Lane, RoadMap};

use super::sample::{Generated, obeyed};

/// Distance to the end of a lane at the border within which vehicles and cyclists appear and vanish, metres.
const AT_END: f64 = 15.0;
/// Distance to such an end, or to the bounds of the map, within which pedestrians do, metres: pavements reach
/// a little farther than lanes.
const ON_FOOT: f64 = 25.0;

/// Positions at which roads leave the map.
struct Border {
    /// Positions at which vehicles appear.
    entries: Vec<Vec2>,
    /// Positions at which vehicles vanish.
    exits: Vec<Vec2>,
    bounds: Bounds,
}

impl Border {
    fn of(map: &RoadMap) -> Self {
        // A lane that ends next to one that continues does not end at the border.
        let first = |lane: &Lane| lane.baseline.at(0.0);
        let last = |lane: &Lane| lane.baseline.at(lane.baseline.length());
        let beside =
            |lane: &Lane| lane.left.iter().chain(&lane.right).map(|n| &map.lanes[n.lane]).collect::<Vec<_>>();
        let begins = |lane: &Lane, p: Vec2| lane.predecessors.is_empty() && (first(lane) - p).norm() < AT_END;
        let ends = |lane: &Lane, p: Vec2| lane.successors.is_empty() && (last(lane) - p).norm() < AT_END;
        let entries = map.lanes.iter().filter(|l| {
            let p = first(l);
            begins(l, p) && beside(l).iter().all(|n| begins(n, p))
        });
        let exits = map.lanes.iter().filter(|l| {
            let p = last(l);
            ends(l, p) && beside(l).iter().all(|n| ends(n, p))
        });
        Self {
            entries: entries.map(first).collect(),
            exits: exits.map(last).collect(),
            bounds: Bounds::of(map.lanes.iter().flat_map(|l| l.baseline.points().iter().copied())),
        }
    }

    fn allows(&self, kind: AgentKind, p: Vec2, comes: bool) -> bool {
        let near = |places: &[Vec2], reach: f64| places.iter().any(|q| (q - p).norm() <= reach);
        if kind == AgentKind::Pedestrian {
            return near(&self.entries, ON_FOOT)
                || near(&self.exits, ON_FOOT)
                || !self.bounds.inflated(-ON_FOOT).contains(p);
        }
        near(if comes { &self.entries } else { &self.exits }, AT_END)
    }
}

#[test]
fn nobody_appears_or_vanishes_without_cause() {
    let judged = obeyed(|Generated { scenario, everybody }, breaches| {
        let border = Border::of(&scenario.start.map);
        for a in everybody {
            let there: Vec<usize> = (0..FRAMES).filter(|f| a.track[*f].is_some()).collect();
            let (first, last) = (there[0], there[there.len() - 1]);
            if last - first + 1 != there.len() {
                breaches.note(&a.agent.id, first, "is away in between");
            }
            let ends = [(first, true, first > 0), (last, false, last < FRAMES - 1)];
            for (f, comes, _) in ends.into_iter().filter(|e| e.2) {
                breaches.judge();
                let p = a.track[f].unwrap().position();
                if !border.allows(a.agent.kind, p, comes) {
                    let what = if comes { "appears" } else { "vanishes" };
                    breaches.note(&a.agent.id, f, format_args!("{what} at ({:.1}, {:.1})", p.x, p.y));
                }
            }
        }
    });
    assert!(judged > 50, "only {judged} came or went");
}
