//! Simplification of lines and clipping to the surroundings.

use reactsim_geometry::{Vec2, point_segment};

use super::cm;
use super::near::Near;

/// Largest distance of a simplified line from the recorded one, metres: too small to see.
const TOLERANCE: f64 = 0.05;
/// Sampling distance of a line while it is clipped, metres, so that a segment cannot skip the
/// surroundings.
const STRIDE: f64 = 10.0;

/// Returns the parts of a line in the surroundings, each simplified.
pub(super) fn runs<'a>(line: &'a [Vec2], near: &'a Near) -> impl Iterator<Item = Vec<Vec2>> + 'a {
    let mut runs: Vec<Vec<Vec2>> = Vec::new();
    let mut is_open = false;
    for (i, &point) in line.iter().enumerate() {
        // A coarse line may pass through the surroundings between two distant points.
        let start = if i > 0 { line[i - 1] } else { point };
        let pieces = ((point - start).norm() / STRIDE).ceil().clamp(1.0, 1000.0) as usize;
        for k in 1..=pieces {
            let p = if k == pieces { point } else { start + (point - start) * (k as f64 / pieces as f64) };
            if near.holds(p) {
                if !is_open {
                    runs.push(Vec::new());
                }
                is_open = true;
                if let Some(run) = runs.last_mut() {
                    run.push(p);
                }
            } else {
                is_open = false;
            }
        }
    }
    runs.into_iter().filter(|run| run.len() > 1).map(|run| simplified(&run))
}

/// Simplifies a line (Douglas and Peucker, 1973); its ends are kept.
pub(super) fn simplified(line: &[Vec2]) -> Vec<Vec2> {
    let mut keeps = vec![false; line.len()];
    if let [first, .., last] = keeps.as_mut_slice() {
        (*first, *last) = (true, true);
    } else {
        return line.to_vec();
    }
    let mut open = vec![(0, line.len() - 1)];
    while let Some((from, to)) = open.pop() {
        let (mut farthest, mut at) = (TOLERANCE * TOLERANCE, None);
        for (i, &p) in line.iter().enumerate().take(to).skip(from + 1) {
            let (distance, _) = point_segment(p, line[from], line[to]);
            if distance > farthest {
                (farthest, at) = (distance, Some(i));
            }
        }
        if let Some(at) = at {
            keeps[at] = true;
            open.extend([(from, at), (at, to)]);
        }
    }
    line.iter().zip(&keeps).filter(|(_, keep)| **keep).map(|(p, _)| *p).collect()
}

/// Returns a line as flat centimetres: the first point, then differences.
pub(super) fn points(line: &[Vec2]) -> impl Iterator<Item = i64> + '_ {
    let mut before = (0, 0);
    line.iter().flat_map(move |p| {
        let now = (cm(p.x), cm(p.y));
        let step = [now.0 - before.0, now.1 - before.1];
        before = now;
        step
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invisible_points_are_left_out() {
        let line: Vec<Vec2> = (0..=100).map(|i| Vec2::new(f64::from(i), 0.01 * f64::from(i % 3))).collect();
        assert_eq!(simplified(&line).len(), 2);
        let bend = [Vec2::new(0.0, 0.0), Vec2::new(5.0, 0.06), Vec2::new(10.0, 0.0)];
        assert_eq!(simplified(&bend), bend);
        // The ends of a closed outline coincide.
        let ring = [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 0.0]].map(|[x, y]| Vec2::new(x, y));
        assert_eq!(simplified(&ring), [ring[0], ring[2], ring[3], ring[4]]);
        assert_eq!(points(&ring[1..4]).collect::<Vec<_>>(), [200, 0, 200, 0, 0, 300]);
    }
}
