//! Relations of a place to other places and to agents.

use reactsim_geometry::{Vec2, into_frame};
use reactsim_nn::perception::{Body, Place, Role, put};
use reactsim_scene::LightState;

/// Number of features of the relation between two places.
pub(crate) const PLACE_PAIR_FEATURES: usize = 7;
/// Number of features of the relation of a place to an agent.
pub(crate) const TO_PLACE_FEATURES: usize = 27;

/// Writes the relation of another place to `place`, in its frame.
pub(crate) fn relate_places(place: &Place, other: &Place, out: &mut [f32]) {
    let apart = into_frame(place.ahead, other.start - place.start);
    let toward = into_frame(place.ahead, other.ahead);
    let distance = apart.norm();
    put(
        out,
        [apart.x / 10.0, apart.y / 10.0, distance / 10.0, toward.x, toward.y, 1.0 / (1.0 + distance), 1.0],
    );
}

/// Writes the relation of a place to an agent, in the agent's frame, with the present state of
/// its light.
pub(crate) fn relate_to_agent(place: &Place, me: &Body, light: Option<LightState>, out: &mut [f32]) {
    let local = |p: Vec2| into_frame(me.ahead, p - me.position);
    let (nearest, along) = place.nearest(me.position);
    let toward = into_frame(me.ahead, along);
    let at = local(nearest);
    let first = local(place.start);
    let last = local(place.end());
    let end_ahead = if place.points.len() > 1 { into_frame(me.ahead, place.end_ahead()) } else { toward };
    // Positive to the left of the piece.
    let aside = into_frame(along, me.position - nearest).y;
    let distance = at.norm();
    let speed = me.velocity.dot(&me.ahead).max(0.0);
    let shown = |f: fn(LightState) -> bool| f64::from(u8::from(light.is_some_and(f)));
    let (mut brake, mut arrival) = (0.0, 0.0);
    if place.role == Role::Stop && at.x > 0.0 {
        let room = (at.x - me.half.x).max(0.1);
        brake = (speed * speed / (2.0 * room) / 4.0).min(3.0);
        arrival = (room / speed.max(0.5) / 5.0).min(2.0);
    }
    put(
        out,
        [
            at.x / 10.0,
            at.y / 5.0,
            1.0 / (1.0 + distance),
            distance / 30.0,
            aside.clamp(-2.0, 2.0),
            (aside / 3.0).clamp(-3.0, 3.0),
            toward.x,
            (toward.y * 3.0).clamp(-3.0, 3.0),
            first.x / 30.0,
            first.y / 30.0,
            last.x / 30.0,
            last.y / 30.0,
            end_ahead.x,
            (end_ahead.y * 3.0).clamp(-3.0, 3.0),
            shown(LightState::is_red),
            shown(LightState::is_yellow),
            shown(|l| matches!(l, LightState::Go | LightState::ArrowGo)),
            shown(|l| matches!(l, LightState::Unknown)),
            shown(|l| matches!(l, LightState::FlashingStop | LightState::FlashingCaution)),
            brake,
            arrival,
            f64::from(u8::from(place.role == Role::Lane)),
            f64::from(u8::from(place.role == Role::Border)),
            f64::from(u8::from(place.role == Role::Stop)),
            // Clearance between the agent's box and the line.
            ((aside.abs() - me.half.y) / 2.0).clamp(-1.0, 3.0),
            f64::from(u8::from(at.x > 0.0)),
            1.0,
        ],
    );
}
