//! Compact encoding of realised tracks.

use reactsim_geometry::wrap;
use reactsim_scene::Frame;

/// Encodes the steps of a track after the frame `current` as spans without gaps: the step of the first state,
/// then `x y heading` of every state in millimetres and milliradians. Each number is stored as its deviation
/// from linear extrapolation: the first whole, the second as the difference from the first, then second
/// differences, most of which are small.
pub(super) fn spans(track: &[Frame], current: usize) -> Vec<Vec<i64>> {
    let mut spans: Vec<Vec<i64>> = Vec::new();
    let mut open: Option<Prediction> = None;
    for (step, frame) in track.iter().enumerate().skip(current + 1).map(|(f, s)| (f - current, s)) {
        let Some(state) = frame.filter(|s| s.is_finite()) else {
            open = None;
            continue;
        };
        if open.is_none() {
            spans.push(vec![step as i64]);
        }
        let before = open.get_or_insert_default();
        // Headings are unwrapped, so that differences stay small.
        let heading = before.heading.map_or(wrap(state.heading), |h| h + wrap(state.heading - h));
        before.heading = Some(heading);
        let now = [thousandths(state.x), thousandths(state.y), thousandths(heading)];
        if let Some(span) = spans.last_mut() {
            span.extend(before.residuals(now));
        }
    }
    spans
}

/// Rounds to thousandths. Clamped far beyond any real value, so that differences cannot overflow.
fn thousandths(value: f64) -> i64 {
    (value * 1000.0).round().clamp(-1e15, 1e15) as i64
}

/// Linear extrapolation from the previous states.
#[derive(Default)]
struct Prediction {
    /// Last unwrapped heading, radians.
    heading: Option<f64>,
    last: Option<[i64; 3]>,
    /// Last difference.
    step: [i64; 3],
}

impl Prediction {
    /// Returns the residuals of the next state, and updates the prediction.
    fn residuals(&mut self, now: [i64; 3]) -> [i64; 3] {
        let Some(last) = self.last.replace(now) else { return now };
        std::array::from_fn(|i| {
            let step = now[i] - last[i];
            let residual = step - self.step[i];
            self.step[i] = step;
            residual
        })
    }
}

#[cfg(test)]
mod tests {
    use reactsim_scene::AgentState;

    use super::*;

    #[test]
    fn steady_motion_has_zero_residuals() {
        let mut track: Vec<Frame> = (0..91)
            .map(|f| Some(AgentState { x: 0.5 * f as f64, y: -1.0, heading: 0.0, vx: 5.0, vy: 0.0 }))
            .collect();
        track[14] = None;
        let spans = spans(&track, 10);
        assert_eq!(spans[0], [1, 5500, -1000, 0, 500, 0, 0, 0, 0, 0]);
        assert_eq!(spans[1][..7], [5, 7500, -1000, 0, 500, 0, 0]);
        assert_eq!((spans.len(), spans[1].len()), (2, 1 + 3 * 76));
        let late = super::spans(&track, 20);
        assert_eq!((late.len(), late[0].len(), &late[0][..3]), (1, 1 + 3 * 70, &[1, 10500, -1000][..]));
    }

    #[test]
    fn headings_do_not_jump() {
        let state = |heading| Some(AgentState { x: 0.0, y: 0.0, heading, vx: 0.0, vy: 0.0 });
        let mut track = vec![None; 91];
        (track[11], track[12]) = (state(3.1), state(-3.1));
        assert_eq!(spans(&track, 10), [[1, 0, 0, 3100, 0, 0, 83]]);
        track[12] = state(f64::NAN);
        assert_eq!(spans(&track, 10), [[1, 0, 0, 3100]]);
    }
}
