//! Comfort of simulated proposals (tuplan_garage b51d5d0, `pdm_comfort_metrics`).
//!
//! The bounds are those of nuPlan, but accelerations are smoothed by one quadratic over the whole
//! proposal, so that much more is comfortable.

use std::f64::consts::TAU;

use super::proposals::STEPS;
use crate::EgoState;
use crate::metrics::{PreparedFilter, SavitzkyGolay};
use crate::trajectory::STEP;

/// Number of states of a simulated proposal.
const STATES: usize = STEPS + 1;
/// Number of samples over which accelerations are smoothed before they are differentiated (tuplan_garage
/// b51d5d0, `window_length`).
const ACCELERATION_WINDOW: usize = 8;
/// Number of samples over which headings are differentiated (tuplan_garage b51d5d0, `window_length`).
const HEADING_WINDOW: usize = 5;
/// Scale of the rounding of all series: eight decimals (tuplan_garage b51d5d0, `decimals`).
const ROUNDING: f64 = 1e8;

/// Largest longitudinal acceleration, m/s² (this and all bounds: nuPlan devkit 1.2.2,
/// `ego_is_comfortable`).
const MAX_LONGITUDINAL_ACCELERATION: f64 = 2.40;
/// Least longitudinal acceleration, m/s².
const MIN_LONGITUDINAL_ACCELERATION: f64 = -4.05;
/// Largest magnitude of the lateral acceleration, m/s².
const MAX_LATERAL_ACCELERATION: f64 = 4.89;
/// Largest magnitude of the rate of the magnitude of the acceleration, m/s³.
const MAX_JERK: f64 = 8.37;
/// Largest magnitude of the longitudinal jerk, m/s³.
const MAX_LONGITUDINAL_JERK: f64 = 4.13;
/// Largest magnitude of the yaw rate, rad/s.
const MAX_YAW_RATE: f64 = 0.95;
/// Largest magnitude of the yaw acceleration, rad/s².
const MAX_YAW_ACCELERATION: f64 = 1.93;

/// The filters of the comfort bounds.
#[derive(Clone, Debug)]
pub(super) struct Comfort {
    acceleration: PreparedFilter,
    smoothed: PreparedFilter,
    jerk: PreparedFilter,
    yaw_rate: PreparedFilter,
    yaw_acceleration: PreparedFilter,
}

impl Comfort {
    /// Prepares the filters.
    pub(super) fn new() -> Self {
        let filter = |window: usize, degree: usize, derivative: usize| {
            SavitzkyGolay { window, degree, derivative }.prepare(STATES, STEP)
        };
        Self {
            acceleration: filter(STATES, 2, 0),
            smoothed: filter(ACCELERATION_WINDOW, 2, 0),
            jerk: filter(STATES, 2, 1),
            yaw_rate: filter(HEADING_WINDOW, 2, 1),
            yaw_acceleration: filter(HEADING_WINDOW, 3, 2),
        }
    }

    /// Returns whether the states of a simulated proposal are within all bounds. Accelerations are those
    /// of the rear axle.
    pub(super) fn is_comfortable(&self, states: &[EgoState]) -> bool {
        let series = |of: fn(&EgoState) -> f64| -> Vec<f64> { states.iter().map(of).collect() };
        let (ahead, aside, magnitude) =
            (series(|state| state.ax), series(|state| state.ay), series(EgoState::acceleration));
        let headings = unwrapped(&series(|state| state.heading));
        let longitudinal = rounded(self.acceleration.apply(&ahead))
            .into_iter()
            .all(|value| MIN_LONGITUDINAL_ACCELERATION < value && value < MAX_LONGITUDINAL_ACCELERATION);
        longitudinal
            && all_within(self.acceleration.apply(&aside), MAX_LATERAL_ACCELERATION)
            && all_within(self.jerk_of(&magnitude), MAX_JERK)
            && all_within(self.jerk_of(&ahead), MAX_LONGITUDINAL_JERK)
            && all_within(self.yaw_acceleration.apply(&headings), MAX_YAW_ACCELERATION)
            && all_within(self.yaw_rate.apply(&headings), MAX_YAW_RATE)
    }

    /// Returns the rate of accelerations, m/s³.
    fn jerk_of(&self, accelerations: &[f64]) -> Vec<f64> {
        self.jerk.apply(&rounded(self.smoothed.apply(accelerations)))
    }
}

/// Returns whether all rounded values are closer to 0 than `bound`.
fn all_within(values: Vec<f64>, bound: f64) -> bool {
    rounded(values).into_iter().all(|value| value.abs() < bound)
}

fn rounded(mut values: Vec<f64>) -> Vec<f64> {
    values.iter_mut().for_each(|value| *value = (*value * ROUNDING).round_ties_even() / ROUNDING);
    values
}

/// Returns headings from which whole turns are removed, so that they do not jump.
fn unwrapped(headings: &[f64]) -> Vec<f64> {
    let mut turns = 0.0;
    let mut before = headings.first().copied().unwrap_or_default();
    let unwrap = |&heading: &f64| {
        turns += ((heading - before) / TAU).round_ties_even();
        before = heading;
        heading - TAU * turns
    };
    headings.iter().map(unwrap).collect()
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    fn states(of: impl Fn(usize) -> EgoState) -> Vec<EgoState> {
        (0..STATES).map(of).collect()
    }

    #[test]
    fn bounds_are_strict() {
        let still = EgoState::standing(Vec2::zeros(), 0.0);
        let comfort = Comfort::new();
        let accelerating = |ax: f64| comfort.is_comfortable(&states(|_| EgoState { ax, ..still }));
        assert!(accelerating(2.39) && !accelerating(2.41) && accelerating(-4.04) && !accelerating(-4.06));
        let turning = |rate: f64| {
            comfort.is_comfortable(&states(|i| EgoState {
                heading: reactsim_geometry::wrap(3.0 + rate * STEP * i as f64),
                ..still
            }))
        };
        assert!(turning(0.94) && !turning(0.96));
    }
}
