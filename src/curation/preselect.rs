//! Step 1: scenarios in which the AV has vehicles around it.

use crate::geometry::Vec2;
use crate::scene::{AgentKind, CURRENT, FUTURE, Scenario};

/// Which scenarios are worth proposing candidates for.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Preselection {
    /// At least so many vehicles come near the logged AV in the steps 0 to 80.
    pub min_vehicles: u32,
    /// Near is up to this distance between the centres, metres.
    pub radius: f64,
    /// The smallest time to collision between the AV and a vehicle in the log is below this, seconds.
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
        let closest = near.iter().map(|&i| smallest_ttc(scenario, i)).fold(f64::INFINITY, f64::min);
        (!(closest < self.max_ttc)).then_some(NO_APPROACH)
    }
}

/// Whether the centre of an agent comes that close to the logged AV's at a step.
fn comes_within(scenario: &Scenario, agent: usize, radius: f64) -> bool {
    (0..=FUTURE).any(|step| {
        let (av, other) = (scenario.logged_at(0, CURRENT + step), scenario.logged_at(agent, CURRENT + step));
        av.zip(other).is_some_and(|(a, b)| (b.position() - a.position()).norm() <= radius)
    })
}

/// The smallest time to collision of a vehicle with the logged AV over the steps 0 to 80, seconds: each step both are taken to go on
/// with their velocities, as circles of half of the mean of length and width; infinite where they never meet.
///
/// A planar rule, because a crossing vehicle is an interaction too; the front-object rule of the metrics would not see it.
fn smallest_ttc(scenario: &Scenario, agent: usize) -> f64 {
    let size = |i: usize| {
        let a = &scenario.start.agents[i];
        0.25 * (a.length + a.width)
    };
    let reach = size(0) + size(agent);
    let velocity = |i: usize, step: usize| scenario.logged_velocity(i, CURRENT + step);
    let mut smallest = f64::INFINITY;
    for step in 0..=FUTURE {
        if let (Some(av), Some(other)) =
            (scenario.logged_at(0, CURRENT + step), scenario.logged_at(agent, CURRENT + step))
            && let (Some(va), Some(vb)) = (velocity(0, step), velocity(agent, step))
        {
            smallest = smallest.min(time_to_meet(other.position() - av.position(), vb - va, reach));
        }
    }
    smallest
}

/// When two circles whose radii sum to `reach` meet at constant velocities, seconds: `d` is the way from one to the other, `v` their
/// relative velocity. Two that do not close never meet, however close they are.
fn time_to_meet(d: Vec2, v: Vec2, reach: f64) -> f64 {
    let (gap, closing, speed2) = (d.norm_squared() - reach * reach, -d.dot(&v), v.norm_squared());
    // Who stands still relative to the other one does not close, whatever the noise of the recorder says.
    if closing <= 0.0 || speed2 < STILL * STILL {
        return f64::INFINITY;
    }
    if gap <= 0.0 {
        return 0.0;
    }
    let root = closing * closing - speed2 * gap;
    if root < 0.0 { f64::INFINITY } else { (closing - root.sqrt()) / speed2 }
}
