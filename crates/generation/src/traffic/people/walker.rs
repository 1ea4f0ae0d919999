//! A single pedestrian: properties drawn once, and changing state.

use rand::{RngExt, SeedableRng};
use reactsim_geometry::{Vec2, left};
use reactsim_rollout::Stream;

use super::network::Stretch;
use crate::Draw;

/// Share of people who are old.
const OLD_SHARE: f64 = 0.12;
/// Walking speed of old people relative to others. Knoblauch, Pietrucha & Nitzburg, *Field studies of
/// pedestrian walking speed and start-up time* (TRR 1538, 1996): means of 1.51 m/s below 65 years and 1.25
/// m/s above.
const OLD_SPEED_FACTOR: f64 = 0.83;
/// Share of people who run. In the recording (see the module) one walker in a hundred moves faster than 2.5
/// m/s.
const RUNNER_SHARE: f64 = 0.012;
/// Minimum speed of runners, m/s.
const RUNNER_SPEED_MIN: f64 = 2.3;
/// Maximum speed of runners, m/s.
const RUNNER_SPEED_MAX: f64 = 3.2;
/// Slowdown of a group per further companion, m/s (Moussaïd et al. 2010 found a linear decrease with the
/// size).
const COMPANION_SLOWDOWN: f64 = 0.06;
/// Standard deviation of the slow wander of the desired speed, as a share of it.
const SPEED_WANDER: f64 = 0.05;
/// Standard deviation of the slow wander of the lateral position, metres.
const SIDE_WANDER: f64 = 0.12;
/// Time, seconds, after which a blocked pedestrian tries to get round.
const DETOUR_TIME: f64 = 0.8;
/// Share of a wander value that is left after one second.
const WANDER_RETENTION: f64 = 0.8;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Activity {
    /// Walks to the goal.
    Walking,
    /// Stands for the remaining time in seconds.
    Standing(f64),
}

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
    /// Time spent looking before stepping off the kerb, seconds.
    pub(super) reaction: f64,
    /// Preferred lateral position: -1 for the right edge in walking direction, 1 for the left edge.
    pub(super) side: f64,
    pub(super) activity: Activity,
    pub(super) stretch: usize,
    /// Segment of the stretch's line.
    pub(super) segment: usize,
    /// Arc length on that line, metres.
    pub(super) s: f64,
    /// Whether the pedestrian walks along the direction of the stretch's line.
    pub(super) forward: bool,
    /// Index into the goals.
    pub(super) goal: usize,
    /// The previous stretch.
    pub(super) before: Option<usize>,
    /// Time for which stepping off has looked possible, seconds; from `reaction` on the pedestrian steps
    /// off.
    pub(super) looked: f64,
    /// Time for which the pedestrian has wanted to walk but could not, seconds; decreases again with
    /// progress.
    stuck: f64,
    /// Side on which the pedestrian tries to get round: +1 left, -1 right.
    detour: f64,
    pub(super) group: u64,
    /// Place in the group, 0 for the leading member.
    pub(super) rank: usize,
    wander: [f64; 2],
    next_wander: f64,
    rng: Stream,
}

