//! Comfort: accelerations, jerks and yaw rates (nuPlan devkit 1.2.2, `ego_is_comfortable`).

use std::f64::consts::TAU;

use crate::{EgoShape, EgoState, STEP};

use super::{MetricValue, PreparedFilter, SavitzkyGolay};

/// Smoothing of accelerations (devkit 1.2.2).
pub(crate) const ACCELERATION_FILTER: SavitzkyGolay = SavitzkyGolay { window: 8, degree: 2, derivative: 0 };
/// Derivative of smoothed accelerations (devkit 1.2.2).
const JERK_FILTER: SavitzkyGolay = SavitzkyGolay { window: 15, degree: 2, derivative: 1 };
/// First derivative of the heading. The devkit declares a window of 15 for it, but uses 5 (devkit 1.2.2).
pub(crate) const YAW_RATE_FILTER: SavitzkyGolay = SavitzkyGolay { window: 5, degree: 2, derivative: 1 };
/// Second derivative of the heading (devkit 1.2.2).
pub(crate) const YAW_ACCELERATION_FILTER: SavitzkyGolay =
    SavitzkyGolay { window: 5, degree: 3, derivative: 2 };

/// Bounds of the longitudinal acceleration, m/s² (devkit 1.2.2).
pub(crate) const LONGITUDINAL_ACCELERATION_BOUNDS: [f64; 2] = [-4.05, 2.40];
/// Bounds of the lateral acceleration, m/s² (devkit 1.2.2).
pub(crate) const LATERAL_ACCELERATION_BOUNDS: [f64; 2] = [-4.89, 4.89];
/// Bounds of the jerk, m/s³ (devkit 1.2.2).
pub(crate) const JERK_BOUNDS: [f64; 2] = [-8.37, 8.37];
/// Bounds of the longitudinal jerk, m/s³ (devkit 1.2.2).
pub(crate) const LONGITUDINAL_JERK_BOUNDS: [f64; 2] = [-4.13, 4.13];
/// Bounds of the yaw rate, rad/s (devkit 1.2.2).
pub(crate) const YAW_RATE_BOUNDS: [f64; 2] = [-0.95, 0.95];
/// Bounds of the yaw acceleration, rad/s² (devkit 1.2.2).
pub(crate) const YAW_ACCELERATION_BOUNDS: [f64; 2] = [-1.93, 1.93];

/// Number of units per unit after the decimal point to which filtered values are rounded (devkit 1.2.2).
const ROUNDING: f64 = 1e8;

/// A filtered quantity with its verdict.
#[derive(Clone, Debug, PartialEq)]
pub struct ComfortQuantity {
    /// Filtered value per sample.
    pub values: Vec<f64>,
    /// Lower and upper bound, both excluded.
    pub bounds: [f64; 2],
    /// Whether all values are within the bounds.
    pub within: bool,
}

/// Result of the comfort metric.
#[derive(Clone, Debug, PartialEq)]
pub struct Comfort {
    /// 1 if all quantities are within their bounds, else 0.
    pub value: MetricValue,
    /// Acceleration of the centre along the heading, by nuPlan's rule, m/s².
    pub longitudinal_acceleration: ComfortQuantity,
    /// Acceleration of the centre to the left, by nuPlan's rule, m/s².
    pub lateral_acceleration: ComfortQuantity,
    /// Derivative of the magnitude of the acceleration of the rear axle, m/s³.
    pub jerk: ComfortQuantity,
    /// Derivative of the longitudinal acceleration, m/s³.
    pub longitudinal_jerk: ComfortQuantity,
    /// Derivative of the heading, rad/s.
    pub yaw_rate: ComfortQuantity,
    /// Second derivative of the heading, rad/s².
    pub yaw_acceleration: ComfortQuantity,
}

