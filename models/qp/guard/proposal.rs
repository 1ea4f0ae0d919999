//! Proposed motion of a vehicle.

use reactsim_geometry::{Vec2, direction, left, wrap};
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{AgentState, DT, LaneHit, Road};

use super::super::planned_vehicle::PlannedVehicle;

/// Steps at the end of a proposal whose mean speed it keeps beyond its end.
const LAST_STEPS: usize = 3;
/// Steps after the committed ones at which the ground is judged: 1 s and 1.5 s from now.
const JUDGED_STEPS: [usize; 2] = [10, 15];
/// Cosine below which a lane has the opposite direction.
const OPPOSITE_COSINE: f64 = -0.5;
/// Lateral distance from the box centre to the points that must be on the road, metres.
const INSIDE: f64 = 0.7;

/// A proposed motion, with the path that it follows.
pub(in super::super) struct Proposal<'a> {
    now: AgentState,
    states: &'a [AgentState],
    /// Number of steps until the next plan.
    committed: usize,
    /// Arc length now and after each step, metres.
    arcs: Vec<f64>,
}

impl<'a> Proposal<'a> {
    /// Creates a proposal from the present state and the states after each step, at least `committed`, which
    /// is at least 1.
    pub(in super::super) fn new(now: AgentState, states: &'a [AgentState], committed: usize) -> Self {
        let (mut arc, mut before) = (0.0, now.position());
        let arcs = states.iter().map(|s| {
            arc += (s.position() - before).norm();
            before = s.position();
            arc
        });
        let arcs = std::iter::once(0.0).chain(arcs).collect();
        Self { now, states, committed, arcs }
    }

    /// Returns the number of steps until the next plan.
    pub(super) fn committed(&self) -> usize {
        self.committed
    }

    /// Returns arc length, metres, and speed, m/s, after a step.
    pub(super) fn progress(&self, step: usize) -> (f64, f64) {
        let known = self.states.len();
        if step <= known {
            let k = step.max(1);
            return (self.arcs[step], (self.arcs[k] - self.arcs[k - 1]) / DT);
        }
        let back = known.min(LAST_STEPS);
        let speed = (self.arcs[known] - self.arcs[known - back]) / (DT * back as f64);
        (self.arcs[known] + speed * DT * (step - known) as f64, speed)
    }

    /// Returns the mean acceleration over the first two seconds, m/s², from a present speed.
    pub(super) fn acceleration(&self, speed: f64) -> f64 {
        let steps = self.states.len().min(20);
        let time = DT * steps as f64;
        2.0 * (self.arcs[steps] - speed * time) / (time * time)
    }

    /// Returns the pose at an arc length of the path, which is straight beyond its end.
    pub(super) fn pose(&self, arc: f64) -> Pose {
        let state = |k: usize| if k == 0 { &self.now } else { &self.states[k - 1] };
        let last = self.states.len();
        if arc >= self.arcs[last] {
            let end = state(last);
            let position = end.position() + direction(end.heading) * (arc - self.arcs[last]);
            return Pose { position, heading: end.heading };
        }
        let j = self.arcs.partition_point(|a| *a <= arc).clamp(1, last) - 1;
        let (a, b) = (state(j), state(j + 1));
        let t = ((arc - self.arcs[j]) / (self.arcs[j + 1] - self.arcs[j]).max(1e-9)).clamp(0.0, 1.0);
        Pose {
            position: a.position() + (b.position() - a.position()) * t,
            heading: a.heading + wrap(b.heading - a.heading) * t,
        }
    }

    /// Returns whether the vehicle stays on the road, and off lanes of the opposite direction. True for a
    /// vehicle that is off the road already, and where the road is unknown.
    pub(super) fn stays_on_road(&self, vehicle: &PlannedVehicle<'_>) -> bool {
        let Some(road) = vehicle.road else { return true };
        let (mut near, mut lanes) = (None, Vec::new());
        let committed = std::iter::once(self.committed);
        let later =
            JUDGED_STEPS.into_iter().filter(|&step| step > self.committed && step <= self.states.len());
        committed.chain(later).all(|step| {
            let state = &self.states[step - 1];
            let axis = direction(state.heading);
            let aside = left(axis) * INSIDE;
            let mut is_road = |p| road.drivable(p, &mut near) != Some(false);
            let near_centre = [Vec2::zeros(), aside, -aside].map(|a| state.position() + a).into_iter();
            let on_road = near_centre.chain(vehicle.kept_corners(state.position(), axis)).all(&mut is_road);
            on_road && !is_wrong_way(&road, state.position(), axis, &mut lanes)
        })
    }
}

/// Returns whether all lanes at a point have the opposite direction.
pub(super) fn is_wrong_way(road: &Road<'_>, at: Vec2, axis: Vec2, lanes: &mut Vec<LaneHit>) -> bool {
    road.lanes_at(at, lanes);
    let is_opposite = |hit: &LaneHit| {
        let heading = road.lane(hit.lane).baseline.heading(hit.projection.segment);
        direction(heading).dot(&axis) < OPPOSITE_COSINE
    };
    !lanes.is_empty() && lanes.iter().all(is_opposite)
}
