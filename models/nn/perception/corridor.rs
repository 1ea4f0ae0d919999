//! Features of agents and stops on the candidate paths of an agent: its own course and the paths along
//! its lane, now and in the near future.

use reactsim_geometry::{Vec2, into_frame};
use reactsim_scene::LightState;

use super::body::Body;
use super::features::put;
use super::lane::{CandidatePath, SPACING};
use super::place::{Place, Role};
use super::view::SceneView;
use super::widths::{LOOK_AHEAD_TIMES, PATH_FEATURES, STOP_FEATURES, TIME_FEATURES};

/// Lateral clearance on both sides of boxes, metres.
const LATERAL_CLEARANCE: f64 = 0.2;
/// Gap to the next agent if the path is free, metres.
const FREE_GAP: f64 = 60.0;
/// Largest lateral distance of a stop from the path that it belongs to, metres.
const MAX_STOP_OFFSET: f64 = 2.0;

/// Fills in the features of all paths: for each path and time, the gap to the nearest other agent on it,
/// that agent's speed along the path, whether it is the AV, and car-following quantities; and for each
/// path, the nearest stop. Features of absent paths stay 0.
pub fn describe(
    bodies: &[Body],
    own: usize,
    paths: &[CandidatePath],
    places: &[Place],
    view: &SceneView<'_>,
    out: &mut [f32],
) {
    let lights = view.lights;
    let me = &bodies[own];
    for (p, path) in paths.iter().enumerate() {
        // The paths along most lanes coincide for some distance.
        if let Some(same) = paths[..p].iter().position(|other| other == path) {
            out.copy_within(same * PATH_FEATURES..(same + 1) * PATH_FEATURES, p * PATH_FEATURES);
            continue;
        }
        let out = &mut out[p * PATH_FEATURES..(p + 1) * PATH_FEATURES];
        for (t, time) in LOOK_AHEAD_TIMES.into_iter().enumerate() {
            let mut nearest = (FREE_GAP, 0.0, false);
            for other in
                bodies.iter().enumerate().filter(|(j, b)| *j != own && !view.are_apart(me, b)).map(|(_, b)| b)
            {
                if let Some(found) = ahead_of(me, other, time, path)
                    && found.0 < nearest.0
                {
                    nearest = (found.0, found.1, other.is_av);
                }
            }
            let (gap, speed, is_av) = nearest;
            let slot = &mut out[t * TIME_FEATURES..][..TIME_FEATURES];
            let nearness = if gap < FREE_GAP { 1.0 / (1.0 + gap.max(0.0) / 4.0) } else { 0.0 };
            put(slot, [nearness, gap / 30.0, speed / 10.0, f64::from(u8::from(is_av))]);
            if gap < FREE_GAP {
                // Car following: inverse time gap, inverse time to contact and required deceleration.
                let (room, own) = (gap.max(0.5), me.velocity.dot(&me.ahead).max(0.0));
                let closing = (own - speed).max(0.0);
                let inverse_time_gap = 1.0 / (0.5 + room / own.max(0.5));
                let inverse_contact_time = (closing / room).min(2.0);
                let braking = (closing * closing / (2.0 * room) / 4.0).min(3.0);
                put(&mut slot[4..], [inverse_time_gap, inverse_contact_time, braking]);
            }
        }
        let stops = places.iter().filter(|p| p.role == Role::Stop);
        let nearest = stops
            .filter_map(|p| stop_ahead(p, path).map(|d| (d - me.half.x, p)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let slot = &mut out[LOOK_AHEAD_TIMES.len() * TIME_FEATURES..];
        if let Some((distance, stop)) = nearest {
            let shown = stop.light.and_then(|l| lights.get(l).copied().flatten());
            let is = |f: fn(LightState) -> bool| f64::from(u8::from(shown.is_some_and(f)));
            let speed = me.velocity.dot(&me.ahead).max(0.0);
            let features: [f64; STOP_FEATURES] = [
                1.0,
                distance / 30.0,
                1.0 / (1.0 + distance.max(0.0) / 4.0),
                is(LightState::is_red),
                is(LightState::is_yellow),
                is(|l| matches!(l, LightState::Go | LightState::ArrowGo)),
                f64::from(u8::from(stop.light.is_some())),
                (speed * speed / (2.0 * distance.max(0.5)) / 4.0).min(3.0),
            ];
            put(slot, features);
        }
    }
}

/// Returns the gap along a path to another agent, and that agent's speed along it, if its box will be on
/// the path at that time. Gaps may be negative.
fn ahead_of(me: &Body, other: &Body, time: f64, path: &CandidatePath) -> Option<(f64, f64)> {
    let at = other.position + other.velocity * time;
    // Quick rejection of agents that are far away.
    if !path
        .bounds
        .inflated(me.half.y + other.half.x + other.half.y + LATERAL_CLEARANCE + SPACING)
        .contains(at)
    {
        return None;
    }
    let (mut best, mut nearest) = (f64::INFINITY, 0);
    for (i, (p, _)) in path.points.iter().enumerate() {
        let d2 = (at - p).norm_squared();
        if d2 < best {
            (best, nearest) = (d2, i);
        }
    }
    let (p, along) = path.points[nearest];
    let local = into_frame(along, at - p);
    let turned = into_frame(along, other.ahead);
    let aside = turned.y.abs() * other.half.x + turned.x.abs() * other.half.y;
    let reach = turned.x.abs() * other.half.x + turned.y.abs() * other.half.y;
    let s = nearest as f64 * SPACING + local.x;
    let last = (path.points.len() - 1) as f64 * SPACING;
    let beyond = s > last + reach || s < 0.0;
    if beyond || local.y.abs() > me.half.y + aside + LATERAL_CLEARANCE {
        return None;
    }
    Some((s - reach - me.half.x, other.velocity.dot(&along)))
}

/// Returns the arc length of a stop along a path, metres.
fn stop_ahead(stop: &Place, path: &CandidatePath) -> Option<f64> {
    let found = path.points.iter().enumerate().find(|(_, (p, along))| {
        let local: Vec2 = into_frame(*along, stop.start - p);
        local.x.abs() <= 0.5 * SPACING + 1e-9
            && local.y.abs() < MAX_STOP_OFFSET
            && along.dot(&stop.ahead) > 0.5
    });
    found.map(|(i, (p, along))| i as f64 * SPACING + into_frame(*along, stop.start - p).x)
}
