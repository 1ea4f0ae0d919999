//! Disturbed training tracks: agents off their log that return to it, so that the network learns to
//! recover from the deviations of a closed loop.

use rand::RngExt;
use reactsim_geometry::{Vec2, direction, left, smooth_step};
use reactsim_nn::training::Stream;
use reactsim_scene::{AgentState, DT, Frame};
use serde::{Deserialize, Serialize};

/// Parameters of disturbances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disturbance {
    /// Probability that an agent is disturbed.
    pub often: f64,
    /// Largest lateral displacement at full speed, metres.
    pub aside: f64,
    /// Largest displacement ahead or behind at full speed, metres.
    pub along: f64,
    /// Largest change of the heading, radians.
    pub turn: f64,
    /// Time until the agent is back on its log, seconds.
    pub recovers: f64,
}

/// Speed in m/s from which disturbances have their full size.
const FULL_SPEED: f64 = 4.0;
/// Speed in m/s below which an agent stands and is not disturbed.
const STANDSTILL_SPEED: f64 = 0.5;
/// Time over which a disturbance builds up, seconds.
const BUILD_UP_TIME: f64 = 1.0;

impl Disturbance {
    /// Returns the track of an agent that has left its log by frame `now` and returns to it. The
    /// disturbance begins one second before `now`, positions change without jumps, and velocities are
    /// differences of positions.
    pub(super) fn apply(&self, track: &[Frame], now: usize, stream: &mut Stream) -> Vec<Frame> {
        // The same count of numbers is drawn whatever the agent does.
        let happens = stream.random::<f64>() < self.often;
        let mut drawn = |most: f64| most * (2.0 * stream.random::<f64>() - 1.0);
        let (aside, along, turn) = (drawn(self.aside), drawn(self.along), drawn(self.turn));
        let speed = track.get(now).copied().flatten().map_or(0.0, |s| s.velocity().map_or(0.0, |v| v.norm()));
        if !happens || speed < STANDSTILL_SPEED {
            return track.to_vec();
        }
        let part = (speed / FULL_SPEED).min(1.0);
        let offset = |frame: usize| {
            let t = (frame as f64 - now as f64) * DT;
            let share = if t <= 0.0 {
                smooth_step(1.0 + t / BUILD_UP_TIME)
            } else {
                1.0 - smooth_step(t / self.recovers.max(DT))
            };
            (share * part, t)
        };
        let (first, last) = (-BUILD_UP_TIME, self.recovers);
        let moved = |frame: usize, state: AgentState| {
            let (share, t) = offset(frame);
            if t <= first || t >= last {
                return state;
            }
            let ahead = direction(state.heading);
            let sideways = share * (aside + turn * speed * t);
            let p = state.position() + ahead * (share * along) + left(ahead) * sideways;
            AgentState { x: p.x, y: p.y, heading: state.heading + share * turn, ..state }
        };
        let mut all: Vec<Frame> =
            track.iter().enumerate().map(|(f, state)| state.map(|s| moved(f, s))).collect();
        for f in (1..all.len()).rev() {
            if let (Some(before), Some(state)) = (all[f - 1], &mut all[f]) {
                let v: Vec2 = (state.position() - before.position()) / DT;
                (state.vx, state.vy) = (v.x, v.y);
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::rand_core::SeedableRng;

    use super::*;

    const MUCH: Disturbance = Disturbance { often: 1.0, aside: 1.0, along: 1.0, turn: 0.1, recovers: 3.0 };

    fn straight(speed: f64) -> Vec<Frame> {
        let at = |f: i32| {
            Some(AgentState { x: speed * 0.1 * f64::from(f), y: 0.0, heading: 0.0, vx: speed, vy: 0.0 })
        };
        (0..91).map(at).collect()
    }

    #[test]
    fn a_disturbance_comes_and_goes_without_jumps() {
        let log = straight(8.0);
        let track = MUCH.apply(&log, 20, &mut Stream::seed_from_u64(5));
        let p = |f: usize| track[f].unwrap().position();
        assert_eq!(p(9), log[9].unwrap().position());
        assert_eq!(p(60), log[60].unwrap().position());
        assert!((p(20) - log[20].unwrap().position()).norm() > 0.1);
        for f in 2..91 {
            let bend = (p(f) - p(f - 1) * 2.0 + p(f - 2)).norm() / (DT * DT);
            assert!(bend < 9.0, "{f}: {bend}");
        }
    }

    #[test]
    fn a_standing_agent_is_not_disturbed() {
        let log = straight(0.2);
        assert_eq!(MUCH.apply(&log, 20, &mut Stream::seed_from_u64(5)), log);
    }
}
