//! Boxes of everything at every step: the AV's candidate, the log of the others, static obstacles, and
//! the responses found so far.

use std::collections::BTreeMap;

use reactsim_geometry::{Bounds, OrientedBox, rounded_distance, wrap};
use reactsim_metrics::Options;
use reactsim_scene::dynamics::PARKED_DISPLACEMENT;
use reactsim_scene::{AgentState, DT, Frame, Scenario};

use super::AvoidanceSettings;
use crate::Response;

/// Boxes from step 0 on; `None` where absent.
pub(super) type Boxes = Vec<Option<OrientedBox>>;

/// The scene from step 0 on.
pub(super) struct Traffic<'a> {
    pub(super) scenario: &'a Scenario,
    /// The AV's states from step 0 on.
    pub(super) av: &'a [AgentState],
    /// Boxes of all agents (of the AV those of the candidate, of the others those of the log), followed
    /// by the static obstacles.
    pub(super) logged: Vec<Boxes>,
    extents: Vec<Bounds>,
    /// Whether each body never moves in the log.
    parked: Vec<bool>,
    /// Heights of the logged boxes, metres; empty in scenarios of one level.
    heights: Vec<Vec<f64>>,
    /// Responses found so far, by slot.
    pub(super) planned: BTreeMap<usize, PlannedResponse>,
}

/// A response with its boxes.
pub(super) struct PlannedResponse {
    pub(super) response: Response,
    pub(super) boxes: Boxes,
    pub(super) extent: Bounds,
    /// Last step up to which agents that respond to this response move as in the log.
    pub(super) others_reaction_step: usize,
}

/// Number of steps around a logged overlap at which the same two bodies may overlap.
const OVERLAP_STEPS: usize = 2;
/// Largest logged overlap that may also occur at other steps, as the two pass later or earlier, metres.
const MAX_EXCUSED_OVERLAP: f64 = 0.2;
/// Additional overlap that is excused, metres: the log is known at its frames only.
const FRAME_TOLERANCE: f64 = 0.02;

/// Logged relation of two bodies.
pub(super) struct LoggedPair {
    /// Smallest distance (negative if they overlap), at least -[`MAX_EXCUSED_OVERLAP`]; infinite if they
    /// are never near.
    pub(super) closest: f64,
    /// Distance below which they obstruct each other.
    pub(super) limit: f64,
    /// Whether they may overlap at each step, because they do in the log at that step or nearly then;
    /// empty if never.
    exempt: Vec<bool>,
}

impl LoggedPair {
    /// Returns whether the two may overlap at a step.
    pub(super) fn exempt(&self, step: usize) -> bool {
        self.exempt.get(step).copied().unwrap_or(false)
    }
}

impl<'a> Traffic<'a> {
    pub(super) fn new(scenario: &'a Scenario, av: &'a [AgentState]) -> Self {
        let (agents, current) = (&scenario.start.agents, scenario.start.current());
        let of = |i: usize| -> Boxes {
            let state = |k: usize| if i == 0 { Some(av[k]) } else { scenario.logged_at(i, current + k) };
            (0..av.len())
                .map(|k| state(k).filter(|s| s.is_finite()).map(|s| s.footprint(&agents[i])))
                .collect()
        };
        let static_ones = scenario.start.obstacles.iter().map(|&o| vec![Some(o); av.len()]);
        let logged: Vec<Boxes> = (0..agents.len()).map(of).chain(static_ones).collect();
        let extents = logged.iter().map(extent).collect();
        let parked = (0..logged.len()).map(|i| i >= agents.len() || i > 0 && never_moves(scenario, i));
        let parked = parked.collect();
        let heights = heights(scenario, av);
        Self { scenario, av, logged, extents, parked, heights, planned: BTreeMap::new() }
    }

    /// Returns the number of steps after step 0.
    pub(super) fn steps(&self) -> usize {
        self.av.len() - 1
    }

    /// Returns the number of agents, the AV included.
    pub(super) fn len(&self) -> usize {
        self.scenario.start.agents.len()
    }

