//! Motion against the driving direction (nuPlan devkit 1.2.2, `driving_direction_compliance`).

use super::context::Context;
use super::matched_lanes::matched_lanes;
use super::{MetricValue, UndefinedReason};

/// Distance in metres against the direction, within one horizon, below which the value is 1 (devkit 1.2.2).
const COMPLIANCE_DISTANCE: f64 = 2.0;
/// Distance in metres against the direction, within one horizon, from which the value is 0 (devkit 1.2.2).
const VIOLATION_DISTANCE: f64 = 6.0;
/// Value between the two distances (devkit 1.2.2).
const PARTIAL_VALUE: f64 = 0.5;
/// Number of samples of the horizon of 1 s. Sums are over one increment more, 1.1 s (devkit 1.2.2).
const HORIZON_SAMPLES: usize = 10;

/// Result of the metric of the driving direction.
#[derive(Clone, Debug, PartialEq)]
pub struct DrivingDirection {
    /// 1, 0.5 or 0.
    pub value: MetricValue,
    /// Progress along the lane within the horizon that ends at each sample, metres, negative against the
    /// driving direction; empty if the value is undefined.
    pub progress: Vec<f64>,
    /// Smallest progress, metres; at most 0.
    pub lowest: f64,
    /// Sample at which it is reached.
    pub lowest_step: usize,
}

impl DrivingDirection {
    /// Returns the first and the last sample of the horizon in which the smallest progress is reached.
    pub fn lowest_horizon(&self) -> [usize; 2] {
        [self.lowest_step.saturating_sub(HORIZON_SAMPLES), self.lowest_step]
    }
}

/// Judges the driving direction. Reversing in the own lane is motion against the direction too.
pub(super) fn driving_direction(context: &Context<'_>) -> DrivingDirection {
    if !context.has_lanes() {
        let value = MetricValue::Undefined(UndefinedReason::NoLanes);
        return DrivingDirection { value, progress: Vec::new(), lowest: 0.0, lowest_step: 0 };
    }
    let increments = increments(context);
    let horizon = |k: usize| &increments[k.saturating_sub(HORIZON_SAMPLES)..=k];
    let progress: Vec<f64> = (0..increments.len()).map(|k| horizon(k).iter().sum()).collect();
    let (lowest_step, lowest) = progress
        .iter()
        .copied()
        .enumerate()
        .fold((0, 0.0), |best, here| if here.1 < best.1 { here } else { best });
    let value = MetricValue::Defined(score(-lowest));
    DrivingDirection { value, progress, lowest, lowest_step }
}

fn score(against: f64) -> f64 {
    if against < COMPLIANCE_DISTANCE {
        1.0
    } else if against < VIOLATION_DISTANCE {
        PARTIAL_VALUE
    } else {
        0.0
    }
}

/// Returns the progress along the lane since the previous sample, metres, per sample.
///
/// A change of lane gives 0 at two samples, and so does a projection on the very start of the lane
/// (devkit 1.2.2).
fn increments(context: &Context<'_>) -> Vec<f64> {
    let mut lane_before: Option<usize> = None;
    let mut arc_before: Option<f64> = None;
    let mut increments = Vec::with_capacity(context.samples());
    let (history, centers, lanes) = (context.history, &context.centers, context.lanes());
    let lanes = matched_lanes(history.map, &lanes.center, history.ego, centers, lanes.overlap);
    for (k, lane) in lanes.into_iter().enumerate() {
        let Some(lane) = lane else {
            increments.push(0.0);
            continue;
        };
        let s = history.map.lane(lane).baseline.project(centers[k]).s;
        if k > 0 && lane_before != Some(lane) {
            arc_before = None;
            increments.push(0.0);
        } else {
            let moved = arc_before.filter(|_| s != 0.0).map_or(0.0, |before| s - before);
            arc_before = Some(s);
            increments.push(moved);
        }
        lane_before = Some(lane);
    }
    increments
}
