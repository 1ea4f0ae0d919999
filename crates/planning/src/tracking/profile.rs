//! Speeds and curvatures of a sequence of rear-axle poses (nuPlan devkit 1.2.2, `tracker_utils`).

use reactsim_geometry::{direction, wrap};

use crate::trajectory::Pose;

/// Weight of squared differences of successive accelerations, s²·m²/(m/s²)²; the other terms are squared
/// errors of displacements, m² (nuPlan devkit 1.2.2, `jerk_penalty`).
const JERK_PENALTY: f64 = 1e-4;
/// Weight of squared curvature rates; the other terms are squared errors of headings, rad² (nuPlan devkit
/// 1.2.2, `curvature_rate_penalty`).
const CURVATURE_RATE_PENALTY: f64 = 1e-2;
/// Weight of the squared first curvature, which is undetermined at standstill otherwise (nuPlan devkit
/// 1.2.2, `INITIAL_CURVATURE_PENALTY`).
const INITIAL_CURVATURE_PENALTY: f64 = 1e-10;

/// Penalty of the fit of the speeds, next to errors of displacements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothing {
    /// Differences of successive accelerations (nuPlan devkit 1.2.2).
    Jerk,
    /// Accelerations, and the difference of the last two (tuplan_garage b51d5d0).
    ///
    /// The difference matrix of tuplan_garage has only its main diagonal, except in the last row, so that
    /// the profiles of PDM-Closed are smoothed differently from the profiles of the tracker that drives
    /// ego.
    Acceleration,
}

/// Speeds and curvatures that follow a sequence of poses smoothly.
///
/// Sample `i` belongs to the interval that begins at pose `i`: there is one sample less than poses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Profile {
    /// Signed speeds along the heading, m/s.
    pub speeds: Vec<f64>,
    /// Curvatures, 1/m, left positive.
    pub curvatures: Vec<f64>,
}

impl Profile {
    /// Fits speeds and curvatures to poses that follow each other at intervals of `interval` seconds.
    /// Fewer than two poses give an empty profile.
    ///
    /// The speeds minimise the squared errors of the displacements along the heading and the penalty of
    /// `smoothing`. The curvatures minimise, at these speeds, the squared errors of the turns and the
    /// penalised curvature rates.
    pub fn fit(poses: &[Pose], interval: f64, smoothing: Smoothing) -> Self {
        let advances: Vec<f64> = poses
            .windows(2)
            .map(|pair| (pair[1].position - pair[0].position).dot(&direction(pair[0].heading)))
            .collect();
        let turns: Vec<f64> = poses.windows(2).map(|pair| wrap(pair[1].heading - pair[0].heading)).collect();
        let speeds = fit_speeds(&advances, interval, smoothing);
        let curvatures = fit_curvatures(&turns, &speeds, interval);
        Self { speeds, curvatures }
    }
}

/// Returns the speeds that minimise the squared errors of `advances`, in metres per interval, and the
/// penalty.
///
/// The normal equations of the speeds themselves have five diagonals, and their condition number is at most
/// 1 + 16 penalty/dt⁴ = 17 for any number of samples: a factorisation of the band is exact to rounding, and
/// takes a few operations per sample.
fn fit_speeds(advances: &[f64], interval: f64, smoothing: Smoothing) -> Vec<f64> {
    let count = advances.len();
    // Accelerations are differences of speeds, divided by the interval.
    let weight = JERK_PENALTY / (interval * interval);
    let mut system = Pentadiagonal::diagonal(count, interval * interval);
    let last = count.saturating_sub(3);
    for first in 0..count.saturating_sub(2) {
        if smoothing == Smoothing::Jerk || first == last {
            system.add_square(first, [1.0, -2.0, 1.0], weight);
        } else {
            system.add_square(first, [-1.0, 1.0, 0.0], weight);
        }
    }
    system.solve(advances.iter().map(|advance| interval * advance).collect())
}

/// A symmetric positive definite matrix with five diagonals.
struct Pentadiagonal {
    /// Entries (i, i).
    main: Vec<f64>,
    /// Entries (i, i − 1); the first is unused.
    first: Vec<f64>,
    /// Entries (i, i − 2); the first two are unused.
    second: Vec<f64>,
}

impl Pentadiagonal {
    fn diagonal(size: usize, value: f64) -> Self {
        Self { main: vec![value; size], first: vec![0.0; size], second: vec![0.0; size] }
    }

    /// Adds `weight` times the square of the sum of three successive unknowns, from `i` on, multiplied by
    /// `factors`.
    fn add_square(&mut self, i: usize, factors: [f64; 3], weight: f64) {
        let [a, b, c] = factors;
        self.main[i] += weight * a * a;
        self.main[i + 1] += weight * b * b;
        self.main[i + 2] += weight * c * c;
        self.first[i + 1] += weight * a * b;
        self.first[i + 2] += weight * b * c;
        self.second[i + 2] += weight * a * c;
    }

