//! Detection of trajectories that run a red light.

use reactsim_geometry::{Vec2, direction, wrap};
use reactsim_scene::{AgentState, LightState, Road, Scenario};

/// Distance beyond the stopping point at which the lane taken is determined, metres.
const LANE_CHECK_DISTANCE: f64 = 8.0;
/// Largest distance from a lane at which the AV takes it, metres.
const ON_LANE_DISTANCE: f64 = 1.8;
/// Largest angle to a lane at which the AV takes it, radians.
const ON_LANE_ANGLE: f64 = 0.5;
/// Largest angle to the lane at which the AV crosses its stopping point, radians.
const CROSSING_ANGLE: f64 = 0.8;
/// Largest lateral distance at which the AV crosses a stopping point, metres.
const CROSSING_OFFSET: f64 = 2.5;
/// Largest number of steps between crossings of stopping points that belong together.
const JOINT_CROSSING_STEPS: usize = 10;

/// The traffic lights of a scenario.
pub(super) struct Signals<'a> {
    road: Road<'a>,
    half_length: f64,
    lights: Vec<Light>,
}

struct Light {
    lane: usize,
    stop: Vec2,
    ahead: Vec2,
    heading: f64,
    /// States from step 0 on.
    states: Vec<Option<LightState>>,
    /// Whether the logged AV runs this light on red too (a turn on red, or a wrong colour). Such a light
    /// is ignored for all candidates.
    ignored: bool,
}

impl<'a> Signals<'a> {
    pub(super) fn new(scenario: &'a Scenario) -> Self {
        let road = scenario.start.road();
        let lights = scenario.start.lights.iter().enumerate().map(|(i, light)| {
            let line = &road.lane(light.lane).baseline;
            let heading = line.heading(line.project(light.stop_point).segment);
            Light {
                lane: light.lane,
                stop: light.stop_point,
                ahead: direction(heading),
                heading,
                states: scenario.light_states(i).split_off(scenario.start.current()),
                ignored: false,
            }
        });
        let half_length = 0.5 * scenario.start.agents[0].length;
        let mut signals = Self { road, half_length, lights: lights.collect() };
        let logged: Option<Vec<AgentState>> = scenario.log_future.tracks[0].iter().copied().collect();
        if let Some(logged) = logged {
            let is_run: Vec<bool> = (0..signals.lights.len())
                .map(|i| signals.red_at(i, &scenario.start.now(0), &logged).is_some())
                .collect();
            signals.lights.iter_mut().zip(is_run).for_each(|(light, is_run)| light.ignored = is_run);
        }
        signals
    }

    /// Returns the step at which the AV crosses a stopping point on red, if any, unless another light
    /// permits the same lane.
    pub(super) fn red_light_step(&self, now: &AgentState, future: &[AgentState]) -> Option<usize> {
        let crossed: Vec<(usize, usize)> =
            (0..self.lights.len()).filter_map(|i| Some((i, self.crossing(i, now, future)?))).collect();
        let red = |&(i, step): &(usize, usize)| {
            self.lights[i].states[step].is_some_and(LightState::is_red) && !self.lights[i].ignored
        };
        let first = crossed.iter().filter(|c| red(c)).map(|c| c.1).min()?;
        // For overlapping lanes that begin together, one green light suffices.
        let open = |state: LightState| !state.is_red() && state != LightState::Unknown;
        let free = |c: &(usize, usize)| {
            let light = &self.lights[c.0];
            !light.ignored
                && light.states[c.1].is_some_and(open)
                && c.1.abs_diff(first) <= JOINT_CROSSING_STEPS
        };
        (!crossed.iter().any(free)).then_some(first)
    }

    fn red_at(&self, light: usize, now: &AgentState, future: &[AgentState]) -> Option<usize> {
        let step = self.crossing(light, now, future)?;
        self.lights[light].states[step].is_some_and(LightState::is_red).then_some(step)
    }

    /// Returns the step at which the AV's front passes the stopping point of a light and continues along
    /// the lane behind it.
    fn crossing(&self, light: usize, now: &AgentState, future: &[AgentState]) -> Option<usize> {
        let light = &self.lights[light];
        let past = |s: &AgentState| {
            (s.position() + direction(s.heading) * self.half_length - light.stop).dot(&light.ahead)
        };
        let mut before = past(now);
        for (k, state) in future.iter().enumerate() {
            let here = past(state);
            let crosses = before < 0.0 && here >= 0.0;
            before = here;
            if crosses
                && light.ahead.perp(&(state.position() - light.stop)).abs() < CROSSING_OFFSET
                && wrap(state.heading - light.heading).abs() < CROSSING_ANGLE
            {
                let later = future[k..].iter().find(|s| past(s) > LANE_CHECK_DISTANCE).or(future.last())?;
                let line = &self.road.lane(light.lane).baseline;
                let on = line.project(later.position());
                let along = wrap(later.heading - line.heading(on.segment)).abs();
                return (on.distance < ON_LANE_DISTANCE && along < ON_LANE_ANGLE).then_some(k + 1);
            }
        }
        None
    }
}
