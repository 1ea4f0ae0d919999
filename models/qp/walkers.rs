//! Pedestrians walk around static obstacles, and out of boxes that they are in.

use reactsim_geometry::{OrientedBox, Vec2, heading_of};
use reactsim_scene::{AgentState, DT};

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

/// Speed of pedestrians who step out of a box, m/s: calm walking.
const STEPPING_SPEED: f64 = 1.2;

/// Returns the steps of a pedestrian out of the boxes that it overlaps, by the nearest side that is free, as
/// many as planned; `None` if it overlaps none. Recorded pedestrians get into and out of vehicles; those who
/// stay where they were recorded overlap them for ever.
pub(super) fn out_of_boxes(
    now: &AgentState,
    reach: f64,
    steps: usize,
    boxes: &[OrientedBox],
) -> Option<Vec<AgentState>> {
    let at = now.position();
    let is_free = |p: Vec2| boxes.iter().all(|b| outside(b, reach, p).is_none());
    if is_free(at) {
        return None;
    }
    let room = reach + CLEARANCE;
    let overlapped = boxes.iter().filter(|b| outside(b, reach, at).is_some());
    let exits = overlapped.flat_map(|b| {
        let local = b.to_local(at);
        let (x, y) = (b.half_length + room, b.half_width + room);
        [(x, local.y), (-x, local.y), (local.x, y), (local.x, -y)]
            .map(|(x, y)| b.center + b.axis * x + b.left() * y)
    });
    let nearest = |a: &Vec2, b: &Vec2| (a - at).norm_squared().total_cmp(&(b - at).norm_squared());
    let exit = exits.filter(|p| is_free(*p)).min_by(nearest)?;
    let way = exit - at;
    let heading = heading_of(way);
    let mut before = at;
    let step = |k: usize| {
        let gone = (STEPPING_SPEED * DT * (k + 1) as f64).min(way.norm());
        let position = at + way * (gone / way.norm());
        let v = (position - before) / DT;
        before = position;
        AgentState { x: position.x, y: position.y, heading, vx: v.x, vy: v.y }
    };
    Some((0..steps).map(step).collect())
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
    fn a_pedestrian_in_a_car_steps_out_by_the_nearest_free_side() {
        let car = OrientedBox::new(Vec2::zeros(), 0.0, 4.0, 2.0);
        let (now, _) = walks(Vec2::new(0.5, 0.2), Vec2::zeros());
        let out = out_of_boxes(&now, 0.4, 20, &[car]).unwrap();
        assert_eq!(out.len(), 20);
        assert!((out[19].position() - Vec2::new(0.5, 1.55)).norm() < 1e-9, "{:?}", out[19]);
        assert!((out[0].vy - STEPPING_SPEED).abs() < 1e-9);
        // Another car on that side: the pedestrian takes the other one.
        let beside = OrientedBox::new(Vec2::new(0.0, 2.3), 0.0, 4.0, 2.0);
        let out = out_of_boxes(&now, 0.4, 20, &[car, beside]).unwrap();
        assert!((out[19].position() - Vec2::new(0.5, -1.55)).norm() < 1e-9, "{:?}", out[19]);
        // A pedestrian outside is left alone.
        let (now, _) = walks(Vec2::new(0.5, 1.5), Vec2::zeros());
        assert_eq!(out_of_boxes(&now, 0.4, 20, &[car]), None);
    }

    #[test]
    fn a_pedestrian_between_walls_stays() {
        let walls = [-1.0, 1.0].map(|y| OrientedBox::new(Vec2::new(3.0, y), 0.0, 2.0, 1.6));
        let (now, states) = walks(Vec2::zeros(), Vec2::new(1.0, 0.0));
        let around = around(&now, 0.4, &states, &walls);
        assert!(around.iter().all(|s| walls.iter().all(|b| outside(b, 0.5, s.position()).is_none())));
    }
}
