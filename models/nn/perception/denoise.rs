//! Recorded tracks without the noise of their positions.
//!
//! Recorded positions are estimates with a noise of some millimetres. Recorded velocities are their differences
//! over 0.1 s, and what agents perceive as acceleration are differences of these: mostly noise. True motion has
//! small third differences, because people change their acceleration slowly.

use std::borrow::Cow;

use nalgebra::{Cholesky, DMatrix};
use reactsim_geometry::Vec2;
use reactsim_scene::{AgentState, DT, Frame, HISTORY};

/// Weight of squared third differences against squared distances from recorded positions. With it agents of
/// recordings are best extrapolated at constant acceleration.
const SMOOTHNESS: f64 = 100.0;
/// Noise in metres from which tracks are smoothed. Recordings have about 7 mm, generated scenes at most half a
/// millimetre.
const MIN_NOISE: f64 = 0.001;
/// Speed in m/s from which the noise of an agent counts: the positions of parked agents may be filtered.
const MOVING_SPEED: f64 = 1.0;
/// Weights of consecutive values in their third difference.
const THIRD_DIFFERENCE: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];
/// Variance of the third difference of independent values of variance 1.
const THIRD_DIFFERENCE_VARIANCE: f64 = 20.0;

/// Returns `tracks`, `[agents][frames]` as recorded up to the frame `now`, with the noise removed from the
/// positions of the last eleven recorded frames. Their velocities, m/s, become differences of the smoothed
/// positions. Positions at `now`, headings and all other frames stay as they are.
///
/// Tracks in which moving agents have a median noise of less than 1 mm are returned unchanged, and so are those
/// of agents that are present in fewer than four frames up to `now` without a gap.
///
/// The smoother minimises squared distances from the recorded positions and squared third differences
/// (Whittaker, 1922; Eilers, "A perfect smoother", Analytical Chemistry 75, 2003).
pub fn denoised(tracks: &[Vec<Frame>], now: usize) -> Cow<'_, [Vec<Frame>]> {
    let mut noise: Vec<f64> = tracks.iter().filter_map(|track| noise(&recent(track, now))).collect();
    noise.sort_by(f64::total_cmp);
    if noise.get(noise.len() / 2).is_none_or(|median| *median < MIN_NOISE) {
        return Cow::Borrowed(tracks);
    }
    let solvers: Vec<_> = (0..=HISTORY).map(solver).collect();
    let mut tracks = tracks.to_vec();
    for track in &mut tracks {
        let states = recent(track, now);
        let Some(solver) = &solvers[states.len()] else { continue };
        for (frame, state) in (now + 1 - states.len()..).zip(smoothed(&states, solver)) {
            track[frame] = Some(state);
        }
    }
    Cow::Owned(tracks)
}

/// Returns the states up to frame `now` without a gap, at most the last eleven.
fn recent(track: &[Frame], now: usize) -> Vec<AgentState> {
    let known = &track[..track.len().min(now + 1)];
    if known.len() <= now {
        return Vec::new();
    }
    let mut states: Vec<AgentState> = known.iter().rev().take(HISTORY).map_while(|frame| *frame).collect();
    states.reverse();
    states
}

/// Returns the standard deviation of positions about a smooth motion, metres per coordinate; `None` for an agent
/// at standstill, or with too few states.
fn noise(states: &[AgentState]) -> Option<f64> {
    let differences = states.windows(THIRD_DIFFERENCE.len());
    let (first, last) = (states.first()?, states.last()?);
    let time = DT * (states.len() - 1) as f64;
    if differences.len() == 0 || (last.position() - first.position()).norm() < MOVING_SPEED * time {
        return None;
    }
    let count = 2.0 * differences.len() as f64;
    let squares = differences.map(|four| {
        let weighted = four.iter().zip(THIRD_DIFFERENCE).map(|(state, weight)| state.position() * weight);
        weighted.sum::<Vec2>().norm_squared()
    });
    Some((squares.sum::<f64>() / (count * THIRD_DIFFERENCE_VARIANCE)).sqrt())
}

