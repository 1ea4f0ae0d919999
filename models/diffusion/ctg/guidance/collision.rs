//! No collisions: agents are rows of discs, which keep a distance.

use reactsim_geometry::{Vec2, direction, left, math};

use super::{Cost, Motion, RuleScene};

/// Discs of an agent (published).
const DISCS: usize = 5;
/// Distance that discs keep, metres (published).
const BUFFER: f64 = 0.2;
/// Factor by which a cost counts less per second (published: 0.9 per step of 0.1 s).
const DECAY_PER_SECOND: f64 = 0.9;

/// Adds the costs of collisions to the agents that move: for each pair of discs that come too close 1 - d /
/// d_min.
pub(super) fn add(scene: &RuleScene<'_>, motion: &[Vec<Motion>], moves: &[bool], costs: &mut [Cost]) {
    for step in 0..motion.iter().map(Vec::len).min().unwrap_or(0) {
        let weight = scene.rules.collision * math::pow(DECAY_PER_SECOND, (step + 1) as f64 * scene.dt);
        let agents = motion.iter().zip(&scene.agents);
        let discs: Vec<Discs> =
            agents.map(|(own, agent)| Discs::of(own[step].at, own[step].heading, agent.size)).collect();
        for (i, own) in discs.iter().enumerate() {
            let mut pay = |agent: usize, value: f64, by: &Motion| {
                if moves[agent] {
                    let cost = &mut costs[agent];
                    cost.value += weight * value;
                    cost.gradient[step].at += by.at * weight;
                    cost.gradient[step].heading += by.heading * weight;
                }
            };
            for (j, other) in discs.iter().enumerate().skip(i + 1).filter(|(_, other)| own.is_near(other)) {
                let (value, by) = own.cost(other);
                pay(i, value, &by[0]);
                pay(j, value, &by[1]);
            }
            let others = scene.others.iter().filter_map(|other| other.discs.get(step));
            for other in others.filter(|other| own.is_near(other)) {
                let (value, by) = own.cost(other);
                pay(i, value, &by[0]);
            }
        }
    }
}

/// The discs of an agent.
#[derive(Clone, Debug)]
pub(super) struct Discs {
    centers: [Vec2; DISCS],
    /// Derivative of each centre by the heading.
    turns: [Vec2; DISCS],
    radius: f64,
    pub(super) center: Vec2,
    reach: f64,
}

impl Discs {
    /// Describes an agent at this position and heading by its length and width, metres.
    pub(super) fn of(center: Vec2, heading: f64, [length, width]: [f64; 2]) -> Self {
        let (radius, axis) = (0.5 * width, direction(heading));
        // The outermost discs end where the box does.
        let half = (0.5 * length - radius).max(0.0);
        let along = |k: usize| half * (2.0 * k as f64 / (DISCS - 1) as f64 - 1.0);
        Self {
            centers: std::array::from_fn(|k| center + axis * along(k)),
            turns: std::array::from_fn(|k| left(axis) * along(k)),
            radius,
            center,
            reach: half + radius,
        }
    }

    /// Returns whether some of the discs may be too close; not if a state is not a number.
    fn is_near(&self, other: &Self) -> bool {
        (self.center - other.center).norm() <= self.reach + other.reach + BUFFER
    }

    /// Returns the cost of two agents, and its derivatives by the states of each.
    fn cost(&self, other: &Self) -> (f64, [Motion; 2]) {
        let mut on = [Motion::default(); 2];
        let mut value = 0.0;
        let least = self.radius + other.radius + BUFFER;
        for (p, turn_p) in self.centers.iter().zip(&self.turns) {
            for (q, turn_q) in other.centers.iter().zip(&other.turns) {
                let apart = p - q;
                let distance = apart.norm();
                if distance >= least {
                    continue;
                }
                value += 1.0 - distance / least;
                // Discs on top of each other have no direction in which to part.
                let away = apart.try_normalize(1e-9).unwrap_or_default() * (-1.0 / least);
                on[0].at += away;
                on[0].heading += away.dot(turn_p);
                on[1].at -= away;
                on[1].heading -= away.dot(turn_q);
            }
        }
        (value, on)
    }
}