    /// Returns the number of agents and static obstacles.
    pub(super) fn bodies(&self) -> usize {
        self.logged.len()
    }

    /// Returns whether a body never moves in the log.
    pub(super) fn is_parked(&self, body: usize) -> bool {
        self.parked[body]
    }

    /// Returns the boxes of a body as it currently moves, and their bounds.
    pub(super) fn boxes(&self, agent: usize) -> (&Boxes, &Bounds) {
        match self.planned.get(&agent) {
            Some(planned) => (&planned.boxes, &planned.extent),
            None => (&self.logged[agent], &self.extents[agent]),
        }
    }

    /// Returns the AV's box at a step.
    pub(super) fn av_box(&self, step: usize) -> OrientedBox {
        self.av[step].footprint(&self.scenario.start.agents[0])
    }

    /// Returns whether two bodies are on different levels where their logged ways are closest to each other
    /// (of the AV that of the candidate): whatever they do, they do not meet.
    pub(super) fn never_meet(&self, a: usize, b: usize) -> bool {
        let (Some(a_heights), Some(b_heights)) = (self.heights.get(a), self.heights.get(b)) else {
            return false;
        };
        let road = self.scenario.start.road();
        let mut closest = (f64::INFINITY, None);
        for (mine, &z) in self.logged[a].iter().zip(a_heights) {
            for (theirs, &other) in self.logged[b].iter().zip(b_heights) {
                let Some((mine, theirs)) = mine.as_ref().zip(theirs.as_ref()) else { continue };
                let distance = (mine.center - theirs.center).norm();
                if distance < closest.0 {
                    closest = (distance, Some([(mine.center, z), (theirs.center, other)]));
                }
            }
        }
        closest.1.is_some_and(|[mine, theirs]| road.is_apart(mine, theirs))
    }

    /// Returns the logged relation of two bodies other than the AV.
    pub(super) fn pair(&self, a: usize, b: usize) -> LoggedPair {
        let mut pair = LoggedPair { closest: f64::INFINITY, limit: 0.0, exempt: Vec::new() };
        if !self.extents[a].intersects(&self.extents[b].inflated(1.0)) {
            return pair;
        }
        for (k, (a, b)) in self.logged[a].iter().zip(&self.logged[b]).enumerate() {
            let Some((a, b)) = a.as_ref().zip(b.as_ref()).filter(|(a, b)| is_nearer(a, b, 1.0)) else {
                continue;
            };
            let apart = distance(a, b);
            pair.closest = pair.closest.min(apart);
            if apart < 0.0 {
                pair.exempt.resize(self.av.len(), false);
                pair.exempt[k.saturating_sub(OVERLAP_STEPS)..=(k + OVERLAP_STEPS).min(self.steps())]
                    .fill(true);
            }
        }
        if pair.closest < 0.0 {
            pair.closest = pair.closest.max(-MAX_EXCUSED_OVERLAP);
            pair.limit = pair.closest - FRAME_TOLERANCE;
        }
        pair
    }

    /// Returns the first step at which two bodies, as they currently move, overlap without an excuse in
    /// the log.
    pub(super) fn breach(&self, a: usize, b: usize) -> Option<usize> {
        let ((mine, extent), (theirs, other)) = (self.boxes(a), self.boxes(b));
        if !extent.intersects(other) || self.never_meet(a, b) {
            return None;
        }
        let overlap =
            |k: usize| mine[k].as_ref().zip(theirs[k].as_ref()).is_some_and(|(a, b)| is_nearer(a, b, 0.0));
        let first = (1..=self.steps()).find(|&k| overlap(k))?;
        let pair = self.pair(a, b);
        let deep = |k: usize| {
            mine[k].as_ref().zip(theirs[k].as_ref()).is_some_and(|(a, b)| is_nearer(a, b, pair.limit))
        };
        (first..=self.steps()).find(|&k| !pair.exempt(k) && deep(k))
    }
}