/// Returns the factors of the normal equations of the smoother for `count` positions; `None` if they are too few
/// to have a third difference.
fn solver(count: usize) -> Option<Cholesky<f64, nalgebra::Dyn>> {
    let mut equations = DMatrix::identity(count, count);
    for first in 0..(count + 1).checked_sub(THIRD_DIFFERENCE.len()).filter(|rows| *rows > 0)? {
        for (i, a) in THIRD_DIFFERENCE.into_iter().enumerate() {
            for (j, b) in THIRD_DIFFERENCE.into_iter().enumerate() {
                equations[(first + i, first + j)] += SMOOTHNESS * a * b;
            }
        }
    }
    equations.cholesky()
}

/// Returns the states with smoothed positions, moved so that the last one stays where it is, and with the
/// velocities of this motion.
fn smoothed(states: &[AgentState], solver: &Cholesky<f64, nalgebra::Dyn>) -> Vec<AgentState> {
    // Relative to the last one, so that coordinates far from the origin lose no digits.
    let last = states[states.len() - 1].position();
    let from_last = |i: usize, axis: usize| states[i].position()[axis] - last[axis];
    let positions = solver.solve(&DMatrix::from_fn(states.len(), 2, from_last));
    let at = |i: usize| Vec2::new(positions[(i, 0)], positions[(i, 1)]);
    let end = at(states.len() - 1);
    let state = |(i, state): (usize, &AgentState)| {
        let velocity = (at(i.max(1)) - at(i.max(1) - 1)) / DT;
        let position = last + at(i) - end;
        AgentState { x: position.x, y: position.y, vx: velocity.x, vy: velocity.y, ..*state }
    };
    states.iter().enumerate().map(state).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Agents at 8 m/s that brake by 2 m/s², with a deviation of alternating sign, in metres.
    fn braking(deviation: f64) -> Vec<Vec<Frame>> {
        let track = |agent: usize| {
            let state = |frame: usize| {
                let time = DT * frame as f64;
                let noise = if (frame + agent).is_multiple_of(2) { deviation } else { -deviation };
                let x = 8.0 * time - time * time + noise;
                AgentState { x, y: 4.0 * agent as f64, heading: 0.0, vx: 0.0, vy: 0.0 }
            };
            (0..20).map(|frame| Some(state(frame))).collect()
        };
        (0..3).map(track).collect()
    }

    #[test]
    fn noise_is_removed_and_motion_remains() {
        let noisy = braking(0.01);
        let tracks = denoised(&noisy, 10);
        for (smooth, track) in tracks.iter().zip(&noisy) {
            assert_eq!(smooth[10].unwrap().position(), track[10].unwrap().position(), "the present stays");
            assert_eq!(smooth[11..], track[11..], "later frames stay");
            for (frame, pair) in (1..=10).zip(smooth.windows(2)) {
                let [Some(before), Some(state)] = pair else { panic!("present throughout") };
                let (velocity, truth) =
                    ((state.x - before.x) / DT, 8.0 - 2.0 * DT * (f64::from(frame) - 0.5));
                assert!((velocity - truth).abs() < 0.03, "{frame}: {velocity} {truth}");
                assert!((state.vx - velocity).abs() < 1e-9);
            }
        }
        let quiet = braking(0.0002);
        assert!(matches!(denoised(&quiet, 10), Cow::Borrowed(_)), "motion without noise is not changed");
    }

    #[test]
    fn agents_with_few_frames_stay_as_they_are() {
        let mut tracks = braking(0.01);
        tracks[1][7] = None;
        tracks[2].truncate(10);
        let smooth = denoised(&tracks, 10);
        assert!(matches!(smooth, Cow::Owned(_)));
        assert_eq!(smooth[1][8].unwrap().x, tracks[1][8].unwrap().x);
        assert_eq!(smooth[2], tracks[2]);
        assert!(matches!(denoised(&[], 10), Cow::Borrowed(_)));
        assert!(matches!(denoised(&tracks[2..], 10), Cow::Borrowed(_)));
    }
}
