//! Pedestrians walk around static obstacles.

use reactsim::geometry::{OrientedBox, Vec2};
use reactsim::scene::{AgentState, DT};

/// Clearance to static obstacles, metres.
const CLEARANCE: f64 = 0.15;

/// Changes the steps of a pedestrian that lead into a box so that they follow its side. `reach` is half
/// of the pedestrian's larger dimension, metres. Boxes that contain or touch the pedestrian at the
/// start are ignored, so that the pedestrian can get away from them.
pub(super) fn around(
    now: &AgentState,
    reach: f64,
    states: &[AgentState],
    standing: &[OrientedBox],
) -> Vec<AgentState> {
    let room = reach + CLEARANCE;
    let counts = |b: &&OrientedBox| outside(b, room, now.position()).is_none();
    let boxes: Vec<&OrientedBox> = standing.iter().filter(counts).collect();
    let (mut at, mut before, mut diverted) = (now.position(), now.position(), false);
    let step = |state: &AgentState| {
        // A pedestrian that was never diverted keeps its planned positions to the last bit.
        let wanted = if diverted { at + (state.position() - before) } else { state.position() };
        before = state.position();
        let mut next = wanted;
        for b in &boxes {
            if let Some(beside) = outside(b, room, next) {
                // The lost part of the step follows the side, towards the nearer corner.
                let lost = next - beside;
                let side = Vec2::new(-lost.y, lost.x);
                let corner = if side.dot(&(beside - b.center)) < 0.0 { -side } else { side };
                next = beside + corner;
            }
        }
        // There may be no room between two boxes.
        if boxes.iter().any(|b| outside(b, room - 1e-6, next).is_some()) {
            next = at;
        }
        diverted |= next != wanted;
        let v = (next - at) / DT;
        at = next;
        if diverted { AgentState { x: next.x, y: next.y, vx: v.x, vy: v.y, ..*state } } else { *state }
    };
    if boxes.is_empty() { states.to_vec() } else { states.iter().map(step).collect() }
}

/// Returns the nearest point at a distance of at least `room` from a box's sides; `None` if `p` already
/// is one.
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
    fn pedestrians_go_around_a_parked_car() {
        let car = OrientedBox::new(Vec2::new(4.0, 0.0), 0.0, 4.0, 2.0);
        let (now, states) = walks(Vec2::new(0.0, 0.8), Vec2::new(1.4, 0.0));
        let around = around(&now, 0.4, &states, &[car]);
        for pair in around.windows(2) {
            assert!(outside(&car, 0.5, pair[1].position()).is_none(), "{:?}", pair[1]);
            assert!((pair[1].position() - pair[0].position()).norm() < 0.6);
        }
        // The pedestrian gets past it, and a box farther away changes nothing.
        assert!(around[49].x > 6.0);
        let far = OrientedBox::new(Vec2::new(4.0, 9.0), 0.0, 4.0, 2.0);
        assert_eq!(super::around(&now, 0.4, &states, &[far]), states);
    }

    #[test]
    fn a_pedestrian_in_a_car_gets_out_as_planned() {
        let car = OrientedBox::new(Vec2::zeros(), 0.3, 4.0, 2.0);
        let (now, states) = walks(Vec2::new(0.5, 0.2), Vec2::new(0.0, 1.0));
        assert_eq!(around(&now, 0.4, &states, &[car]), states);
    }

    #[test]
    fn a_pedestrian_between_walls_stays() {
        let walls = [-1.0, 1.0].map(|y| OrientedBox::new(Vec2::new(3.0, y), 0.0, 2.0, 1.6));
        let (now, states) = walks(Vec2::zeros(), Vec2::new(1.0, 0.0));
        let around = around(&now, 0.4, &states, &walls);
        assert!(around.iter().all(|s| walls.iter().all(|b| outside(b, 0.5, s.position()).is_none())));
    }
}
