//! Step 1: scenarios in which the AV has vehicles around it.

use crate::geometry::{OrientedBox, Vec2, time_to_impact};
use crate::scene::{AgentKind, CURRENT, FUTURE, Scenario};

/// Which scenarios are worth proposing candidates for.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Preselection {
    /// At least so many vehicles come near the logged AV in the steps 0 to 80.
    pub min_vehicles: u32,
    /// Near is up to this distance between the centres, metres.
    pub radius: f64,
    /// The smallest time to collision between the AV and a vehicle in the log is below this, seconds (swept boxes at constant velocities).
    pub max_ttc: f64,
}

impl Default for Preselection {
    fn default() -> Self {
        Self { min_vehicles: 3, radius: 40.0, max_ttc: 5.0 }
    }
}

/// Relative speeds below this are none, m/s.
const STILL: f64 = 0.1;

/// Rule: the logged AV is absent at a step.
pub const AV_ABSENT: &str = "the logged AV is absent or jumps";
/// Rule: too few vehicles.
pub const FEW_VEHICLES: &str = "too few vehicles near the AV";
/// Rule: nobody comes close.
pub const NO_APPROACH: &str = "no vehicle comes close in time";

impl Preselection {
    /// The rule at which a scenario falls, or `None` for one that is kept.
    pub fn falls(&self, scenario: &Scenario) -> Option<&'static str> {
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

/// Whether the centre of an agent comes that close to the logged AV's at a step.
fn comes_within(scenario: &Scenario, agent: usize, radius: f64) -> bool {
    (0..=FUTURE).any(|step| {
        let (av, other) = (scenario.logged_at(0, CURRENT + step), scenario.logged_at(agent, CURRENT + step));
        av.zip(other).is_some_and(|(a, b)| (b.position() - a.position()).norm() <= radius)
    })
}

/// Whether a vehicle and the logged AV would meet within `most` seconds if both kept their velocities from one of the steps 0 to 80 on
/// (sharp boxes that do not turn).
///
/// A planar rule, because a crossing vehicle is an interaction too; the front-object rule of the metrics would not see it.
fn would_meet(scenario: &Scenario, agent: usize, most: f64) -> bool {
    let agents = &scenario.start.agents;
    let body = |i: usize, frame: usize| {
        let footprint = scenario.logged_at(i, frame)?.footprint(&agents[i]);
        Some((footprint, scenario.logged_velocity(i, frame)?))
    };
    (CURRENT..=CURRENT + FUTURE).any(|frame| {
        let (Some((av, av_velocity)), Some((other, velocity))) = (body(0, frame), body(agent, frame)) else {
            return false;
        };
        can_meet(&av, &other, velocity - av_velocity, most)
            && time_to_impact((&av, av_velocity), (&other, velocity), most).is_some_and(|t| t < most)
    })
}

/// Whether the circles around two boxes meet within `most` seconds at the relative velocity `v` of the second one: quicker to tell, and
/// true wherever the boxes meet. Boxes that do not approach each other never meet, however close they are.
fn can_meet(a: &OrientedBox, b: &OrientedBox, v: Vec2, most: f64) -> bool {
    let (d, reach) = (b.center - a.center, a.radius() + b.radius());
    let (gap, closing, speed2) = (d.norm_squared() - reach * reach, -d.dot(&v), v.norm_squared());
    // Who stands still relative to the other one does not close, whatever the noise of the recorder says.
    if closing <= 0.0 || speed2 < STILL * STILL {
        return false;
    }
    let root = closing * closing - speed2 * gap;
    gap <= 0.0 || root >= 0.0 && closing - root.sqrt() <= most * speed2
}
