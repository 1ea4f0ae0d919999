//! Plans of a learned planner, driven along the lanes: the route that a plan takes, at its speeds.

use reactsim_geometry::{Vec2, direction, wrap};
use reactsim_scene::dynamics::{AxlePath, REAR_AXLE, VehicleMotion, follow_smoothly};
use reactsim_scene::{AgentState, DT, Frame, Scenario, Start};

use super::routes::{Route, drive, routes};
use super::survey::acceleration_now;

/// Speed, m/s, by which an AV may exceed its present one on average.
const SPEED_GAIN: f64 = 6.0;
/// Number of steps between the states of a plan that are compared with routes.
const COMPARED_STEPS: usize = 4;
/// Distance over which the present curvature is measured, metres.
const CURVATURE_DISTANCE: f64 = 1.0;
/// Largest present curvature, 1/m.
const MAX_CURVATURE: f64 = 0.25;

/// The routes over the lane graph that an AV may take from where it is. They depend on nothing that happens
/// later.
pub struct LaneRoutes<'a> {
    start: &'a Start,
    /// Present speed, m/s, and acceleration, m/s².
    speed: f64,
    acceleration: f64,
    routes: Vec<(Route, AxlePath)>,
}

impl<'a> LaneRoutes<'a> {
    /// Finds the routes of an AV; `None` if the AV drives backwards, which lanes do not tell.
    pub fn of(scenario: &'a Scenario) -> Option<Self> {
        let start = &scenario.start;
        let speed = VehicleMotion::after(&start.history[0])?.speed;
        if speed < 0.0 {
            return None;
        }
        let curvature = curvature(&start.history[0]);
        let reach = scenario.length().future as f64 * DT * (speed + SPEED_GAIN);
        let with_path = |route: Route| {
            let path = drive(start, &route.guide, curvature);
            (route, path)
        };
        let routes = routes(start, reach).into_iter().map(with_path).collect();
        Some(Self { start, speed, acceleration: acceleration_now(scenario), routes })
    }

    /// Returns the states, 0.1 s apart and as many as those of its plan, of an AV that takes the route to
    /// which this plan keeps closest, at the plan's speeds as far as bends, speed limits and the end of the
    /// route allow; `None` if there is no lane.
    pub fn drive(&self, plan: &[AgentState]) -> Option<Vec<AgentState>> {
        let rear = REAR_AXLE * self.start.agents[0].length;
        let axles: Vec<Vec2> =
            plan.iter().map(|state| state.position() - direction(state.heading) * rear).collect();
        let compared: Vec<Vec2> =
            axles.iter().skip(COMPARED_STEPS - 1).step_by(COMPARED_STEPS).copied().collect();
        let distance = |route: &Route| {
            let sum: f64 = compared.iter().map(|p| route.guide.project(*p).distance).sum();
            sum / compared.len().max(1) as f64
        };
        let distances = self.routes.iter().map(|(route, path)| (distance(route), route, path));
        let (_, route, path) = distances.min_by(|a, b| a.0.total_cmp(&b.0))?;
        // Progress along the route: a plan that strays is longer.
        let mut progress = 0.0;
        let speed = |p: &Vec2| {
            let before = progress;
            progress = route.guide.project(*p).s.max(before);
            (progress - before) / DT
        };
        let speeds: Vec<f64> = axles.iter().map(speed).collect();
        Some(follow_smoothly(self.start.now(0), self.speed, self.acceleration, path, &speeds))
    }
}

/// Returns the latest curvature of a track that ends now, 1/m, left positive; 0 for an agent that hardly
/// moves.
fn curvature(track: &[Frame]) -> f64 {
    let Some(now) = track.last().copied().flatten() else { return 0.0 };
    let before = track.iter().rev().map_while(|frame| *frame);
    let far = before.map(|state| ((now.position() - state.position()).norm(), state));
    let found = far.into_iter().find(|(distance, _)| *distance >= CURVATURE_DISTANCE);
    found.map_or(0.0, |(distance, state)| {
        (wrap(now.heading - state.heading) / distance).clamp(-MAX_CURVATURE, MAX_CURVATURE)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curvature_is_that_of_the_latest_metre() {
        let on_circle = |k: u8| {
            let angle = f64::from(k) * 0.05;
            Some(AgentState {
                x: 20.0 * angle.sin(),
                y: 20.0 - 20.0 * angle.cos(),
                heading: angle,
                vx: 0.0,
                vy: 0.0,
            })
        };
        let track: Vec<Frame> = (0..11).map(on_circle).collect();
        assert!((curvature(&track) - 0.05).abs() < 1e-3);
        assert_eq!(curvature(&track[..1]), 0.0);
        assert_eq!(curvature(&[None]), 0.0);
        // States before a gap are ignored.
        let mut gap = track;
        gap[9] = None;
        assert_eq!(curvature(&gap), 0.0);
    }
}
