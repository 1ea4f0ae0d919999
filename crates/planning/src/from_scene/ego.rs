//! States of ego and the expert from tracks of box centres.

use reactsim_geometry::{Vec2, direction, left, wrap};
use reactsim_scene::{AgentState, DT, Frame, Length};

use crate::{EgoShape, EgoState};

/// Returns the state at each frame from the current one on of a vehicle whose `track` has the box centres of
/// a scenario of this length. `None` if the vehicle is absent or not finite at one of these frames.
///
/// Velocities are taken from the track; unknown ones are differences of positions. Yaw rates are central
/// differences of headings, and accelerations central differences of velocities in the frame of the body,
/// with the part that is due to its rotation: a steady turn has the lateral acceleration `vx ω`. The frame
/// before the current one is used if it is present. Time is 0 at the current frame. Steering angles are not
/// recorded and are 0.
pub fn ego_states(track: &[Frame], length: Length, shape: &EgoShape) -> Option<Vec<EgoState>> {
    let current = length.current();
    let present = |frame: usize| track.get(frame).copied().flatten().filter(AgentState::is_finite);
    let first = if present(current - 1).is_some() { current - 1 } else { current };
    let states: Vec<AgentState> = (first..length.frames()).map(present).collect::<Option<_>>()?;
    Some(states_by_differences(&states, first, current, shape).split_off(current - first))
}

/// Returns the states of a vehicle up to the current frame, the last one of `history`, by the differences of
/// [`ego_states`]; the last one has one-sided differences.
///
/// There is a state for each of the uninterrupted frames that end at the current one, oldest first; none if the
/// vehicle is absent or not finite at the current frame.
pub fn ego_states_until_now(history: &[Frame], shape: &EgoShape) -> Vec<EgoState> {
    let present = history.iter().rev().map_while(|frame| frame.filter(AgentState::is_finite));
    let mut states: Vec<AgentState> = present.collect();
    states.reverse();
    states_by_differences(&states, history.len() - states.len(), history.len().saturating_sub(1), shape)
}

/// Returns the state of a vehicle at the last frame of `track`, by one-sided differences over the two frames
/// before; `None` if it is absent or not finite. `current`: index of the frame at time 0.
pub fn ego_state_now(track: &[Frame], current: usize, shape: &EgoShape) -> Option<EgoState> {
    let present = track.iter().rev().map_while(|frame| frame.filter(AgentState::is_finite));
    let mut states: Vec<AgentState> = present.take(3).collect();
    states.reverse();
    states_by_differences(&states, track.len() - states.len(), current, shape).pop()
}

/// Returns the states of ego at successive frames, the first of which is the frame `first`; time is 0 at the
/// frame `current`.
fn states_by_differences(
    states: &[AgentState],
    first: usize,
    current: usize,
    shape: &EgoShape,
) -> Vec<EgoState> {
    let yaw_rate =
        |i: usize| difference(states.len(), i, |from, to| wrap(states[to].heading - states[from].heading));
    let yaw_rates: Vec<f64> = (0..states.len()).map(yaw_rate).collect();
    let velocities: Vec<Vec2> =
        (0..states.len()).map(|i| rear_axle_velocity(states, i, yaw_rates[i], shape)).collect();
    let rate =
        |i: usize, of: &dyn Fn(usize) -> f64| difference(states.len(), i, |from, to| of(to) - of(from));
    let state = |i: usize| {
        let rear_axle = states[i].position() - direction(states[i].heading) * shape.rear_axle_to_center;
        let (velocity, yaw_rate) = (velocities[i], yaw_rates[i]);
        EgoState {
            time: ((first + i) as f64 - current as f64) * DT,
            x: rear_axle.x,
            y: rear_axle.y,
            heading: states[i].heading,
            vx: velocity.x,
            vy: velocity.y,
            ax: rate(i, &|k| velocities[k].x) - yaw_rate * velocity.y,
            ay: rate(i, &|k| velocities[k].y) + yaw_rate * velocity.x,
            steering: 0.0,
            yaw_rate,
            yaw_acceleration: rate(i, &|k| yaw_rates[k]),
        }
    };
    (0..states.len()).map(state).collect()
}

/// Returns the velocity of the rear axle in the body frame, m/s.
fn rear_axle_velocity(states: &[AgentState], i: usize, yaw_rate: f64, shape: &EgoShape) -> Vec2 {
    let ahead = direction(states[i].heading);
    let center = states[i].velocity().unwrap_or_else(|| {
        let of = |axis: fn(&AgentState) -> f64| {
            difference(states.len(), i, |from, to| axis(&states[to]) - axis(&states[from]))
        };
        Vec2::new(of(|state| state.x), of(|state| state.y))
    });
    Vec2::new(center.dot(&ahead), center.dot(&left(ahead)) - yaw_rate * shape.rear_axle_to_center)
}

