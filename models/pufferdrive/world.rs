//! The world of one episode as the policy's environment has it: everybody now, and everybody in a moment.

use reactsim::dynamics::Pose;
use reactsim::geometry::{Vec2, direction};
use reactsim::rollout::Observation;
use reactsim::scene::{AgentState, DT};

use super::motion::Body;
use super::network::{EGO, PARTNER};

/// Rows for partners.
pub(super) const ROWS: usize = 63;
/// Partners farther away are not seen, metres.
const SIGHT: f64 = 50.0;

/// One who is there.
#[derive(Clone, Copy, Debug)]
struct Being {
    body: Body,
    velocity: Vec2,
    length: f64,
    width: f64,
}

/// Everybody at one instant, by agent.
#[derive(Clone, Debug)]
pub(super) struct World {
    beings: Vec<Option<Being>>,
}

impl World {
    /// Everybody as realised. Whoever `stays` stands from now on.
    pub(super) fn now(seen: &Observation<'_>, stays: impl Fn(usize) -> bool) -> Self {
        let agents = &seen.start().agents;
        let being = |(i, agent): (usize, &reactsim::scene::Agent)| {
            let state = seen.state(i)?;
            let velocity = if stays(i) { Vec2::zeros() } else { state.velocity().unwrap_or_default() };
            let speed = velocity.norm().copysign(velocity.dot(&direction(state.heading)));
            let pose = Pose::from(state);
            let body = Body { pose, speed };
            Some(Being { body, velocity, length: agent.length, width: agent.width })
        };
        Self { beings: agents.iter().enumerate().map(being).collect() }
    }

    /// Where an agent is, `None` where it is absent.
    pub(super) fn body(&self, agent: usize) -> Option<Body> {
        self.beings[agent].map(|b| b.body)
    }

    /// Everybody 0.1 s later: those that drive where they have come to (`driven`, by agent), the AV where it is known to come, the others at
    /// their velocities.
    pub(super) fn advance(&mut self, driven: &[(usize, Body)], av: Option<AgentState>) {
        for (i, being) in self.beings.iter_mut().enumerate() {
            let Some(being) = being else { continue };
            if let Some((_, body)) = driven.iter().find(|(agent, _)| *agent == i) {
                being.velocity = (body.pose.position - being.body.pose.position) / DT;
                being.body = *body;
            } else if let (0, Some(next)) = (i, av) {
                let pose = Pose::from(next);
                being.velocity = (pose.position - being.body.pose.position) / DT;
                let along = being.velocity.dot(&direction(next.heading));
                being.body = Body { pose, speed: being.velocity.norm().copysign(along) };
            } else {
                being.body.pose.position += being.velocity * DT;
            }
        }
    }

    /// The state of an agent, where it is.
    pub(super) fn state(&self, agent: usize) -> Option<AgentState> {
        let Being { body, velocity, .. } = self.beings[agent]?;
        let Pose { position, heading } = body.pose;
        Some(AgentState { x: position.x, y: position.y, heading, vx: velocity.x, vy: velocity.y })
    }

    /// Fills the rows of a vehicle that makes for `goal`, which are zero before: its own, and those of its partners.
    pub(super) fn fill(&self, agent: usize, goal: Vec2, ego: &mut [f32], partners: &mut [f32]) {
        let Some(own) = self.beings[agent] else { return };
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
        let others = self.beings.iter().enumerate().filter(|(i, _)| *i != agent).filter_map(|(_, b)| *b);
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
