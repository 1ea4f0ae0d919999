//! Corners of ego on drivable ground (nuPlan devkit 1.2.2, `drivable_area_compliance`).

use reactsim_geometry::Vec2;

use super::context::Context;
use super::corner_lanes::Corner;
use super::{MetricValue, UndefinedReason};

/// Distance in metres from lane and drivable ground at which a corner is too far off the road
/// (devkit 1.2.2).
const MAX_OUTSIDE_DISTANCE: f64 = 0.3;

/// A corner too far off the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffRoadCorner {
    /// Sample.
    pub step: usize,
    /// Corner.
    pub corner: Corner,
}

/// Result of the metric of the drivable area.
#[derive(Clone, Debug, PartialEq)]
pub struct DrivableAreaCompliance {
    /// 1, or 0 if any corner is too far off the road at any sample.
    pub value: MetricValue,
    /// Whether all corners are in a lane or on drivable ground, per sample; empty if the value is undefined.
    pub corners_inside: Vec<bool>,
    /// Corners too far off the road, by sample.
    pub off_road: Vec<OffRoadCorner>,
}

/// Judges the corners. A corner in a lane is inside, even if the drivable ground leaves out that lane.
pub(super) fn drivable_area(context: &Context<'_>) -> DrivableAreaCompliance {
    let mut corners_inside = Vec::with_capacity(context.samples());
    let mut off_road = Vec::new();
    let mut hint = None;
    for step in 0..context.samples() {
        let mut inside = true;
        for (i, corner) in Corner::ALL.into_iter().enumerate() {
            let p = corner.of(&context.footprints[step]);
            let Some(drivable) = context.history.map.drivable().contains(p, &mut hint) else {
                let value = MetricValue::Undefined(UndefinedReason::NoDrivableArea);
                return DrivableAreaCompliance { value, corners_inside: Vec::new(), off_road: Vec::new() };
            };
            if !drivable && context.lanes().corners[step][i].is_empty() {
                inside = false;
                if is_far(context, step, p) {
                    off_road.push(OffRoadCorner { step, corner });
                }
            }
        }
        corners_inside.push(inside);
    }
    DrivableAreaCompliance { value: MetricValue::pass(off_road.is_empty()), corners_inside, off_road }
}

/// Returns whether `p` is too far from the lanes of the centre and from drivable ground.
fn is_far(context: &Context<'_>, step: usize, p: Vec2) -> bool {
    let map = context.history.map;
    context.lanes().center[step].iter().all(|&lane| map.lane_area(lane).distance(p) >= MAX_OUTSIDE_DISTANCE)
        && map.drivable().is_within(p, MAX_OUTSIDE_DISTANCE) == Some(false)
}
