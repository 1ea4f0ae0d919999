//! The least squares of the tracker.

use super::PREVIEW;
use crate::scene::DT;

/// Weight of speeds against positions, seconds.
const SPEED_WEIGHT: f64 = 0.15;
/// Weight of headings against positions, metres.
const HEADING_WEIGHT: f64 = 1.5;
/// Restrains the change of the acceleration: metres at 1 m/s³.
const CHANGE_RESTRAINT: f64 = 2e-3;
/// Restrains the curvature and its change: metres at 1 1/m and at 1 1/m².
const BEND_RESTRAINT: f64 = 0.02;

/// What positions and speeds of the next poses weigh in the next step's acceleration: the solution of the least squares for an
/// acceleration that changes linearly, which does not depend on the plan.
pub(super) fn gains() -> [(f64, f64); PREVIEW] {
    let w = SPEED_WEIGHT * SPEED_WEIGHT;
    // Response of speed and position after j steps to an acceleration of 1, and to one that grows by 1 per second.
    let mut rows = [[0.0; 4]; PREVIEW];
    let (mut v0, mut v1, mut s0, mut s1) = (0.0, 0.0, 0.0, 0.0);
    for (j, row) in rows.iter_mut().enumerate() {
        v0 += DT;
        v1 += DT * (j as f64 * DT);
        s0 += v0 * DT;
        s1 += v1 * DT;
        *row = [s0, s1, v0, v1];
    }
    let (mut a, mut b, mut c) = (1e-9, 0.0, CHANGE_RESTRAINT * CHANGE_RESTRAINT);
    for [s0, s1, v0, v1] in rows {
        a += s0 * s0 + w * v0 * v0;
        b += s0 * s1 + w * v0 * v1;
        c += s1 * s1 + w * v1 * v1;
    }
    let det = a * c - b * b;
    rows.map(|[s0, s1, v0, v1]| ((c * s0 - b * s1) / det, w * (c * v0 - b * v1) / det))
}

/// A way whose curvature changes linearly, fitted to places ahead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bend {
    /// The normal equations: their matrix (symmetric) and right side.
    matrix: [f64; 3],
    right: [f64; 2],
}

impl Bend {
    pub(super) fn new() -> Self {
        let restraint = BEND_RESTRAINT * BEND_RESTRAINT;
        Self { matrix: [restraint, 0.0, restraint], right: [0.0; 2] }
    }

    /// Takes in a place that is `aside` metres to the left after `way` metres, where the heading is to have turned by `angle`.
    pub(super) fn take(&mut self, way: f64, aside: f64, angle: f64) {
        let w = HEADING_WEIGHT * HEADING_WEIGHT;
        // Offset and turn that a curvature of 1 makes; that of a change of 1 is `change` and `bend`.
        let bend = 0.5 * way * way;
        let change = bend * way / 3.0;
        self.matrix[0] += bend * bend + w * way * way;
        self.matrix[1] += bend * change + w * way * bend;
        self.matrix[2] += change * change + w * bend * bend;
        self.right[0] += bend * aside + w * way * angle;
        self.right[1] += change * aside + w * bend * angle;
    }

    /// The curvature after `way` metres, 1/m.
    pub(super) fn curvature(&self, way: f64) -> f64 {
        let ([a, b, c], [p, q]) = (self.matrix, self.right);
        ((p * c - q * b) + (q * a - p * b) * way) / (a * c - b * b)
    }
}
