//! What is in the way of an agent: others on its own course and on the ways that its lane leads, now and soon, and where to stop.

use reactsim::geometry::{Vec2, into_frame};
use reactsim::scene::LightState;

use super::body::Body;
use super::lane::{SPACING, WAYS, Way};
use super::place::{Place, Role};

/// Numbers that describe what is in the way.
pub(crate) const CORRIDOR: usize = (1 + WAYS) * EACH;
/// Numbers of one way.
const EACH: usize = TIMES.len() * PER_TIME + PER_STOP;
/// When others are looked at, seconds from now; they go on as they move now.
const TIMES: [f64; 3] = [0.0, 1.0, 2.0];
const PER_TIME: usize = 7;
const PER_STOP: usize = 8;
/// Room on both sides that is wanted beside boxes, metres.
const CLEARANCE: f64 = 0.2;
/// A gap that stands for none, metres.
const FREE: f64 = 60.0;
/// A stop belongs to a way that passes it this near, metres.
const STOP_ASIDE: f64 = 2.0;

/// Fills in, per way and time, the gap to the nearest other agent in it, its speed along the way, whether it is the AV, and what a driver
/// goes by; and per way the nearest stop. Zeros for ways that are not there.
pub(crate) fn describe(
    bodies: &[Body],
    own: usize,
    ways: &[Way],
    places: &[Place],
    lights: &[Option<LightState>],
    out: &mut [f32],
) {
    let me = &bodies[own];
    for (w, way) in ways.iter().enumerate() {
        // Most lanes lead one way for a while.
        if let Some(same) = ways[..w].iter().position(|other| other == way) {
            out.copy_within(same * EACH..(same + 1) * EACH, w * EACH);
            continue;
        }
        let out = &mut out[w * EACH..(w + 1) * EACH];
        for (t, time) in TIMES.into_iter().enumerate() {
            let mut nearest = (FREE, 0.0, false);
            for other in bodies.iter().enumerate().filter(|(j, _)| *j != own).map(|(_, b)| b) {
                if let Some(found) = ahead_of(me, other, time, way)
                    && found.0 < nearest.0
                {
                    nearest = (found.0, found.1, other.is_av);
                }
            }
            let (gap, speed, is_av) = nearest;
            let slot = &mut out[t * PER_TIME..][..PER_TIME];
            slot[0] = if gap < FREE { (1.0 / (1.0 + gap.max(0.0) / 4.0)) as f32 } else { 0.0 };
            slot[1] = (gap / 30.0) as f32;
            slot[2] = (speed / 10.0) as f32;
            slot[3] = f32::from(u8::from(is_av));
            if gap < FREE {
                // What a driver goes by: time gap, time to contact, and the braking that it takes.
                let (room, own) = (gap.max(0.5), me.velocity.dot(&me.ahead).max(0.0));
                let closing = (own - speed).max(0.0);
                slot[4] = (1.0 / (0.5 + room / own.max(0.5))) as f32;
                slot[5] = (closing / room).min(2.0) as f32;
                slot[6] = (closing * closing / (2.0 * room) / 4.0).min(3.0) as f32;
            }
        }
        let stops = places.iter().filter(|p| p.role == Role::Stop);
        let nearest = stops
            .filter_map(|p| stop_ahead(p, way).map(|d| (d - me.half.x, p)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let slot = &mut out[TIMES.len() * PER_TIME..];
        if let Some((distance, stop)) = nearest {
            let shown = stop.light.and_then(|l| lights.get(l).copied().flatten());
            let is = |f: fn(LightState) -> bool| f32::from(u8::from(shown.is_some_and(f)));
            let speed = me.velocity.dot(&me.ahead).max(0.0);
            slot[0] = 1.0;
            slot[1] = (distance / 30.0) as f32;
            slot[2] = (1.0 / (1.0 + distance.max(0.0) / 4.0)) as f32;
            slot[3] = is(LightState::is_red);
            slot[4] = is(LightState::is_yellow);
            slot[5] = is(|l| matches!(l, LightState::Go | LightState::ArrowGo));
            slot[6] = f32::from(u8::from(stop.light.is_some()));
            slot[7] = (speed * speed / (2.0 * distance.max(0.5)) / 4.0).min(3.0) as f32;
        }
    }
}

/// The gap along a way to another agent and its speed along it, if its box will be in the way then. Gaps may be negative.
fn ahead_of(me: &Body, other: &Body, time: f64, way: &Way) -> Option<(f64, f64)> {
    let at = other.position + other.velocity * time;
    // Most are nowhere near.
    if !way.bounds.inflated(me.half.y + other.half.x + other.half.y + CLEARANCE + SPACING).contains(at) {
        return None;
    }
    let (mut best, mut nearest) = (f64::INFINITY, 0);
    for (i, (p, _)) in way.points.iter().enumerate() {
        let d2 = (at - p).norm_squared();
        if d2 < best {
            (best, nearest) = (d2, i);
        }
    }
    let (p, along) = way.points[nearest];
    let local = into_frame(along, at - p);
    let turned = into_frame(along, other.ahead);
    let aside = turned.y.abs() * other.half.x + turned.x.abs() * other.half.y;
    let reach = turned.x.abs() * other.half.x + turned.y.abs() * other.half.y;
    let s = nearest as f64 * SPACING + local.x;
    let last = (way.points.len() - 1) as f64 * SPACING;
    let beyond = s > last + reach || s < 0.0;
    if beyond || local.y.abs() > me.half.y + aside + CLEARANCE {
        return None;
    }
    Some((s - reach - me.half.x, other.velocity.dot(&along)))
}

/// How far along a way a stop is, metres.
fn stop_ahead(stop: &Place, way: &Way) -> Option<f64> {
    let found = way.points.iter().enumerate().find(|(_, (p, along))| {
        let local: Vec2 = into_frame(*along, stop.start - p);
        local.x.abs() <= 0.5 * SPACING + 1e-9 && local.y.abs() < STOP_ASIDE && along.dot(&stop.ahead) > 0.5
    });
    found.map(|(i, (p, along))| i as f64 * SPACING + into_frame(*along, stop.start - p).x)
}
