//! Excess over the speed limit (nuPlan devkit 1.2.2, `speed_limit_compliance`).

use crate::PlanningMap;

use super::context::Context;
use super::{MetricValue, MissingInputs, UndefinedReason};
use crate::STEP;

/// Mean excess in m/s that gives 0 (devkit 1.2.2).
const MAX_OVERSPEED: f64 = 2.23;

/// Result of the metric of the speed limit.
#[derive(Clone, Debug, PartialEq)]
pub struct SpeedLimitCompliance {
    /// 1 without excess, falling to 0 for a mean excess of 2.23 m/s.
    pub value: MetricValue,
    /// Excess over the limit, m/s, per sample; 0 in no lane and where the limit is unknown.
    pub overspeed: Vec<f64>,
    /// Samples with a lane whose limit is unknown.
    pub unknown_steps: Vec<usize>,
}

/// Judges the speed of the rear axle.
pub(super) fn speed_limit(context: &Context<'_>) -> SpeedLimitCompliance {
    let history = context.history;
    let (mut overspeed, mut unknown_steps) = (Vec::with_capacity(context.samples()), Vec::new());
    for (step, lanes) in context.lanes().center.iter().enumerate() {
        let limit = limit_of(history.map, lanes);
        if limit.is_none() && !lanes.is_empty() {
            unknown_steps.push(step);
        }
        overspeed.push(limit.map_or(0.0, |limit| (history.ego[step].speed() - limit).max(0.0)));
    }
    let value = match history.missing {
        MissingInputs::Undefined if !context.has_lanes() => MetricValue::Undefined(UndefinedReason::NoLanes),
        MissingInputs::Undefined if !unknown_steps.is_empty() => {
            MetricValue::Undefined(UndefinedReason::UnknownSpeedLimits)
        }
        _ => MetricValue::Defined(score(&overspeed)),
    };
    SpeedLimitCompliance { value, overspeed, unknown_steps }
}

/// Returns the value: n samples of excess over n - 1 intervals.
fn score(overspeed: &[f64]) -> f64 {
    if overspeed.iter().all(|&excess| excess == 0.0) {
        return 1.0;
    }
    let violation = overspeed.iter().sum::<f64>() * STEP;
    let duration = (overspeed.len() - 1) as f64 * STEP;
    (1.0 - violation / (MAX_OVERSPEED * duration)).max(0.0)
}

/// Returns the limit in these lanes, m/s: that of the lane; in connectors the largest limit of the lanes
/// before and after them. Maps of connectors only have limits of their own. `None` in no lane and if one of
/// the limits is unknown.
fn limit_of(map: &PlanningMap, lanes: &[usize]) -> Option<f64> {
    let first = *lanes.first()?;
    if !map.lane(first).is_connector() {
        return known_limit(map, first);
    }
    if map.has_connectors_only() {
        return largest_limit(map, lanes.iter().copied());
    }
    let linked = lanes.iter().flat_map(|&lane| {
        let lane = map.lane(lane);
        lane.predecessors.iter().chain(&lane.successors).copied()
    });
    largest_limit(map, linked)
}

/// Returns the largest limit of some lanes; `None` without lanes and if one of the limits is unknown.
fn largest_limit(map: &PlanningMap, lanes: impl Iterator<Item = usize>) -> Option<f64> {
    let limits: Option<Vec<f64>> = lanes.map(|lane| known_limit(map, lane)).collect();
    limits?.into_iter().reduce(f64::max)
}

/// Returns the limit of a lane; 0 means unknown.
fn known_limit(map: &PlanningMap, lane: usize) -> Option<f64> {
    map.lane(lane).speed_limit.filter(|&limit| limit > 0.0)
}