/// Returns the heights from step 0 on of all agents and then of the static obstacles, metres; nothing in
/// scenarios of one level.
fn heights(scenario: &Scenario, av: &[AgentState]) -> Vec<Vec<f64>> {
    let (start, current) = (&scenario.start, scenario.start.current());
    if !start.has_levels() {
        return Vec::new();
    }
    let count = av.len();
    let av: Vec<Frame> = av.iter().copied().map(Some).collect();
    let logged = (1..start.agents.len()).map(|i| start.heights_along(i, &scenario.logged(i)[current..]));
    let obstacles = (0..start.obstacles.len()).map(|i| vec![start.obstacle_height(i); count]);
    std::iter::once(start.heights_along(0, &av)).chain(logged).chain(obstacles).collect()
}

/// Returns whether an agent stays at its current position in all frames of its log.
fn never_moves(scenario: &Scenario, agent: usize) -> bool {
    let now = scenario.start.now(agent).position();
    let frames = scenario.start.history[agent].iter().chain(&scenario.log_future.tracks[agent]);
    frames.flatten().filter(|s| s.is_finite()).all(|s| (s.position() - now).norm() < PARKED_DISPLACEMENT)
}

/// Returns the bounds of the boxes of a track.
pub(super) fn extent(boxes: &Boxes) -> Bounds {
    let radius = boxes.iter().flatten().next_back().map_or(0.0, OrientedBox::radius);
    Bounds::of(boxes.iter().flatten().map(|b| b.center)).inflated(radius)
}

/// Returns the distance of two boxes with rounded corners, as in the metrics, metres.
pub(super) fn distance(a: &OrientedBox, b: &OrientedBox) -> f64 {
    rounded_distance(a, b, Options::default().corner_rounding)
}

/// Returns whether two boxes are closer to each other than `clearance`.
pub(super) fn is_nearer(a: &OrientedBox, b: &OrientedBox, clearance: f64) -> bool {
    let reach = a.radius() + b.radius() + clearance;
    (a.center - b.center).norm_squared() < reach * reach && distance(a, b) < clearance
}

pub(super) fn reaction_steps(settings: &AvoidanceSettings) -> usize {
    (settings.reaction / DT).round().max(0.0) as usize
}

/// Returns the last step up to which an observer of a deviation of so many steps moves as in the log: the
/// first step at which it is visible plus the reaction time. `None` if it is never visible.
pub(super) fn reaction_step(
    settings: &AvoidanceSettings,
    steps: usize,
    moved: impl Fn(usize) -> AgentState,
    logged: impl Fn(usize) -> Frame,
) -> Option<usize> {
    let visible = |k: &usize| {
        let (actual, Some(expected)) = (moved(*k), logged(*k)) else { return false };
        (actual.position() - expected.position()).norm() > settings.visible_offset
            || wrap(actual.heading - expected.heading).abs() > settings.visible_heading
            || (actual.speed() - expected.speed()).abs() > settings.visible_speed
    };
    (1..=steps).find(visible).map(|k| k + reaction_steps(settings))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(x: f64, speed: f64) -> AgentState {
        AgentState { x, y: 0.0, heading: 0.0, vx: speed, vy: 0.0 }
    }

    #[test]
    fn a_deviation_is_seen_by_speed_or_by_place_and_answered_later() {
        let settings = AvoidanceSettings::default();
        let log = |k: usize| Some(state(k as f64, 10.0));
        assert_eq!(reaction_step(&settings, 80, |k| state(k as f64, 10.0), log), None);
        // 3 m/s² of braking are 1.2 m/s after 0.4 s.
        let brakes = |k: usize| state(k as f64, 10.0 - 0.3 * k as f64);
        assert_eq!(reaction_step(&settings, 80, brakes, log), Some(4 + 3));
        let aside = |k: usize| AgentState { y: 0.06 * k as f64, ..state(k as f64, 10.0) };
        assert_eq!(reaction_step(&settings, 80, aside, log), Some(9 + 3));
    }
}
