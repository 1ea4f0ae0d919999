//! The least-squares fits of the tracker.

use super::PREVIEW_POSES;
use crate::DT;

/// Weight of speed errors relative to position errors, seconds.
const SPEED_WEIGHT: f64 = 0.15;
/// Weight of heading errors relative to position errors, metres.
const HEADING_WEIGHT: f64 = 1.5;
/// Regularisation of the jerk: penalty, as a position error in metres, at 1 m/s³.
const JERK_PENALTY: f64 = 2e-3;
/// Regularisation of the curvature and its rate of change: penalty, as a position error in metres,
/// at 1 1/m and at 1 1/m².
const CURVATURE_PENALTY: f64 = 0.02;

/// Returns the weights of position and speed errors of the next poses in the acceleration of the
/// next step.
///
/// They solve the least squares for an acceleration that changes linearly, and do not depend on the
/// plan.
pub(super) fn gains() -> [(f64, f64); PREVIEW_POSES] {
    let w = SPEED_WEIGHT * SPEED_WEIGHT;
    // Response of speed and position after j steps to an acceleration of 1, and to one that grows
    // by 1 per second.
    let mut rows = [[0.0; 4]; PREVIEW_POSES];
    let (mut v0, mut v1, mut s0, mut s1) = (0.0, 0.0, 0.0, 0.0);
    for (j, row) in rows.iter_mut().enumerate() {
        v0 += DT;
        v1 += DT * (j as f64 * DT);
        s0 += v0 * DT;
        s1 += v1 * DT;
        *row = [s0, s1, v0, v1];
    }
    let (mut a, mut b, mut c) = (1e-9, 0.0, JERK_PENALTY * JERK_PENALTY);
    for [s0, s1, v0, v1] in rows {
        a += s0 * s0 + w * v0 * v0;
        b += s0 * s1 + w * v0 * v1;
        c += s1 * s1 + w * v1 * v1;
    }
    let det = a * c - b * b;
    rows.map(|[s0, s1, v0, v1]| ((c * s0 - b * s1) / det, w * (c * v0 - b * v1) / det))
}

/// Least-squares fit of a path with linearly changing curvature to positions and headings ahead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bend {
    /// The normal equations: upper triangle of the symmetric matrix, and right-hand side.
    matrix: [f64; 3],
    right: [f64; 2],
}

impl Bend {
    pub(super) fn new() -> Self {
        let penalty = CURVATURE_PENALTY * CURVATURE_PENALTY;
        Self { matrix: [penalty, 0.0, penalty], right: [0.0; 2] }
    }

    /// Adds a pose `aside` metres to the left, after `arc` metres of travel, where the heading has
    /// turned by `angle`.
    pub(super) fn take(&mut self, arc: f64, aside: f64, angle: f64) {
        let w = HEADING_WEIGHT * HEADING_WEIGHT;
        // `bend` and `change` are the offsets due to a curvature of 1 1/m and a curvature rate of 1
        // 1/m²; the respective heading changes are `arc` and `bend`.
        let bend = 0.5 * arc * arc;
        let change = bend * arc / 3.0;
        self.matrix[0] += bend * bend + w * arc * arc;
        self.matrix[1] += bend * change + w * arc * bend;
        self.matrix[2] += change * change + w * bend * bend;
        self.right[0] += bend * aside + w * arc * angle;
        self.right[1] += change * aside + w * bend * angle;
    }

    /// Returns the fitted curvature after `arc` metres, 1/m.
    pub(super) fn curvature(&self, arc: f64) -> f64 {
        let ([a, b, c], [p, q]) = (self.matrix, self.right);
        ((p * c - q * b) + (q * a - p * b) * arc) / (a * c - b * b)
    }
}
