//! Relations between agents at the same step.

use reactsim_geometry::{Vec2, into_frame};
use reactsim_nn::perception::{Body, put};

/// Number of features of the relation between two agents.
pub(crate) const PAIR_FEATURES: usize = 29;

/// Prediction horizon, seconds.
const HORIZON: f64 = 6.0;

/// Writes the relation of `other` to `me`, in the frame of `me`: position, heading, relative motion,
/// gaps between the boxes, time to contact, closest approach, and which agent reaches the crossing of
/// the two straight paths first.
pub(crate) fn relate(me: &Body, other: &Body, out: &mut [f32]) {
    let apart = into_frame(me.ahead, other.position - me.position);
    let toward = into_frame(me.ahead, other.ahead);
    let own = into_frame(me.ahead, me.velocity);
    let theirs = into_frame(me.ahead, other.velocity);
    let relative = theirs - own;
    let distance = apart.norm().max(1e-3);
    let closing = -apart.dot(&relative) / distance;
    // Gaps along and across my heading, between my box and the bounding box of theirs.
    let reach = Vec2::new(
        toward.x.abs() * other.half.x + toward.y.abs() * other.half.y,
        toward.y.abs() * other.half.x + toward.x.abs() * other.half.y,
    );
    let gap = Vec2::new(apart.x.abs() - me.half.x - reach.x, apart.y.abs() - me.half.y - reach.y);
    let between = Vec2::new(gap.x.max(0.0), gap.y.max(0.0)).norm();
    let approach = -relative.x * apart.x.signum();
    let contact = if gap.y < 0.3 && approach > 0.05 { gap.x.max(0.0) / approach } else { HORIZON };
    let (nearest_time, nearest) = nearest_approach(apart, relative);
    let crossing = Crossing::of(apart, toward, own.x, theirs.dot(&toward));

    put(
        out,
        [
            apart.x / 30.0,
            apart.y / 30.0,
            distance / 30.0,
            apart.x / distance,
            apart.y / distance,
            toward.x,
            toward.y,
            relative.x / 10.0,
            relative.y / 10.0,
            closing / 10.0,
            theirs.dot(&toward) / 10.0,
            other.acceleration / 4.0,
            1.0 / (1.0 + between),
            1.0 / (1.0 + gap.x.max(0.0)),
            1.0 / (1.0 + gap.y.max(0.0)),
            (gap.y / 5.0).clamp(-1.0, 2.0),
            if gap.y < 0.3 { apart.x.signum() } else { 0.0 },
            1.0 / (0.5 + contact.min(HORIZON)),
            nearest_time / HORIZON,
            1.0 / (1.0 + (nearest - me.half.y - other.half.y).max(0.0)),
            f64::from(u8::from(crossing.exists)),
            crossing.mine / HORIZON,
            crossing.theirs / HORIZON,
            ((crossing.theirs - crossing.mine) / 3.0).clamp(-2.0, 2.0),
            crossing.distance / 30.0,
            other.half.x / 2.5,
            other.half.y,
            f64::from(u8::from(other.is_av)),
            1.0,
        ],
    );
}

/// Returns time (s) and distance (m) of the closest approach of two points at constant velocity.
fn nearest_approach(apart: Vec2, relative: Vec2) -> (f64, f64) {
    let speed2 = relative.norm_squared();
    let time = if speed2 > 1e-4 { (-apart.dot(&relative) / speed2).clamp(0.0, HORIZON) } else { 0.0 };
    (time, (apart + relative * time).norm())
}

/// Crossing of two straight paths ahead of both agents, in the frame of the first.
struct Crossing {
    exists: bool,
    /// Arrival time of the first agent, seconds; the horizon if there is no crossing.
    mine: f64,
    /// Arrival time of the other agent, seconds.
    theirs: f64,
    /// Distance of the first agent from the crossing, metres.
    distance: f64,
}

impl Crossing {
    fn of(apart: Vec2, toward: Vec2, own: f64, theirs: f64) -> Self {
        let none = Self { exists: false, mine: HORIZON, theirs: HORIZON, distance: 30.0 };
        // My path is the x axis: apart + toward * t = (s, 0).
        if toward.y.abs() < 0.1 {
            return none;
        }
        let t = -apart.y / toward.y;
        let s = apart.x + toward.x * t;
        if !(0.0..=80.0).contains(&s) || !(0.0..=80.0).contains(&t) {
            return none;
        }
        let arrival =
            |distance: f64, speed: f64| if speed > 0.2 { (distance / speed).min(HORIZON) } else { HORIZON };
        Self { exists: true, mine: arrival(s, own), theirs: arrival(t, theirs), distance: s.min(60.0) }
    }
}