impl Walker {
    /// Draws a group of one to three people who walk alike (Coleman & James, *The equilibrium size
    /// distribution of freely-forming groups*, Sociometry 24, 1961: a Poisson distribution without zero;
    /// here with a mean before truncation of 0.9). They have no position yet.
    pub(super) fn group(first_id: u64, rng: &mut Stream) -> Vec<Self> {
        let size = 1 + rng.weighted(&[0.62, 0.28, 0.10]);
        let run = size == 1 && rng.chance(RUNNER_SHARE);
        let side = side(rng);
        let members: Vec<Self> = (0..size)
            .map(|rank| {
                let old = rng.chance(OLD_SHARE);
                let speed =
                    rng.normal_within(1.34, 0.26, 0.7, 2.1) * if old { OLD_SPEED_FACTOR } else { 1.0 };
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
                    desired_speed: if run { rng.uniform(RUNNER_SPEED_MIN, RUNNER_SPEED_MAX) } else { speed },
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
        let common = (mean - COMPANION_SLOWDOWN * (size - 1) as f64).max(0.6);
        members.into_iter().map(|m| Self { desired_speed: common, ..m }).collect()
    }

    /// Returns +1 along the line of the stretch, -1 against it.
    pub(super) fn sign(&self) -> f64 {
        if self.forward { 1.0 } else { -1.0 }
    }

    /// Returns the speed desired now, m/s.
    pub(super) fn pace(&self) -> f64 {
        self.desired_speed * (1.0 + SPEED_WANDER * self.wander[0])
    }

    /// Returns the preferred lateral position on a stretch, metres to the left of its line.
    pub(super) fn offset(&self, stretch: &Stretch, forward: bool) -> f64 {
        let half = stretch.half;
        // On crossings everybody keeps right, so that waiting people leave room for those who come.
        let side = if stretch.crossing.is_some() { 0.35 * self.side - 0.65 } else { self.side };
        // Companions walk abreast where there is room, otherwise one behind the other.
        let abreast = if side < 0.0 { 1.0 } else { -1.0 } * self.rank as f64 * COMPANION_SPACING;
        let own = side * half;
        let left_most = if stretch.crossing.is_some() { -0.25 * half } else { half };
        let both = own + abreast;
        let beside = if both >= -half && both <= left_most { both } else { own };
        let wander = SIDE_WANDER * self.wander[1] * (half / 0.75).min(1.0);
        (if forward { 1.0 } else { -1.0 }) * (beside + wander).clamp(-half, left_most)
    }

    /// Returns the distance at which a companion without room next to the leading member follows, metres.
    pub(super) fn lag(&self, half: f64) -> f64 {
        let abreast = (self.side.abs() * half - self.rank as f64 * COMPANION_SPACING).abs() <= half;
        if abreast { 0.0 } else { 1.15 * self.rank as f64 }
    }

    /// Advances the wander of desired speed and lateral position.
    pub(super) fn update_wander(&mut self, dt: f64) {
        self.next_wander -= dt;
        if self.next_wander <= 0.0 {
            self.next_wander += 1.0;
            let fresh = (1.0 - WANDER_RETENTION * WANDER_RETENTION).sqrt();
            for value in &mut self.wander {
                *value = WANDER_RETENTION * *value + fresh * self.rng.normal();
            }
        }
        // If one side does not work, try the other.
        if self.stuck > 3.0 {
            self.stuck = DETOUR_TIME;
            self.detour = -self.detour;
        }
    }

    /// Updates for how long a pedestrian who wants to walk has been blocked.
    pub(super) fn update_progress(&mut self, wants: bool, dt: f64) {
        let held_up = wants && self.velocity.norm_squared() < 0.04;
        self.stuck = if held_up { self.stuck + dt } else { (self.stuck - 0.7 * dt).max(0.0) };
    }

    /// Returns the walking direction: sideways if the pedestrian has been blocked for a while.
    pub(super) fn detour_direction(&self, towards: Vec2) -> Vec2 {
        if self.stuck > DETOUR_TIME { towards * 0.4 + left(towards) * (0.9 * self.detour) } else { towards }
    }

    pub(super) fn rng(&mut self) -> &mut Stream {
        &mut self.rng
    }
}

/// Lateral distance between companions, metres: as small as boxes that must not touch allow (Moussaïd et
/// al. 2010 fitted 0.8 m).
const COMPANION_SPACING: f64 = 1.1;

/// Draws a lateral position: mostly on the right, as people in the USA keep right when they meet.
pub(super) fn side(rng: &mut Stream) -> f64 {
    rng.normal_within(-0.55, 0.35, -1.0, 0.9)
}

/// Returns the radius of the circle around a box whose corners are rounded as in the collision metric (0.7
/// of half the smaller extent).
fn rounded_radius(length: f64, width: f64) -> f64 {
    let round = 0.35 * length.min(width);
    let (x, y) = (0.5 * length - round, 0.5 * width - round);
    (x * x + y * y).sqrt() + round
}
