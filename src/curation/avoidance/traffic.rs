//! Everybody's boxes at every step: the AV's candidate, the log of the others, and the responses found so far.

use std::collections::BTreeMap;

use super::AvoidanceSettings;
use crate::curation::Response;
use crate::geometry::{Bounds, OrientedBox, rounded_distance, wrap};
use crate::metrics::Options;
use crate::scene::{AgentState, CURRENT, DT, FUTURE, Frame, Scenario};

/// Boxes at the steps 0 to 80; `None` where absent.
pub(super) type Boxes = Vec<Option<OrientedBox>>;

/// The scene at the steps 0 to 80.
pub(super) struct Traffic<'a> {
    pub(super) scenario: &'a Scenario,
    /// The AV's 81 states.
    pub(super) av: &'a [AgentState],
    /// Boxes of all agents: of the AV those of the candidate, of the others those of the log.
    pub(super) logged: Vec<Boxes>,
    extents: Vec<Bounds>,
    /// What was found so far, by slot.
    pub(super) planned: BTreeMap<usize, Planned>,
}

/// A response with its boxes.
pub(super) struct Planned {
    pub(super) response: Response,
    pub(super) boxes: Boxes,
    pub(super) extent: Bounds,
}

impl<'a> Traffic<'a> {
    pub(super) fn new(scenario: &'a Scenario, av: &'a [AgentState]) -> Self {
        let agents = &scenario.start.agents;
        let of = |i: usize| -> Boxes {
            let state = |k: usize| if i == 0 { Some(av[k]) } else { logged_at(scenario, i, k) };
            (0..=FUTURE)
                .map(|k| state(k).filter(|s| s.is_finite()).map(|s| s.footprint(&agents[i])))
                .collect()
        };
        let logged: Vec<Boxes> = (0..agents.len()).map(of).collect();
        let extents = logged.iter().map(extent).collect();
        Self { scenario, av, logged, extents, planned: BTreeMap::new() }
    }

    /// Number of agents, the AV included.
    pub(super) fn len(&self) -> usize {
        self.logged.len()
    }

    /// The boxes of an agent as it moves now, and the bounds of them.
    pub(super) fn boxes(&self, agent: usize) -> (&Boxes, &Bounds) {
        match self.planned.get(&agent) {
            Some(planned) => (&planned.boxes, &planned.extent),
            None => (&self.logged[agent], &self.extents[agent]),
        }
    }

    /// The AV's box at a step.
    pub(super) fn av_box(&self, step: usize) -> OrientedBox {
        self.av[step].footprint(&self.scenario.start.agents[0])
    }

    /// The smallest distance of two agents in the log (not of the AV), metres; infinite where they are far apart.
    pub(super) fn log_distance(&self, a: usize, b: usize) -> f64 {
        if !self.extents[a].intersects(&self.extents[b].inflated(1.0)) {
            return f64::INFINITY;
        }
        closest(&self.logged[a], &self.logged[b], 1.0)
    }
}

/// The logged state of an agent at a step, 0 to 80.
pub(super) fn logged_at(scenario: &Scenario, agent: usize, step: usize) -> Frame {
    match step {
        0 => scenario.start.history[agent][CURRENT],
        k => scenario.log_future.tracks[agent][k - 1],
    }
}

/// Bounds of the boxes of a track.
pub(super) fn extent(boxes: &Boxes) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    let mut radius = 0.0;
    for b in boxes.iter().flatten() {
        bounds = Bounds { min: bounds.min.inf(&b.center), max: bounds.max.sup(&b.center) };
        radius = b.radius();
    }
    bounds.inflated(radius)
}

/// The rounded distance of two boxes as the metrics take it, metres.
pub(super) fn distance(a: &OrientedBox, b: &OrientedBox) -> f64 {
    rounded_distance(a, b, Options::default().corner_rounding)
}

/// Whether two boxes are nearer to each other than `clearance`.
pub(super) fn nearer(a: &OrientedBox, b: &OrientedBox, clearance: f64) -> bool {
    let reach = a.radius() + b.radius() + clearance;
    (a.center - b.center).norm_squared() < reach * reach && distance(a, b) < clearance
}

/// The smallest distance over all steps, or infinite where it is more than `limit`.
fn closest(a: &Boxes, b: &Boxes, limit: f64) -> f64 {
    let pairs = a.iter().zip(b).filter_map(|(a, b)| a.as_ref().zip(b.as_ref()));
    let near = pairs.filter(|(a, b)| nearer(a, b, limit));
    near.map(|(a, b)| distance(a, b)).fold(f64::INFINITY, f64::min)
}

/// Steps of the reaction time.
pub(super) fn reaction_steps(settings: &AvoidanceSettings) -> usize {
    (settings.reaction / DT).round().max(0.0) as usize
}

/// The step up to which an observer of a deviation moves as in the log: the first step at which it is visible and the reaction
/// time. `None` where nothing is ever visible.
pub(super) fn reaction_step(
    settings: &AvoidanceSettings,
    moved: impl Fn(usize) -> AgentState,
    logged: impl Fn(usize) -> Frame,
) -> Option<usize> {
    let visible = |k: &usize| {
        let (is, Some(was)) = (moved(*k), logged(*k)) else { return false };
        (is.position() - was.position()).norm() > settings.visible_offset
            || wrap(is.heading - was.heading).abs() > settings.visible_heading
            || (is.speed() - was.speed()).abs() > settings.visible_speed
    };
    (1..=FUTURE).find(visible).map(|k| k + reaction_steps(settings))
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
        assert_eq!(reaction_step(&settings, |k| state(k as f64, 10.0), log), None);
        // 3 m/s² of braking are 1.2 m/s after 0.4 s.
        let brakes = |k: usize| state(k as f64, 10.0 - 0.3 * k as f64);
        assert_eq!(reaction_step(&settings, brakes, log), Some(4 + 3));
        let aside = |k: usize| AgentState { y: 0.06 * k as f64, ..state(k as f64, 10.0) };
        assert_eq!(reaction_step(&settings, aside, log), Some(9 + 3));
    }
}
