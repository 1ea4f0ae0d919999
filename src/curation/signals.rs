//! Whether a trajectory runs a red light.

use crate::geometry::{Vec2, direction, wrap};
use crate::scene::{AgentState, CURRENT, LightState, Road, Scenario};

/// How far past the stopping point the lane is told that was taken, metres.
const TELLING: f64 = 8.0;
/// Largest distance from a lane that is taken, metres.
const ON_LANE: f64 = 1.8;
/// Largest angle to it there, radians; and at the stopping point.
const ALONG: (f64, f64) = (0.5, 0.8);
/// Farthest that the AV passes beside the stopping point, metres.
const BESIDE: f64 = 2.5;

/// Stopping points that are crossed within so many steps belong together.
const TOGETHER: usize = 10;

/// The lights of a scenario over all frames.
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
    states: Vec<Option<LightState>>,
    /// Whether the logged AV runs it on red, too: such a light is not obeyed by anybody (a turn on red, a wrong colour).
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
                states: scenario.light_states(i),
                ignored: false,
            }
        });
        let half_length = 0.5 * scenario.start.agents[0].length;
        let mut signals = Self { road, half_length, lights: lights.collect() };
        let logged: Option<Vec<AgentState>> = scenario.log_future.tracks[0].iter().copied().collect();
        if let Some(logged) = logged {
            let run: Vec<bool> = (0..signals.lights.len())
                .map(|i| signals.red_at(i, &scenario.start.now(0), &logged).is_some())
                .collect();
            signals.lights.iter_mut().zip(run).for_each(|(light, run)| light.ignored = run);
        }
        signals
    }

    /// The step at which the AV crosses a stopping point on red, if it does, on a lane that no other light lets it take.
    pub(super) fn run(&self, now: &AgentState, future: &[AgentState]) -> Option<usize> {
        let crossed: Vec<(usize, usize)> =
            (0..self.lights.len()).filter_map(|i| Some((i, self.crossing(i, now, future)?))).collect();
        let red = |&(i, step): &(usize, usize)| {
            self.lights[i].states[CURRENT + step].is_some_and(LightState::is_red) && !self.lights[i].ignored
        };
        let first = crossed.iter().filter(|c| red(c)).map(|c| c.1).min()?;
        // Lanes that begin together and overlap: one that is known to be free is enough.
        let open = |state: LightState| !state.is_red() && state != LightState::Unknown;
        let free = |c: &(usize, usize)| {
            let light = &self.lights[c.0];
            !light.ignored && light.states[CURRENT + c.1].is_some_and(open) && c.1.abs_diff(first) <= TOGETHER
        };
        (!crossed.iter().any(free)).then_some(first)
    }

    fn red_at(&self, light: usize, now: &AgentState, future: &[AgentState]) -> Option<usize> {
        let step = self.crossing(light, now, future)?;
        self.lights[light].states[CURRENT + step].is_some_and(LightState::is_red).then_some(step)
    }

    /// The step at which the AV's front passes the stopping point of a light and goes on along the lane behind it.
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
                && light.ahead.perp(&(state.position() - light.stop)).abs() < BESIDE
                && wrap(state.heading - light.heading).abs() < ALONG.1
            {
                let later = future[k..].iter().find(|s| past(s) > TELLING).or(future.last())?;
                let line = &self.road.lane(light.lane).baseline;
                let on = line.project(later.position());
                let along = wrap(later.heading - line.heading(on.segment)).abs();
                return (on.distance < ON_LANE && along < ALONG.0).then_some(k + 1);
            }
        }
        None
    }
}
