//! State of one episode in the policy's environment: all agents now, and during a plan.

use reactsim_geometry::{Vec2, direction};
use reactsim_rollout::Observation;
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{AgentState, DT};

use super::motion::Body;
use super::network::{EGO, PARTNER};

/// Number of rows for partners.
pub(super) const ROWS: usize = 63;
/// Distance in metres within which partners are observed.
const SIGHT: f64 = 50.0;

/// A present agent.
#[derive(Clone, Copy, Debug)]
struct PresentAgent {
    body: Body,
    velocity: Vec2,
    length: f64,
    width: f64,
}

/// All agents at one instant, by index.
#[derive(Clone, Debug)]
pub(super) struct World {
    agents: Vec<Option<PresentAgent>>,
}

impl World {
    /// Takes all agents as realised. Agents for which `stays` is true stand from now on.
    pub(super) fn now(seen: &Observation<'_>, stays: impl Fn(usize) -> bool) -> Self {
        let agents = &seen.start().agents;
        let agent_state = |(i, agent): (usize, &reactsim_scene::Agent)| {
            let state = seen.state(i)?;
            let velocity = if stays(i) { Vec2::zeros() } else { state.velocity().unwrap_or_default() };
            let speed = velocity.norm().copysign(velocity.dot(&direction(state.heading)));
            let pose = Pose::from(state);
            let body = Body { pose, speed };
            Some(PresentAgent { body, velocity, length: agent.length, width: agent.width })
        };
        Self { agents: agents.iter().enumerate().map(agent_state).collect() }
    }

    /// Returns the state of an agent; `None` if it is absent.
    pub(super) fn body(&self, agent: usize) -> Option<Body> {
        self.agents[agent].map(|b| b.body)
    }

    /// Advances all agents by 0.1 s: those in `driven` (by agent index) to the given states, the AV to
    /// its next state if known, the others at their velocities.
    pub(super) fn advance(&mut self, driven: &[(usize, Body)], av: Option<AgentState>) {
        for (i, agent_state) in self.agents.iter_mut().enumerate() {
            let Some(agent_state) = agent_state else { continue };
            if let Some((_, body)) = driven.iter().find(|(agent, _)| *agent == i) {
                agent_state.velocity = (body.pose.position - agent_state.body.pose.position) / DT;
                agent_state.body = *body;
            } else if let (0, Some(next)) = (i, av) {
                let pose = Pose::from(next);
                agent_state.velocity = (pose.position - agent_state.body.pose.position) / DT;
                let along = agent_state.velocity.dot(&direction(next.heading));
                agent_state.body = Body { pose, speed: agent_state.velocity.norm().copysign(along) };
            } else {
                agent_state.body.pose.position += agent_state.velocity * DT;
            }
        }
    }

    /// Returns the state of an agent for a plan; `None` if it is absent.
    pub(super) fn state(&self, agent: usize) -> Option<AgentState> {
        let PresentAgent { body, velocity, .. } = self.agents[agent]?;
        let Pose { position, heading } = body.pose;
        Some(AgentState { x: position.x, y: position.y, heading, vx: velocity.x, vy: velocity.y })
    }

    /// Fills the rows of a vehicle that heads for `goal`: its own, and those of its partners. The rows
    /// must be zero before.
    pub(super) fn fill(&self, agent: usize, goal: Vec2, ego: &mut [f32], partners: &mut [f32]) {
        let Some(own) = self.agents[agent] else { return };
        let Pose { position, heading } = own.body.pose;
        let ahead = direction(heading);
        let to = goal - position;
        let numbers: [f64; EGO] = [
            ahead.dot(&to) * 0.005,
            ahead.perp(&to) * 0.005,
            own.body.speed / 100.0,
            own.width / 15.0,
            own.length / 30.0,
            0.0,
            0.0,
        ];
        write(&numbers, ego);
        let others = self.agents.iter().enumerate().filter(|(i, _)| *i != agent).filter_map(|(_, b)| *b);
        let near = others.filter(|b| (b.body.pose.position - position).norm() < SIGHT);
        for (row, other) in partners.chunks_exact_mut(PARTNER).zip(near) {
            let to = other.body.pose.position - position;
            let facing = direction(other.body.pose.heading);
            let numbers: [f64; PARTNER] = [
                ahead.dot(&to) * 0.02,
                ahead.perp(&to) * 0.02,
                other.width / 15.0,
                other.length / 30.0,
                ahead.dot(&facing),
                ahead.perp(&facing),
                other.body.speed / 100.0,
            ];
            write(&numbers, row);
        }
    }
}

fn write(numbers: &[f64], row: &mut [f32]) {
    for (place, number) in row.iter_mut().zip(numbers) {
        *place = *number as f32;
    }
}