impl Comfort {
    /// Returns the quantities with their ids, in the order of the fields.
    pub fn quantities(&self) -> [(&'static str, &ComfortQuantity); 6] {
        [
            ("longitudinal-acceleration", &self.longitudinal_acceleration),
            ("lateral-acceleration", &self.lateral_acceleration),
            ("jerk", &self.jerk),
            ("longitudinal-jerk", &self.longitudinal_jerk),
            ("yaw-rate", &self.yaw_rate),
            ("yaw-acceleration", &self.yaw_acceleration),
        ]
    }
}

/// The filters of the metric for one number of samples.
#[derive(Clone, Debug)]
pub(super) struct ComfortFilters {
    acceleration: PreparedFilter,
    jerk: PreparedFilter,
    yaw_rate: PreparedFilter,
    yaw_acceleration: PreparedFilter,
}

impl ComfortFilters {
    pub(super) fn new(samples: usize) -> Self {
        let prepared = |filter: SavitzkyGolay| filter.prepare(samples, STEP);
        Self {
            acceleration: prepared(ACCELERATION_FILTER),
            jerk: prepared(JERK_FILTER),
            yaw_rate: prepared(YAW_RATE_FILTER),
            yaw_acceleration: prepared(YAW_ACCELERATION_FILTER),
        }
    }
}

/// Judges the comfort of ego, whose states must be as many as the filters are prepared for.
pub(super) fn comfort(ego: &[EgoState], shape: &EgoShape, filters: &ComfortFilters) -> Comfort {
    let of = |quantity: &dyn Fn(&EgoState) -> f64| ego.iter().map(quantity).collect::<Vec<_>>();
    let center = |state: &EgoState| state.center_acceleration_nuplan(shape);
    let ComfortFilters { acceleration, jerk, yaw_rate, yaw_acceleration } = filters;
    let longitudinal = filtered(acceleration, &of(&|state| center(state).x));
    let lateral = filtered(acceleration, &of(&|state| center(state).y));
    let magnitude = filtered(acceleration, &of(&EgoState::acceleration));
    let headings = unwrapped(&of(&|state| state.heading));
    let mut comfort = Comfort {
        value: MetricValue::pass(false),
        jerk: judged(filtered(jerk, &magnitude), JERK_BOUNDS),
        longitudinal_jerk: judged(filtered(jerk, &longitudinal), LONGITUDINAL_JERK_BOUNDS),
        longitudinal_acceleration: judged(longitudinal, LONGITUDINAL_ACCELERATION_BOUNDS),
        lateral_acceleration: judged(lateral, LATERAL_ACCELERATION_BOUNDS),
        yaw_rate: judged(filtered(yaw_rate, &headings), YAW_RATE_BOUNDS),
        yaw_acceleration: judged(filtered(yaw_acceleration, &headings), YAW_ACCELERATION_BOUNDS),
    };
    let within = comfort.quantities().iter().all(|(_, quantity)| quantity.within);
    comfort.value = MetricValue::pass(within);
    comfort
}

/// Returns whether all quantities of [`comfort`] are within their bounds at the last state of ego.
pub(super) fn is_comfortable_now(ego: &[EgoState], shape: &EgoShape, filters: &ComfortFilters) -> bool {
    let of = |quantity: &dyn Fn(&EgoState) -> f64| ego.iter().map(quantity).collect::<Vec<_>>();
    let last = |filter: &PreparedFilter, values: &[f64]| filter.last(values).map(round);
    let is_within = |value: Option<f64>, bounds| value.is_none_or(|value| are_within(&[value], bounds));
    let ComfortFilters { acceleration, jerk, yaw_rate, yaw_acceleration } = filters;
    let longitudinal = filtered(acceleration, &of(&|state| state.center_acceleration_nuplan(shape).x));
    let lateral = of(&|state| state.center_acceleration_nuplan(shape).y);
    let headings = unwrapped(&of(&|state| state.heading));
    is_within(last(yaw_rate, &headings), YAW_RATE_BOUNDS)
        && is_within(last(yaw_acceleration, &headings), YAW_ACCELERATION_BOUNDS)
        && is_within(longitudinal.last().copied(), LONGITUDINAL_ACCELERATION_BOUNDS)
        && is_within(last(acceleration, &lateral), LATERAL_ACCELERATION_BOUNDS)
        && is_within(last(jerk, &longitudinal), LONGITUDINAL_JERK_BOUNDS)
        && is_within(last(jerk, &filtered(acceleration, &of(&EgoState::acceleration))), JERK_BOUNDS)
}

fn judged(values: Vec<f64>, bounds: [f64; 2]) -> ComfortQuantity {
    let within = are_within(&values, bounds);
    ComfortQuantity { values, bounds, within }
}

/// Returns whether all values are between a lower and an upper bound, both excluded.
pub(crate) fn are_within(values: &[f64], [lower, upper]: [f64; 2]) -> bool {
    values.iter().all(|&value| lower < value && value < upper)
}

/// Filters and rounds values.
fn filtered(filter: &PreparedFilter, values: &[f64]) -> Vec<f64> {
    rounded(filter.apply(values))
}

/// Rounds values to eight decimals.
pub(crate) fn rounded(mut values: Vec<f64>) -> Vec<f64> {
    values.iter_mut().for_each(|value| *value = round(*value));
    values
}

fn round(value: f64) -> f64 {
    (value * ROUNDING).round_ties_even() / ROUNDING
}

/// Removes the jumps of whole turns between successive headings.
pub(crate) fn unwrapped(headings: &[f64]) -> Vec<f64> {
    let mut turns = 0.0;
    let mut before = headings.first().copied();
    let unwrap = |&heading: &f64| {
        turns += ((heading - before.unwrap_or(heading)) / TAU).round_ties_even();
        before = Some(heading);
        heading - turns * TAU
    };
    headings.iter().map(unwrap).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_are_continuous_after_unwrapping() {
        let continuous = unwrapped(&[3.0, -3.1, -3.0, 3.1]);
        assert!(continuous.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.3));
        assert_eq!(continuous[0], 3.0);
    }

    #[test]
    fn values_on_a_bound_violate_it() {
        assert!(!judged(vec![0.0, 2.40], LONGITUDINAL_ACCELERATION_BOUNDS).within);
        assert!(judged(vec![-4.0, 2.39], LONGITUDINAL_ACCELERATION_BOUNDS).within);
    }

    #[test]
    fn the_last_state_is_judged_as_the_last_of_all() {
        let mut counts = [0; 2];
        for k in 0..600 {
            let (samples, scale) = (4 + k % 14, f64::from(k as u32 % 9));
            let at = |i: usize| {
                let wave = |rate: f64| scale * (rate * (k + i) as f64).sin();
                let still = EgoState::standing(reactsim_geometry::Vec2::zeros(), 0.02 * wave(0.3));
                EgoState { ax: wave(0.1), ay: wave(0.07), yaw_rate: 0.1 * wave(0.2), ..still }
            };
            let (ego, shape) = ((0..samples).map(at).collect::<Vec<_>>(), EgoShape::PACIFICA);
            let filters = ComfortFilters::new(samples);
            let all = comfort(&ego, &shape, &filters);
            let is_last_within = all
                .quantities()
                .iter()
                .all(|(_, found)| are_within(&found.values[samples - 1..], found.bounds));
            assert_eq!(is_comfortable_now(&ego, &shape, &filters), is_last_within);
            counts[usize::from(is_last_within)] += 1;
        }
        assert!(counts.iter().all(|count| *count > 50), "{counts:?}");
    }
}