    /// Solves the system for a right-hand side, by L D Lᵀ.
    fn solve(mut self, mut right: Vec<f64>) -> Vec<f64> {
        let size = right.len();
        for i in 0..size {
            if i >= 2 {
                let pivot = self.main[i - 2];
                let factor = self.second[i] / pivot;
                self.first[i] -= factor * pivot * self.first[i - 1];
                self.main[i] -= factor * factor * pivot;
                right[i] -= factor * right[i - 2];
                self.second[i] = factor;
            }
            if i >= 1 {
                let pivot = self.main[i - 1];
                let factor = self.first[i] / pivot;
                self.main[i] -= factor * factor * pivot;
                right[i] -= factor * right[i - 1];
                self.first[i] = factor;
            }
        }
        for i in (0..size).rev() {
            let next = if i + 1 < size { self.first[i + 1] * right[i + 1] } else { 0.0 };
            let after = if i + 2 < size { self.second[i + 2] * right[i + 2] } else { 0.0 };
            right[i] = right[i] / self.main[i] - next - after;
        }
        right
    }
}

/// Returns the curvatures `k` that minimise Σ (turn − dt v k)² + penalty Σ (k′/dt)² + a small multiple of
/// the squared first curvature, where k′ are first differences.
///
/// The normal equations are those of a chain of nodes, each held by a spring of its own (the squared
/// displacement) and tied to the next by springs of one stiffness. Eliminating nodes adds stiffnesses and
/// never subtracts, so the result is accurate at standstill too, where only the penalty of the first
/// curvature holds the chain.
fn fit_curvatures(turns: &[f64], speeds: &[f64], interval: f64) -> Vec<f64> {
    let tie = CURVATURE_RATE_PENALTY / (interval * interval);
    let mut stiffness = Vec::with_capacity(turns.len());
    let mut pull = Vec::with_capacity(turns.len());
    // Stiffness and pull that the nodes so far exert on the next one.
    let (mut inherited, mut passed) = (INITIAL_CURVATURE_PENALTY, 0.0);
    for (turn, speed) in turns.iter().zip(speeds) {
        let advance = interval * speed;
        let (held, pulled) = (inherited + advance * advance, passed + advance * turn);
        stiffness.push(held);
        pull.push(pulled);
        inherited = tie * held / (tie + held);
        passed = pulled * tie / (tie + held);
    }
    let mut curvatures = pull;
    for i in (0..curvatures.len()).rev() {
        curvatures[i] = match curvatures.get(i + 1) {
            Some(next) => (curvatures[i] + tie * next) / (stiffness[i] + tie),
            None => curvatures[i] / stiffness[i],
        };
    }
    curvatures
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    /// Poses on a circle at constant speed.
    fn circle(speed: f64, curvature: f64, count: usize) -> Vec<Pose> {
        (0..count)
            .map(|i| {
                let heading = 0.1 * i as f64 * speed * curvature;
                let position = Vec2::new(heading.sin(), 1.0 - heading.cos()) / curvature;
                Pose { position, heading: wrap(heading) }
            })
            .collect()
    }

    #[test]
    fn circles_have_constant_profiles() {
        let profile = Profile::fit(&circle(6.0, 0.1, 81), 0.1, Smoothing::Jerk);
        assert_eq!((profile.speeds.len(), profile.curvatures.len()), (80, 80));
        for (speed, curvature) in profile.speeds.iter().zip(&profile.curvatures) {
            // The chord along the heading is shorter than the arc.
            assert!((speed - 0.06_f64.sin() / 0.1 / 0.1).abs() < 1e-9, "{speed}");
            assert!((curvature - 0.1).abs() < 1e-3, "{curvature}");
        }
    }

    #[test]
    fn few_poses_are_fitted_exactly() {
        let line = |xs: &[f64]| -> Vec<Pose> {
            xs.iter().map(|&x| Pose { position: Vec2::new(x, 0.0), heading: 0.0 }).collect()
        };
        assert_eq!(Profile::fit(&line(&[1.0]), 0.1, Smoothing::Jerk), Profile::default());
        let profile = Profile::fit(&line(&[0.0, 1.0, 1.5]), 0.1, Smoothing::Jerk);
        assert!((profile.speeds[0] - 10.0).abs() < 1e-12 && (profile.speeds[1] - 5.0).abs() < 1e-12);
    }

    #[test]
    fn standing_still_has_no_speed_and_no_curvature() {
        let profile =
            Profile::fit(&[Pose { position: Vec2::new(3.0, 4.0), heading: 0.5 }; 20], 0.1, Smoothing::Jerk);
        assert!(profile.speeds.iter().chain(&profile.curvatures).all(|value| *value == 0.0));
    }

    #[test]
    fn penalised_accelerations_are_smaller() {
        let braking: Vec<Pose> = (0..41)
            .map(|i| 0.1 * f64::from(i.min(20)))
            .map(|t| Pose { position: Vec2::new(8.0 * t - 2.0 * t * t, 0.0), heading: 0.0 })
            .collect();
        let acceleration = |smoothing| {
            let speeds = Profile::fit(&braking, 0.1, smoothing).speeds;
            speeds.windows(2).map(|pair| (pair[1] - pair[0]).abs() / 0.1).fold(0.0, f64::max)
        };
        let difference = acceleration(Smoothing::Jerk) - acceleration(Smoothing::Acceleration);
        assert!(difference > 0.01, "{difference}");
    }
}