/// Returns the central difference of a quantity at index `i` of `count`, per second; one-sided at the ends.
fn difference(count: usize, i: usize, change: impl Fn(usize, usize) -> f64) -> f64 {
    let (from, to) = (i.saturating_sub(1), (i + 1).min(count - 1));
    if from == to { 0.0 } else { change(from, to) / ((to - from) as f64 * DT) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTH: Length = Length::BENCHMARK;

    fn circle(radius: f64, yaw_rate: f64) -> Vec<Frame> {
        circle_of(LENGTH, radius, yaw_rate)
    }

    /// A track on a circle around the origin: counter-clockwise, radius in metres, yaw rate in rad/s.
    fn circle_of(length: Length, radius: f64, yaw_rate: f64) -> Vec<Frame> {
        let state = |frame: usize| {
            let angle = yaw_rate * frame as f64 * DT;
            let (position, tangent) = (direction(angle) * radius, left(direction(angle)));
            let velocity = tangent * (radius * yaw_rate);
            let heading = angle + std::f64::consts::FRAC_PI_2;
            AgentState { x: position.x, y: position.y, heading, vx: velocity.x, vy: velocity.y }
        };
        (0..length.frames()).map(|frame| Some(state(frame))).collect()
    }

    #[test]
    fn a_steady_turn_has_the_motion_of_its_rear_axle() {
        for (history, future) in [(11, 80), (11, 150), (2, 60), (21, 600), (100, 1)] {
            let length = Length { history, future };
            let states = ego_states(&circle_of(length, 20.0, 0.5), length, &EgoShape::PACIFICA).unwrap();
            assert_eq!(states.len(), future + 1);
            assert_eq!((states[0].time, states[future].time), (0.0, future as f64 * DT));
            for state in states {
                assert!((state.yaw_rate - 0.5).abs() < 1e-9 && state.yaw_acceleration.abs() < 1e-9);
                assert!((state.vx - 10.0).abs() < 1e-9 && (state.vy + 0.5 * 1.461).abs() < 1e-9);
                assert!((state.ay - 5.0).abs() < 1e-9 && (state.ax - 0.25 * 1.461).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn the_past_does_not_depend_on_the_future() {
        let mut track = circle(20.0, 0.5);
        let past = ego_states_until_now(&track[..=10], &EgoShape::PACIFICA);
        let times: Vec<f64> = past.iter().map(|state| state.time).collect();
        assert_eq!((times.len(), times[0], times[10]), (11, -1.0, 0.0));
        for state in &past {
            assert!((state.yaw_rate - 0.5).abs() < 1e-9 && (state.vx - 10.0).abs() < 1e-9);
            assert!((state.ay - 5.0).abs() < 1e-9 && (state.ax - 0.25 * 1.461).abs() < 1e-9);
        }
        assert_eq!(ego_state_now(&track[..=10], 10, &EgoShape::PACIFICA).unwrap().time, 0.0);
        assert_eq!(ego_state_now(&track, 20, &EgoShape::PACIFICA).unwrap().time, 70.0 * DT);
        let short = ego_states_until_now(&track[..2], &EgoShape::PACIFICA);
        assert_eq!(short.iter().map(|state| state.time).collect::<Vec<_>>(), [-DT, 0.0]);
        track[6] = None;
        assert_eq!(ego_states_until_now(&track[..=10], &EgoShape::PACIFICA).len(), 4);
        track[10] = None;
        assert!(ego_states_until_now(&track[..=10], &EgoShape::PACIFICA).is_empty());
    }

    #[test]
    fn unknown_velocities_are_differences() {
        let mut track = circle(20.0, 0.5);
        let unknown = |state: &mut AgentState| (state.vx, state.vy) = (f64::NAN, f64::NAN);
        track.iter_mut().flatten().for_each(unknown);
        let states = ego_states(&track, LENGTH, &EgoShape::PACIFICA).unwrap();
        assert!((states[40].vx - 10.0).abs() < 0.01);
    }

    #[test]
    fn a_gap_after_the_current_frame_gives_nothing() {
        let mut track = circle(20.0, 0.5);
        track[3] = None;
        assert!(ego_states(&track, LENGTH, &EgoShape::PACIFICA).is_some());
        track[60] = None;
        assert!(ego_states(&track, LENGTH, &EgoShape::PACIFICA).is_none());
    }
}
