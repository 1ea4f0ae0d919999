//! Mean speed of ego (nuPlan devkit 1.2.2, `ego_mean_speed`). It is not part of the score.

use crate::EgoState;

/// Returns the mean speed of the rear axle, m/s; 0 without samples.
pub(super) fn mean_speed(ego: &[EgoState]) -> f64 {
    let total: f64 = ego.iter().map(EgoState::speed).sum();
    total / ego.len().max(1) as f64
}
