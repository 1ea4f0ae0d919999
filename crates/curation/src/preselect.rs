//! Step 1: scenarios in which vehicles surround the AV.

use reactsim_geometry::{OrientedBox, Vec2, time_to_impact};
use reactsim_scene::{AgentKind, Scenario};

/// Criteria for scenarios that candidates are proposed for.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Preselection {
    /// Minimum number of vehicles that come within `radius` of the logged AV at some step.
    pub min_vehicles: u32,
    /// Largest distance between the centres that counts as near, metres.
    pub radius: f64,
    /// Upper bound, in seconds, of the smallest time to collision between the AV and a vehicle in the
    /// log (swept boxes at constant velocities).
    pub max_ttc: f64,
}

impl Default for Preselection {
    fn default() -> Self {
        Self { min_vehicles: 3, radius: 40.0, max_ttc: 5.0 }
    }
}

/// Relative speed below which two vehicles do not approach each other, m/s: slower motion is recording
/// noise.
const MIN_RELATIVE_SPEED: f64 = 0.1;

/// Rule: the logged AV is absent at a step, or jumps.
pub const AV_ABSENT: &str = "the logged AV is absent or jumps";
/// Rule: too few vehicles.
pub const FEW_VEHICLES: &str = "too few vehicles near the AV";
/// Rule: no vehicle approaches within the time to collision.
pub const NO_APPROACH: &str = "no vehicle comes close in time";

impl Preselection {
    /// Returns the rule that rejects a scenario, or `None` for a scenario that passes.
    pub fn failed_rule(&self, scenario: &Scenario) -> Option<&'static str> {
        let start = &scenario.start;
        let near: Vec<usize> = (1..start.agents.len())
            .filter(|&i| start.agents[i].kind == AgentKind::Vehicle)
            .filter(|&i| comes_within(scenario, i, self.radius))
            .collect();
        if near.len() < self.min_vehicles as usize {
            return Some(FEW_VEHICLES);
        }
        let meets = near.iter().any(|&i| would_meet(scenario, i, self.max_ttc));
        (!meets).then_some(NO_APPROACH)
    }
}

/// Returns whether the centre of an agent comes within `radius` of the logged AV's centre at some step.
fn comes_within(scenario: &Scenario, agent: usize, radius: f64) -> bool {
    let length = scenario.length();
    (length.current()..length.frames()).any(|frame| {
        let (av, other) = (scenario.logged_at(0, frame), scenario.logged_at(agent, frame));
        av.zip(other).is_some_and(|(a, b)| (b.position() - a.position()).norm() <= radius)
    })
}

/// Returns whether a vehicle and the logged AV would meet within `most` seconds if both kept their
/// velocities from one of the steps on (boxes with sharp corners, without rotation).
///
/// The rule is planar, because a crossing vehicle is an interaction too; the front-object rule of the
/// metrics would miss it.
fn would_meet(scenario: &Scenario, agent: usize, most: f64) -> bool {
    let agents = &scenario.start.agents;
    let body = |i: usize, frame: usize| {
        let footprint = scenario.logged_at(i, frame)?.footprint(&agents[i]);
        Some((footprint, scenario.logged_velocity(i, frame)?))
    };
    let length = scenario.length();
    (length.current()..length.frames()).any(|frame| {
        let (Some((av, av_velocity)), Some((other, velocity))) = (body(0, frame), body(agent, frame)) else {
            return false;
        };
        can_meet(&av, &other, velocity - av_velocity, most)
            && time_to_impact((&av, av_velocity), (&other, velocity), most).is_some_and(|t| t < most)
    })
}

/// Returns whether the circles around two boxes meet within `most` seconds at the relative velocity `v`
/// of the second one.
///
/// This is a fast necessary condition for the boxes to meet. Boxes that do not approach each other never
/// meet, however close they are.
fn can_meet(a: &OrientedBox, b: &OrientedBox, v: Vec2, most: f64) -> bool {
    let (d, reach) = (b.center - a.center, a.radius() + b.radius());
    let (gap, closing, speed2) = (d.norm_squared() - reach * reach, -d.dot(&v), v.norm_squared());
    // A vehicle at rest relative to the other does not approach it, whatever the recording noise.
    if closing <= 0.0 || speed2 < MIN_RELATIVE_SPEED * MIN_RELATIVE_SPEED {
        return false;
    }
    let root = closing * closing - speed2 * gap;
    gap <= 0.0 || root >= 0.0 && closing - root.sqrt() <= most * speed2
}
