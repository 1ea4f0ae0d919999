//! People on foot do not walk into what stands.

use reactsim::geometry::{OrientedBox, Vec2};
use reactsim::scene::{AgentState, DT};

/// Room that is left beside what stands, metres.
const ROOM: f64 = 0.15;

/// Changes the steps of somebody on foot that lead into a box: they go along its side. `reach` is half of his larger side, metres. Boxes
/// that he is in or beside already do not count: he got there somehow, and gets away the same way.
pub(super) fn around(
    now: &AgentState,
    reach: f64,
    states: &[AgentState],
    standing: &[OrientedBox],
) -> Vec<AgentState> {
    let room = reach + ROOM;
    let counts = |b: &&OrientedBox| outside(b, room, now.position()).is_none();
    let boxes: Vec<&OrientedBox> = standing.iter().filter(counts).collect();
    let (mut at, mut before, mut led) = (now.position(), now.position(), false);
    let step = |state: &AgentState| {
        // Who was led nowhere goes where he planned to, to the last bit.
        let wanted = if led { at + (state.position() - before) } else { state.position() };
        before = state.position();
        let mut next = wanted;
        for b in &boxes {
            if let Some(beside) = outside(b, room, next) {
                // What does not lead on leads along the side, to the nearer corner.
                let lost = next - beside;
                let side = Vec2::new(-lost.y, lost.x);
                let corner = if side.dot(&(beside - b.center)) < 0.0 { -side } else { side };
                next = beside + corner;
            }
        }
        // Between two boxes there may be no way.
        if boxes.iter().any(|b| outside(b, room - 1e-6, next).is_some()) {
            next = at;
        }
        led |= next != wanted;
        let v = (next - at) / DT;
        at = next;
        if led { AgentState { x: next.x, y: next.y, vx: v.x, vy: v.y, ..*state } } else { *state }
    };
    if boxes.is_empty() { states.to_vec() } else { states.iter().map(step).collect() }
}

/// The nearest point that is at least `room` away from a box's sides; `None` for a point that is.
fn outside(b: &OrientedBox, room: f64, p: Vec2) -> Option<Vec2> {
    let local = b.to_local(p);
    let (x, y) = (b.half_length + room - local.x.abs(), b.half_width + room - local.y.abs());
    if x <= 0.0 || y <= 0.0 {
        return None;
    }
    Some(p + if x < y { b.axis * x.copysign(local.x) } else { b.left() * y.copysign(local.y) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walks(from: Vec2, velocity: Vec2) -> (AgentState, Vec<AgentState>) {
        let at = |k: f64| {
            let p = from + velocity * (DT * k);
            AgentState { x: p.x, y: p.y, heading: 0.0, vx: velocity.x, vy: velocity.y }
        };
        (at(0.0), (1..=50).map(|k| at(f64::from(k))).collect())
    }

    #[test]
    fn a_parked_car_is_gone_round() {
        let car = OrientedBox::new(Vec2::new(4.0, 0.0), 0.0, 4.0, 2.0);
        let (now, states) = walks(Vec2::new(0.0, 0.8), Vec2::new(1.4, 0.0));
        let around = around(&now, 0.4, &states, &[car]);
        for pair in around.windows(2) {
            assert!(outside(&car, 0.5, pair[1].position()).is_none(), "{:?}", pair[1]);
            assert!((pair[1].position() - pair[0].position()).norm() < 0.6);
        }
        // He gets past it, and nobody else's steps change.
        assert!(around[49].x > 6.0);
        let far = OrientedBox::new(Vec2::new(4.0, 9.0), 0.0, 4.0, 2.0);
        assert_eq!(super::around(&now, 0.4, &states, &[far]), states);
    }

    #[test]
    fn who_is_in_a_car_already_gets_out_as_he_likes() {
        let car = OrientedBox::new(Vec2::zeros(), 0.3, 4.0, 2.0);
        let (now, states) = walks(Vec2::new(0.5, 0.2), Vec2::new(0.0, 1.0));
        assert_eq!(around(&now, 0.4, &states, &[car]), states);
    }

    #[test]
    fn between_walls_he_stays() {
        let walls = [-1.0, 1.0].map(|y| OrientedBox::new(Vec2::new(3.0, y), 0.0, 2.0, 1.6));
        let (now, states) = walks(Vec2::zeros(), Vec2::new(1.0, 0.0));
        let around = around(&now, 0.4, &states, &walls);
        assert!(around.iter().all(|s| walls.iter().all(|b| outside(b, 0.5, s.position()).is_none())));
    }
}
