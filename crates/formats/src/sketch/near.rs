//! The surroundings of the agents: the part of the map to draw.

use std::collections::BTreeSet;

use reactsim_geometry::Vec2;
use reactsim_scene::Scenario;

/// Side of a cell, metres.
const CELL: f64 = 10.0;
/// Radius of the drawn map around the logged path of the AV, metres.
const AV_RADIUS: f64 = 150.0;
/// Radius of the drawn map around the logged paths of the other agents, metres.
const AGENT_RADIUS: f64 = 20.0;

/// Grid cells in the surroundings.
pub(super) struct Near {
    cells: BTreeSet<(i32, i32)>,
}

impl Near {
    pub(super) fn new(scenario: &Scenario) -> Self {
        let cells_of = |agent: usize| -> BTreeSet<(i32, i32)> {
            scenario.logged(agent).iter().flatten().map(|s| cell(s.position())).collect()
        };
        let mut near = Self { cells: BTreeSet::new() };
        near.add(&cells_of(0), AV_RADIUS);
        for i in 1..scenario.start.agents.len() {
            near.add(&cells_of(i), AGENT_RADIUS);
        }
        near
    }

    fn add(&mut self, around: &BTreeSet<(i32, i32)>, reach: f64) {
        let radius = (reach / CELL).ceil() as i32;
        // Half a cell more: distances are between the centres of cells.
        let farthest = f64::from(radius) + 0.5;
        for &(x, y) in around {
            for dx in -radius..=radius {
                let high = (farthest * farthest - f64::from(dx * dx)).max(0.0).sqrt() as i32;
                let cells = (-high..=high).map(|dy| (x.saturating_add(dx), y.saturating_add(dy)));
                self.cells.extend(cells);
            }
        }
    }

    /// Returns whether a point is in the surroundings.
    pub(super) fn holds(&self, point: Vec2) -> bool {
        self.cells.contains(&cell(point))
    }

    /// Returns whether any of the points is in the surroundings.
    pub(super) fn meets(&self, points: &[Vec2]) -> bool {
        points.iter().any(|&p| self.holds(p))
    }
}

fn cell(point: Vec2) -> (i32, i32) {
    ((point.x / CELL).floor() as i32, (point.y / CELL).floor() as i32)
}
