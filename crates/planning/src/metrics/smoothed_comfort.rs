//! Comfort of PDM-Closed's proposals (tuplan_garage b51d5d0, `pdm_comfort_metrics`).
//!
//! The bounds are those of nuPlan, but accelerations are smoothed by one quadratic over the whole drive, so
//! that much more is comfortable.

use crate::EgoState;
use crate::trajectory::STEP;

use super::comfort::{
    ACCELERATION_FILTER, JERK_BOUNDS, LATERAL_ACCELERATION_BOUNDS, LONGITUDINAL_ACCELERATION_BOUNDS,
    LONGITUDINAL_JERK_BOUNDS, YAW_ACCELERATION_BOUNDS, YAW_ACCELERATION_FILTER, YAW_RATE_BOUNDS,
    YAW_RATE_FILTER, are_within, rounded, unwrapped,
};
use super::{PreparedFilter, SavitzkyGolay};

/// Smoothing of accelerations over the whole drive (tuplan_garage b51d5d0, `window_length`).
const WHOLE_FILTER: SavitzkyGolay = SavitzkyGolay { window: usize::MAX, degree: 2, derivative: 0 };
/// Derivative of smoothed accelerations over the whole drive (tuplan_garage b51d5d0, `window_length`).
const WHOLE_JERK_FILTER: SavitzkyGolay = SavitzkyGolay { derivative: 1, ..WHOLE_FILTER };

/// The filters of the comfort bounds.
#[derive(Clone, Debug)]
pub(crate) struct SmoothedComfort {
    acceleration: PreparedFilter,
    smoothed: PreparedFilter,
    jerk: PreparedFilter,
    yaw_rate: PreparedFilter,
    yaw_acceleration: PreparedFilter,
}

impl SmoothedComfort {
    /// Prepares the filters for sequences of `count` states.
    pub(crate) fn new(count: usize) -> Self {
        let prepared = |filter: SavitzkyGolay| filter.prepare(count, STEP);
        Self {
            acceleration: prepared(WHOLE_FILTER),
            smoothed: prepared(ACCELERATION_FILTER),
            jerk: prepared(WHOLE_JERK_FILTER),
            yaw_rate: prepared(YAW_RATE_FILTER),
            yaw_acceleration: prepared(YAW_ACCELERATION_FILTER),
        }
    }

    /// Returns whether the states of a drive are within all bounds, by the accelerations of
    /// the rear axle.
    pub(crate) fn is_comfortable(&self, states: &[EgoState]) -> bool {
        let series = |of: fn(&EgoState) -> f64| -> Vec<f64> { states.iter().map(of).collect() };
        let (ahead, aside, magnitude) =
            (series(|state| state.ax), series(|state| state.ay), series(EgoState::acceleration));
        let headings = unwrapped(&series(|state| state.heading));
        let holds = |values: Vec<f64>, bounds| are_within(&rounded(values), bounds);
        holds(self.acceleration.apply(&ahead), LONGITUDINAL_ACCELERATION_BOUNDS)
            && holds(self.acceleration.apply(&aside), LATERAL_ACCELERATION_BOUNDS)
            && holds(self.jerk_of(&magnitude), JERK_BOUNDS)
            && holds(self.jerk_of(&ahead), LONGITUDINAL_JERK_BOUNDS)
            && holds(self.yaw_acceleration.apply(&headings), YAW_ACCELERATION_BOUNDS)
            && holds(self.yaw_rate.apply(&headings), YAW_RATE_BOUNDS)
    }

    /// Returns the rate of accelerations, m/s³.
    fn jerk_of(&self, accelerations: &[f64]) -> Vec<f64> {
        self.jerk.apply(&rounded(self.smoothed.apply(accelerations)))
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    /// Number of states of a simulated proposal.
    const STATES: usize = 41;

    fn states(of: impl Fn(usize) -> EgoState) -> Vec<EgoState> {
        (0..STATES).map(of).collect()
    }

    #[test]
    fn bounds_are_strict() {
        let still = EgoState::standing(Vec2::zeros(), 0.0);
        let comfort = SmoothedComfort::new(STATES);
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
