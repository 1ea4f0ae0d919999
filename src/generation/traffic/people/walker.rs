//! One person: what is drawn once, and what changes.

use rand::{RngExt, SeedableRng};

use super::network::Stretch;
use crate::generation::Draw;
use crate::geometry::{Vec2, left};
use crate::rollout::Stream;

/// Share of people who are old, and how much slower they walk. Knoblauch, Pietrucha & Nitzburg, *Field studies of pedestrian walking
/// speed and start-up time* (TRR 1538, 1996): means of 1.51 m/s below 65 years and 1.25 m/s above.
const OLD: (f64, f64) = (0.12, 0.83);
/// Share of people who run, and their speeds, m/s. In the recording (see the module) one walker in a hundred moves faster than 2.5 m/s.
const RUNNERS: (f64, f64, f64) = (0.012, 2.3, 3.2);
/// How much slower each further companion makes a group, m/s (Moussaïd et al. 2010 saw it fall linearly with the size).
const COMPANION: f64 = 0.06;
/// Deviation of the slow wander of the desired speed (a share of it), and of the place beside the line (metres).
const WANDER: (f64, f64) = (0.05, 0.12);
/// Who is held up for so long tries to get round, seconds.
const DETOUR_AFTER: f64 = 0.8;
/// What of a wander is left after a second.
const WANDER_KEPT: f64 = 0.8;

/// What somebody does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Activity {
    /// Walks to the goal.
    Walking,
    /// Stands for so many seconds.
    Standing(f64),
}

/// A person.
#[derive(Clone, Debug)]
pub(super) struct Walker {
    pub(super) id: u64,
    pub(super) position: Vec2,
    pub(super) velocity: Vec2,
    /// Unit vector.
    pub(super) facing: Vec2,
    pub(super) length: f64,
    pub(super) width: f64,
    /// Radius of the circle around the box with rounded corners, metres.
    pub(super) radius: f64,
    pub(super) desired_speed: f64,
    /// How long somebody looks before stepping off, seconds.
    pub(super) reaction: f64,
    /// Place beside the line: -1 the right edge as it walks, 1 the left edge.
    pub(super) side: f64,
    pub(super) activity: Activity,
    /// Stretch, segment of its line, arc length on it.
    pub(super) stretch: usize,
    pub(super) segment: usize,
    pub(super) s: f64,
    /// Whether it walks along the line of the stretch.
    pub(super) forward: bool,
    /// Index into the goals.
    pub(super) goal: usize,
    /// The stretch that was left last.
    pub(super) before: Option<usize>,
    /// For how long stepping off has looked possible, seconds; steps off from `reaction` on.
    pub(super) looked: f64,
    /// For how long it has wanted to walk and could not, seconds; falls again as it gets on.
    stuck: f64,
    /// The side on which it tries to get round then: +1 left, -1 right.
    detour: f64,
    /// Number of the group and place in it, 0 for who leads.
    pub(super) group: u64,
    pub(super) rank: usize,
    wander: [f64; 2],
    next_wander: f64,
    rng: Stream,
}

impl Walker {
    /// A group of one to three who walk alike (Coleman & James, *The equilibrium size distribution of freely-forming groups*, Sociometry 24,
    /// 1961: a Poisson distribution without zero; here with a mean before truncation of 0.9). They stand nowhere yet.
    pub(super) fn group(first_id: u64, rng: &mut Stream) -> Vec<Self> {
        let size = 1 + rng.weighted(&[0.62, 0.28, 0.10]);
        let run = size == 1 && rng.chance(RUNNERS.0);
        let side = side(rng);
        let members: Vec<Self> = (0..size)
            .map(|rank| {
                let old = rng.chance(OLD.0);
                let speed = rng.normal_within(1.34, 0.26, 0.7, 2.1) * if old { OLD.1 } else { 1.0 };
                let length = rng.normal_within(0.87, 0.08, 0.68, 1.05);
                let width = rng.normal_within(0.84, 0.07, 0.66, 1.0).min(length + 0.05);
                Self {
                    id: first_id + rank as u64,
                    position: Vec2::zeros(),
                    velocity: Vec2::zeros(),
                    facing: Vec2::x(),
                    length,
                    width,
                    radius: rounded_radius(length, width),
                    desired_speed: if run { rng.uniform(RUNNERS.1, RUNNERS.2) } else { speed },
                    reaction: rng.uniform(0.2, 0.8),
                    side,
                    activity: Activity::Walking,
                    stretch: 0,
                    segment: 0,
                    s: 0.0,
                    forward: true,
                    goal: 0,
                    before: None,
                    looked: 0.0,
                    stuck: 0.0,
                    detour: -1.0,
                    group: first_id,
                    rank,
                    wander: [rng.normal(), rng.normal()],
                    next_wander: rng.uniform(0.0, 1.0),
                    rng: Stream::seed_from_u64(rng.random()),
                }
            })
            .collect();
        let mean = members.iter().map(|m| m.desired_speed).sum::<f64>() / size as f64;
        let common = (mean - COMPANION * (size - 1) as f64).max(0.6);
        members.into_iter().map(|m| Self { desired_speed: common, ..m }).collect()
    }

