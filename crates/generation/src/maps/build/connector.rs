//! Curves between two poses: paths of vehicles through junctions and driveways.

use reactsim_geometry::{Vec2, direction};

use super::path::{Station, sampling_step};

/// Minimum radius of a connector, metres: about that of a car at full lock (outer kerb-to-kerb radius of
/// 5.5 to 6 m).
pub const MIN_TURN_RADIUS: f64 = 5.5;

/// A position with a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position, metres.
    pub position: Vec2,
    /// Direction, radians.
    pub heading: f64,
}

impl Pose {
    /// Creates a pose.
    pub const fn new(position: Vec2, heading: f64) -> Self {
        Self { position, heading }
    }

    /// Returns the pose facing the opposite direction.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self { heading: self.heading + std::f64::consts::PI, ..self }
    }
}

impl From<Station> for Pose {
    fn from(s: Station) -> Self {
        Self { position: s.position, heading: s.heading }
    }
}

/// Returns a curve from one pose to the other, tangent to both and with zero curvature at the ends, and its
/// smallest radius, metres.
///
/// It is the quintic Hermite curve with the smallest maximum curvature over a choice of tangent lengths.
/// Points are at most 1 m apart where the curve is tighter than 25 m, otherwise as on other curves; the
/// first and the last point are exactly those of the poses.
pub fn connector(from: Pose, to: Pose) -> (Vec<Vec2>, f64) {
    let chord = (to.position - from.position).norm();
    let mut best = (f64::INFINITY, [Vec2::zeros(); 6]);
    for i in 0..10 {
        for j in 0..10 {
            let curve =
                hermite(from, to, chord * (0.7 + 0.15 * f64::from(i)), chord * (0.7 + 0.15 * f64::from(j)));
            let sharpest = (1..24).map(|n| curvature(&curve, f64::from(n) / 24.0)).fold(0.0, f64::max);
            // Ties (straight connectors) go to the most even tangent lengths.
            let uneven = f64::from((i - 2i32).abs() + (j - 2i32).abs());
            let cost = sharpest + 1e-6 * uneven;
            if cost < best.0 {
                best = (cost, curve);
            }
        }
    }
    let curve = best.1;
    let sharpest = (1..200).map(|n| curvature(&curve, f64::from(n) / 200.0)).fold(0.0, f64::max);
    let length: f64 =
        (0..64).map(|n| (at(&curve, f64::from(n + 1) / 64.0) - at(&curve, f64::from(n) / 64.0)).norm()).sum();
    let step = if sharpest > 1.0 / 25.0 { 1.0 } else { sampling_step(sharpest) };
    // Even spacing in the parameter is not quite even in length.
    let count = (length / step * 1.3).ceil().max(2.0);
    let mut points = vec![from.position];
    points.extend((1..count as usize).map(|n| at(&curve, n as f64 / count)));
    points.push(to.position);
    (points, if sharpest > 0.0 { 1.0 / sharpest } else { f64::INFINITY })
}

/// Returns the coefficients of the quintic with tangents of these lengths and zero second derivatives at
/// the ends.
fn hermite(from: Pose, to: Pose, start: f64, end: f64) -> [Vec2; 6] {
    let (p, q) = (from.position, to.position);
    let (v, w) = (direction(from.heading) * start, direction(to.heading) * end);
    let d = q - p;
    [
        p,
        v,
        Vec2::zeros(),
        d * 10.0 - v * 6.0 - w * 4.0,
        d * -15.0 + v * 8.0 + w * 7.0,
        d * 6.0 - (v + w) * 3.0,
    ]
}

fn at(c: &[Vec2; 6], u: f64) -> Vec2 {
    c[0] + (c[1] + (c[2] + (c[3] + (c[4] + c[5] * u) * u) * u) * u) * u
}

fn curvature(c: &[Vec2; 6], u: f64) -> f64 {
    let first = c[1] + (c[2] * 2.0 + (c[3] * 3.0 + (c[4] * 4.0 + c[5] * (5.0 * u)) * u) * u) * u;
    let second = c[2] * 2.0 + (c[3] * 6.0 + (c[4] * 12.0 + c[5] * (20.0 * u)) * u) * u;
    let speed2 = first.norm_squared();
    (first.perp(&second) / (speed2 * speed2.sqrt())).abs()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn a_right_angle_is_turned_gently() {
        let from = Pose::new(Vec2::zeros(), 0.0);
        let to = Pose::new(Vec2::new(12.0, 12.0), FRAC_PI_2);
        let (points, radius) = connector(from, to);
        assert_eq!((points[0], points[points.len() - 1]), (from.position, to.position));
        assert!(radius > 7.0, "{radius}");
        for pair in points.windows(2) {
            assert!((pair[1] - pair[0]).norm() <= 1.0 + 1e-9);
        }
        let first = points[1] - points[0];
        assert!(first.y.abs() / first.x < 0.05, "{first}");
    }

    #[test]
    fn straight_ahead_is_straight() {
        let (points, radius) = connector(Pose::new(Vec2::zeros(), 0.0), Pose::new(Vec2::new(30.0, 0.0), 0.0));
        assert!(radius > 1e6 && points.iter().all(|p| p.y.abs() < 1e-12));
        assert!(points.windows(2).all(|w| w[1].x > w[0].x));
    }

    #[test]
    fn a_shift_aside_is_an_s() {
        let (_, radius) = connector(Pose::new(Vec2::zeros(), 0.0), Pose::new(Vec2::new(40.0, 3.5), 0.0));
        assert!(radius > 60.0, "{radius}");
    }
}
