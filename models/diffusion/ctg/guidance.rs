//! Rules that guide sampling: costs of joint motion with their gradients.

mod collision;
mod guide;
mod others;
mod road;
mod speed;
#[cfg(test)]
mod tests;

use collision::Discs;
use reactsim_geometry::Vec2;
use reactsim_scene::AgentState;
use serde::{Deserialize, Serialize};

pub(super) use guide::RuleGuide;
pub(super) use others::others;

use super::raster::Ground;

/// Weights of the rules; 0 switches a rule off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Weight of collisions between agents.
    pub collision: f64,
    /// Weight of leaving the drivable area.
    pub road: f64,
    /// Weight of driving faster than the speed limit.
    pub speed: f64,
}

impl Rules {
    /// Returns whether any rule is on.
    pub(super) fn any(&self) -> bool {
        [self.collision, self.road, self.speed].iter().any(|weight| *weight > 0.0)
    }
}

/// The scene that rules judge.
#[derive(Clone, Debug)]
pub(super) struct RuleScene<'a> {
    pub(super) rules: Rules,
    pub(super) agents: Vec<RuleAgent>,
    /// Agents that are not planned.
    pub(super) others: Vec<Other>,
    pub(super) ground: &'a Ground,
    /// Time between two states, seconds.
    pub(super) dt: f64,
}

/// An agent that is guided.
#[derive(Clone, Copy, Debug)]
pub(super) struct RuleAgent {
    /// Length and width, metres.
    pub(super) size: [f64; 2],
    /// Whether speed limits are for it.
    pub(super) is_vehicle: bool,
    /// Whether it was on the drivable area.
    pub(super) on_road: bool,
}

/// An agent that is not planned.
#[derive(Clone, Debug)]
pub(super) struct Other {
    /// Its discs after each step.
    discs: Vec<Discs>,
}

impl Other {
    /// Describes an agent of this length and width, metres, by its states after each step.
    pub(super) fn of(size: [f64; 2], states: &[AgentState]) -> Self {
        Self { discs: states.iter().map(|state| Discs::of(state.position(), state.heading, size)).collect() }
    }
}

/// A state in a plan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    /// Position, metres.
    pub(super) at: Vec2,
    /// Heading, radians.
    pub(super) heading: f64,
    /// Velocity, m/s.
    pub(super) velocity: Vec2,
}

/// Speed in m/s above which agents are guided (published, for the current speed).
const MOVING_SPEED: f64 = 0.5;

/// Costs of an agent's plan, and their derivatives by its states.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cost {
    pub(super) value: f64,
    /// By state: derivatives by position, heading and velocity.
    pub(super) gradient: Vec<Motion>,
}

impl Cost {
    fn nothing(states: usize) -> Self {
        Self { value: 0.0, gradient: vec![Motion::default(); states] }
    }
}

impl RuleScene<'_> {
    /// Returns the costs of each agent under joint motion: states by agent, then step. Agents whose plan is
    /// to stand pay nothing: they cannot do anything about it, and those that move pay for both.
    pub(super) fn costs(&self, motion: &[Vec<Motion>]) -> Vec<Cost> {
        let mut costs: Vec<Cost> = motion.iter().map(|own| Cost::nothing(own.len())).collect();
        let is_fast = |state: &Motion| state.velocity.norm() > MOVING_SPEED;
        let moves: Vec<bool> = motion.iter().map(|own| own.iter().any(is_fast)).collect();
        if self.rules.collision > 0.0 {
            collision::add(self, motion, &moves, &mut costs);
        }
        let agents = self.agents.iter().zip(motion).zip(&mut costs);
        for (((agent, own), cost), _) in agents.zip(&moves).filter(|(_, moves)| **moves) {
            if self.rules.road > 0.0 && agent.on_road {
                road::add(self, agent, own, cost);
            }
            if self.rules.speed > 0.0 && agent.is_vehicle {
                speed::add(self, own, cost);
            }
        }
        costs
    }
}