    /// +1 along the line of the stretch, -1 against it.
    pub(super) fn sign(&self) -> f64 {
        if self.forward { 1.0 } else { -1.0 }
    }

    /// The speed that it would like now, m/s.
    pub(super) fn pace(&self) -> f64 {
        self.desired_speed * (1.0 + WANDER.0 * self.wander[0])
    }

    /// Where beside the line of a stretch it would like to walk, metres to the left of the line.
    pub(super) fn offset(&self, stretch: &Stretch, forward: bool) -> f64 {
        let half = stretch.half;
        // On crossings everybody keeps right, so that those who wait leave room for those who come.
        let side = if stretch.crossing.is_some() { 0.35 * self.side - 0.65 } else { self.side };
        // Companions walk abreast where there is room, else one behind the other.
        let abreast = if side < 0.0 { 1.0 } else { -1.0 } * self.rank as f64 * ABREAST;
        let own = side * half;
        let left_most = if stretch.crossing.is_some() { -0.25 * half } else { half };
        let both = own + abreast;
        let beside = if both >= -half && both <= left_most { both } else { own };
        let wander = WANDER.1 * self.wander[1] * (half / 0.75).min(1.0);
        (if forward { 1.0 } else { -1.0 }) * (beside + wander).clamp(-half, left_most)
    }

    /// Whether companions find room beside the one who leads.
    pub(super) fn abreast(&self, half: f64) -> bool {
        (self.side.abs() * half - self.rank as f64 * ABREAST).abs() <= half
    }

    /// Lets wishes wander.
    pub(super) fn live(&mut self, dt: f64) {
        self.next_wander -= dt;
        if self.next_wander <= 0.0 {
            self.next_wander += 1.0;
            let fresh = (1.0 - WANDER_KEPT * WANDER_KEPT).sqrt();
            for value in &mut self.wander {
                *value = WANDER_KEPT * *value + fresh * self.rng.normal();
            }
        }
        // Who does not get round on one side tries the other.
        if self.stuck > 3.0 {
            self.stuck = DETOUR_AFTER;
            self.detour = -self.detour;
        }
    }

    /// Keeps book of whether it gets on, wanting to walk.
    pub(super) fn gets_on(&mut self, wants: bool, dt: f64) {
        let held_up = wants && self.velocity.norm_squared() < 0.04;
        self.stuck = if held_up { self.stuck + dt } else { (self.stuck - 0.7 * dt).max(0.0) };
    }

    /// The direction to take for one that leads to the goal: aside, where somebody has been in the way for a while.
    pub(super) fn detoured(&self, towards: Vec2) -> Vec2 {
        if self.stuck > DETOUR_AFTER { towards * 0.4 + left(towards) * (0.9 * self.detour) } else { towards }
    }

    /// Draws from the person's own stream.
    pub(super) fn rng(&mut self) -> &mut Stream {
        &mut self.rng
    }
}

/// Distance between companions who walk side by side, metres: as near as boxes that may not touch allow (Moussaïd et al. 2010 fitted
/// 0.8 m).
const ABREAST: f64 = 1.1;

/// A place beside the line: mostly on the right, as people in the USA keep right where they meet.
pub(super) fn side(rng: &mut Stream) -> f64 {
    rng.normal_within(-0.55, 0.35, -1.0, 0.9)
}

/// Radius of the circle around a box whose corners are rounded as in the collision metric (0.7 of half the lesser extent).
fn rounded_radius(length: f64, width: f64) -> f64 {
    let round = 0.35 * length.min(width);
    let (x, y) = (0.5 * length - round, 0.5 * width - round);
    (x * x + y * y).sqrt() + round
}
