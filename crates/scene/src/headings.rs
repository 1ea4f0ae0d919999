//! Headings that a recording does not state.

use reactsim_geometry::math;

use super::{AgentState, DT, Frame};

/// Speed in m/s above which an agent moves along its heading. Slower motion is mostly noise of positions.
const MOVING_SPEED: f64 = 0.5;

/// Replaces unknown headings (NaN) in a track whose first `history` frames are those up to now: by the
/// direction of motion from the frame before where the agent moves, else by the last known heading. Before
/// the first known heading, the first one counts. Frames after the current one are never used for the
/// history. Headings stay unknown if the track states none and does not move.
pub(super) fn estimate_headings(track: &mut [Frame], history: usize) {
    if track.iter().flatten().all(|state| !state.heading.is_nan()) {
        return;
    }
    let (history, future) = track.split_at_mut(history.min(track.len()));
    fill(history, None);
    fill(future, history.last().copied().flatten());
}

/// Fills successive frames after the frame `before`.
fn fill(track: &mut [Frame], before: Frame) {
    let mut last = before;
    let mut adjacent = before;
    for frame in track.iter_mut() {
        if let Some(state) = frame {
            if state.heading.is_nan() {
                let motion = adjacent.and_then(|earlier| direction_of_motion(&earlier, state));
                let kept = || last.map(|state| state.heading);
                state.heading = motion.or_else(kept).unwrap_or(f64::NAN);
            }
            last = Some(*state).filter(|state| !state.heading.is_nan()).or(last);
        }
        adjacent = *frame;
    }
    let first = track.iter().flatten().map(|state| state.heading).find(|heading| !heading.is_nan());
    let unknown = track.iter_mut().flatten().take_while(|state| state.heading.is_nan());
    unknown.for_each(|state| state.heading = first.unwrap_or(f64::NAN));
}

fn direction_of_motion(from: &AgentState, to: &AgentState) -> Option<f64> {
    let way = to.position() - from.position();
    (way.norm() > MOVING_SPEED * DT).then(|| math::atan2(way.y, way.x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CURRENT, FRAMES, HISTORY};

    fn headings(x: impl Fn(usize) -> f64, heading: impl Fn(usize) -> f64) -> Vec<f64> {
        let state = |f: usize| AgentState { x: x(f), y: 0.0, heading: heading(f), vx: 0.0, vy: 0.0 };
        let mut track: Vec<Frame> = (0..FRAMES).map(|f| Some(state(f))).collect();
        estimate_headings(&mut track, HISTORY);
        track.iter().flatten().map(|state| state.heading).collect()
    }

    #[test]
    fn standing_agents_keep_their_last_heading() {
        let known = |f: usize| if f == 4 { 1.5 } else { f64::NAN };
        assert_eq!(headings(|_| 0.0, known), [1.5; FRAMES]);
        // It starts to move after the current frame.
        let found = headings(|f| 2.0 * f.saturating_sub(20) as f64, known);
        assert_eq!((found[CURRENT], found[20], found[21], found[90]), (1.5, 1.5, 0.0, 0.0));
    }

    #[test]
    fn the_future_is_not_used_for_the_history() {
        let found = headings(|_| 0.0, |f| if f > CURRENT { 1.0 } else { f64::NAN });
        assert!(found[..=CURRENT].iter().all(|h| h.is_nan()), "nothing is known: refused at assembly");
        assert_eq!(headings(|f| -(f as f64), |_| f64::NAN), [std::f64::consts::PI; FRAMES]);
    }
}
