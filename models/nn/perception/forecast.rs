//! Forecast of the AV from its motion so far.

use reactsim_geometry::{Vec2, direction, wrap};
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{AgentState, DT, FUTURE, Frame};

/// Time in seconds for which acceleration and yaw rate are kept; then the AV goes straight on at
/// constant speed.
const DURATION: f64 = 3.0;
/// Largest magnitude of the estimated acceleration, m/s²: differences of recorded positions are noisy.
const MAX_ACCELERATION: f64 = 6.0;
/// Largest magnitude of the estimated yaw rate, rad/s.
const MAX_YAW_RATE: f64 = 1.0;
/// Frames over which acceleration and yaw rate are measured.
const FRAMES: usize = 2;

/// Returns the states after 0.1, 0.2 … 8 s at constant yaw rate and acceleration, from the state at frame
/// `now`, those before it, and `next`, the state one frame later, where the protocol shows it. `None` if the
/// agent is absent now.
pub fn forecast(track: &[Frame], now: usize, next: Option<AgentState>) -> Option<Vec<AgentState>> {
    let here = track.get(now).copied().flatten()?;
    let back = |k: usize| now.checked_sub(k).and_then(|f| track[f]);
    // The latest known states, newest first.
    let known: Vec<AgentState> = match next {
        Some(next) => [Some(next), Some(here), back(1), back(2)].into_iter().map_while(|s| s).collect(),
        None => [Some(here), back(1), back(2), back(3)].into_iter().map_while(|s| s).collect(),
    };
    let last = *known.first()?;
    let along = |to: &AgentState, from: &AgentState| {
        (to.position() - from.position()).dot(&direction(to.heading)) / DT
    };
    let mut speed = match known.get(1) {
        Some(before) => along(&last, before),
        None => last.forward_speed(),
    };
    let (mut acceleration, mut yaw_rate) = (0.0, 0.0);
    if let Some(earlier) = known.get(FRAMES) {
        yaw_rate =
            (wrap(last.heading - earlier.heading) / (FRAMES as f64 * DT)).clamp(-MAX_YAW_RATE, MAX_YAW_RATE);
        if let Some(earliest) = known.get(FRAMES + 1) {
            let gained = (speed - along(earlier, earliest)) / (FRAMES as f64 * DT);
            acceleration = gained.clamp(-MAX_ACCELERATION, MAX_ACCELERATION);
        }
    }
    if speed < 0.0 {
        (acceleration, yaw_rate) = (0.0, 0.0);
    }
    let mut pose = Pose::from(last);
    let mut states = Vec::with_capacity(FUTURE);
    if next.is_some() {
        states.push(state(pose, here.position()));
    }
    for k in 0..FUTURE {
        let lasts = (k as f64) * DT < DURATION;
        if lasts && speed >= 0.0 {
            speed = (speed + acceleration * DT).max(0.0);
        }
        // A standing AV does not turn.
        let curvature = if lasts && speed > 0.5 { yaw_rate / speed } else { 0.0 };
        let from = pose.position;
        pose = pose.advance(speed * DT, curvature);
        states.push(state(pose, from));
    }
    states.truncate(FUTURE);
    Some(states)
}

/// Returns the state at a pose that was reached from a position within one frame.
fn state(pose: Pose, from: Vec2) -> AgentState {
    let (p, v) = (pose.position, (pose.position - from) / DT);
    AgentState { x: p.x, y: p.y, heading: pose.heading, vx: v.x, vy: v.y }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, y: f64, heading: f64) -> AgentState {
        AgentState { x, y, heading, vx: f64::NAN, vy: f64::NAN }
    }

    #[test]
    fn braking_ends_in_a_halt() {
        // 5 m/s at first, decelerating by 2 m/s².
        let distance = |t: f64| 5.0 * t - t * t;
        let track: Vec<Frame> = (0..11).map(|k| Some(at(distance(k as f64 * DT), 0.0, 0.0))).collect();
        let states = forecast(&track, 10, None).unwrap();
        assert_eq!(states.len(), FUTURE);
        let end = states[FUTURE - 1];
        assert!((end.position() - Vec2::new(distance(2.5), 0.0)).norm() < 0.3, "{end:?}");
        assert!(end.velocity().unwrap().norm() < 1e-9);
        let seen = forecast(&track[..10], 9, track[10]).unwrap();
        assert!((seen[0].position() - track[10].unwrap().position()).norm() < 1e-12);
        assert!((seen[FUTURE - 1].position() - end.position()).norm() < 0.1);
    }

    #[test]
    fn little_is_needed() {
        assert!(forecast(&[None], 0, None).is_none());
        let one = [Some(at(1.0, 2.0, 0.3))];
        assert!(
            forecast(&one, 0, None)
                .unwrap()
                .iter()
                .all(|s| (s.position() - Vec2::new(1.0, 2.0)).norm() < 1e-12)
        );
    }

    #[test]
    fn a_turn_goes_on_for_a_while() {
        let track: Vec<Frame> = (0..11)
            .map(|k| {
                let a = 0.2 * DT * k as f64;
                Some(at(25.0 * a.sin(), 25.0 * (1.0 - a.cos()), a))
            })
            .collect();
        let states = forecast(&track, 10, None).unwrap();
        let last = states[FUTURE - 1];
        let angle = last.vy.atan2(last.vx);
        assert!((angle - (0.2 + 0.6)).abs() < 0.03, "{angle}");
        assert!((last.heading - angle).abs() < 0.03, "{last:?}");
    }
}
