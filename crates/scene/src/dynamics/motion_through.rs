//! Smooth motion through predicted positions.

use reactsim_geometry::Vec2;

/// Returns the positions after 1, 2 … `points.len() * step` frames of a motion that begins at the
/// origin with `velocity` (per frame), passes one of the points after every `step` frames, and has
/// continuous velocity and acceleration: a cubic spline, clamped at its beginning, with zero
/// acceleration at its end.
pub fn motion_through(points: &[Vec2], velocity: Vec2, step: usize) -> Vec<Vec2> {
    if step == 1 || points.is_empty() {
        return points.to_vec();
    }
    let (n, h) = (points.len(), step as f64);
    let at = |k: usize| if k == 0 { Vec2::zeros() } else { points[k - 1] };
    // Accelerations m at the knots: h/6 m[k-1] + 2h/3 m[k] + h/6 m[k+1] = difference of slopes; at the
    // ends as above. The matrix is tridiagonal and is eliminated from the first row on.
    let slope = |k: usize| (at(k) - at(k - 1)) / h;
    let mut upper = vec![0.0; n + 1];
    let mut right = vec![Vec2::zeros(); n + 1];
    upper[0] = 0.5;
    right[0] = (slope(1) - velocity) * (3.0 / h);
    for k in 1..n {
        let pivot = 4.0 - upper[k - 1];
        upper[k] = 1.0 / pivot;
        right[k] = ((slope(k + 1) - slope(k)) * (6.0 / h) - right[k - 1]) / pivot;
    }
    let mut bend = vec![Vec2::zeros(); n + 1];
    for k in (0..n).rev() {
        bend[k] = right[k] - bend[k + 1] * upper[k];
    }
    let mut all = Vec::with_capacity(n * step);
    for k in 1..=n {
        let start = slope(k) - (bend[k - 1] * 2.0 + bend[k]) * (h / 6.0);
        for i in 1..=step {
            if i == step {
                all.push(at(k));
                continue;
            }
            let t = i as f64;
            let jerk = (bend[k] - bend[k - 1]) / h;
            all.push(at(k - 1) + start * t + bend[k - 1] * (0.5 * t * t) + jerk * (t * t * t / 6.0));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_velocity_stays_so() {
        let points: Vec<Vec2> = (1..=16).map(|k| Vec2::new(5.0 * f64::from(k), 0.5 * f64::from(k))).collect();
        let all = motion_through(&points, Vec2::new(1.0, 0.1), 5);
        assert_eq!(all.len(), 80);
        for (k, p) in all.iter().enumerate() {
            assert!((p - Vec2::new(1.0, 0.1) * (k + 1) as f64).norm() < 1e-9, "{k} {p}");
        }
    }

    #[test]
    fn it_passes_its_points_without_jumps() {
        let points: Vec<Vec2> =
            (1..=16).map(|k| Vec2::new(f64::from(k * k) * 0.1, (f64::from(k) * 0.7).sin())).collect();
        let velocity = Vec2::new(0.3, -0.1);
        let all = motion_through(&points, velocity, 5);
        assert!(points.iter().enumerate().all(|(k, p)| all[5 * k + 4] == *p));
        let whole: Vec<Vec2> = [-velocity, Vec2::zeros()].into_iter().chain(all).collect();
        let second: Vec<Vec2> = whole.windows(3).map(|w| w[2] - w[1] * 2.0 + w[0]).collect();
        let largest = second.windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, f64::max);
        let size = second.iter().map(|v| v.norm()).fold(0.0, f64::max);
        assert!(largest < 0.75 * size, "{largest} {size}");
    }

    #[test]
    fn every_frame_needs_nothing() {
        let points = [Vec2::new(1.0, 2.0), Vec2::new(3.0, 1.0)];
        assert_eq!(motion_through(&points, Vec2::zeros(), 1), points);
        assert!(motion_through(&[], Vec2::zeros(), 5).is_empty());
    }
}
