//! The map of the agents: lanes, signals and stop lines.

use reactsim_geometry::{Polyline, Vec2};

use crate::PlanningMap;
use crate::path::baseline_states;
use crate::planner::{Light, LightState};
use crate::trajectory::Pose;

/// Distance in metres between the points from which the curvature at the begin of a lane is estimated (nuPlan
/// devkit 1.2.2, `estimate_curvature_along_path`).
const CURVATURE_STEP: f64 = 2.0;
/// Squared area of the triangle of these points, m⁴, below which the lane is straight (nuPlan devkit 1.2.2,
/// `compute_curvature`).
const STRAIGHT_AREA2: f64 = 1e-6;

/// The stop line of a signal.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalLine {
    /// Name.
    pub id: String,
    /// Ring around the line, or its two ends, metres.
    pub outline: Vec<Vec2>,
    /// Connectors for which it is the stop line: indices into [`PlanningMap::lanes`].
    pub connectors: Vec<usize>,
}

/// The map of the agents.
#[derive(Clone, Debug)]
pub struct AgentRoads {
    map: PlanningMap,
    has_signal: Vec<bool>,
    pub(super) stop_lines: Vec<SignalLine>,
}

impl AgentRoads {
    /// Creates the map of agents. `signalled`: lanes with a traffic light, as indices; others are left out.
    pub fn new(map: PlanningMap, signalled: &[usize], stop_lines: Vec<SignalLine>) -> Self {
        let has_signal = (0..map.lanes().len()).map(|lane| signalled.contains(&lane)).collect();
        Self { map, has_signal, stop_lines }
    }

    /// Returns the map.
    pub fn map(&self) -> &PlanningMap {
        &self.map
    }

    pub(super) fn baseline(&self, lane: usize) -> &Polyline {
        &self.map.lane(lane).baseline
    }

    /// Returns the states of the centre line of a lane.
    pub(super) fn states(&self, lane: usize) -> Vec<Pose> {
        baseline_states(self.baseline(lane))
    }

    /// Returns the speed limit of a lane, m/s; `None` if it is unknown or not positive.
    pub(super) fn limit(&self, lane: usize) -> Option<f64> {
        self.map.lane(lane).speed_limit.filter(|&limit| limit > 0.0)
    }

    /// Returns the lane in which a path goes on: the straightest successor that may be entered, the first one
    /// on ties. A lane with a signal may be entered at green, any other lane unless it is red.
    pub(super) fn next(&self, lane: usize, lights: &[Light]) -> Option<usize> {
        let has = |lane: usize, state: LightState| lights.contains(&Light { lane, state });
        let is_open = |lane: &usize| {
            if self.has_signal[*lane] { has(*lane, LightState::Green) } else { !has(*lane, LightState::Red) }
        };
        let open = self.map.lane(lane).successors.iter().copied().filter(is_open);
        let curvatures = open.map(|next| (first_curvature(self.baseline(next)), next));
        curvatures.reduce(|best, other| if other.0 < best.0 { other } else { best }).map(|(_, next)| next)
    }
}

/// Returns the curvature at the begin of a line, 1/m, without sign.
fn first_curvature(line: &Polyline) -> f64 {
    let step = CURVATURE_STEP.min(0.5 * line.length());
    let [p, q, r] = [0.0, step, 2.0 * step].map(|s| line.at(s));
    let (a, b, c) = ((q - p).norm(), (r - q).norm(), (p - r).norm());
    let half = 0.5 * (a + b + c);
    let area2 = half * (half - a) * (half - b) * (half - c);
    if area2 < STRAIGHT_AREA2 { 0.0 } else { 4.0 * area2.sqrt() / (a * b * c) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curvature_of_a_circle_is_that_of_its_first_metres() {
        let on_circle = |i: u32| {
            let angle = f64::from(i) * 0.05;
            Vec2::new(20.0 * angle.sin(), 20.0 - 20.0 * angle.cos())
        };
        let circle = Polyline::new(&(0..30).map(on_circle).collect::<Vec<_>>()).unwrap();
        assert!((first_curvature(&circle) - 0.05).abs() < 1e-3);
        let short = Polyline::new(&(0..3).map(on_circle).collect::<Vec<_>>()).unwrap();
        assert!((first_curvature(&short) - 0.05).abs() < 1e-3);
        let straight = Polyline::new(&[Vec2::zeros(), Vec2::new(7.0, 1.0)]).unwrap();
        assert_eq!(first_curvature(&straight), 0.0);
    }
}
