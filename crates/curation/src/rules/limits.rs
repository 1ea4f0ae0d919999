//! Speed limits along a path, and the lanes that decide them.

use reactsim_geometry::{Vec2, wrap};
use reactsim_scene::dynamics::AxlePath;
use reactsim_scene::{LaneHit, Road};

/// Tolerances within which the speed limit of a lane applies.
const SPEED_LIMIT_LANE: LaneTolerance = LaneTolerance { distance: 3.0, angle: 0.6 };

/// Largest lateral acceleration for which paths are planned, m/s².
pub(super) const MAX_LATERAL_ACCELERATION: f64 = 2.8;

/// Speed limits along a path.
pub(super) struct Limits(Vec<f64>);

impl Limits {
    /// Distance between two samples, metres.
    const SPACING: f64 = 5.0;

    /// Samples the speed limits of the lanes under a path, m/s, none below `least`. There is no limit
    /// off the lanes and on lanes without one.
    pub(super) fn along(road: &Road<'_>, path: &AxlePath, least: f64) -> Self {
        let mut limits = Vec::new();
        for i in 0..path.poses() {
            let (pose, s) = path.pose(i);
            if s >= limits.len() as f64 * Self::SPACING {
                let limit = lane_limit(road, pose.position, pose.heading);
                limits.push(limit.map_or(f64::INFINITY, |l| l.max(least)));
            }
        }
        Self(limits)
    }

    /// Returns the limit at arc length `s`, m/s.
    pub(super) fn at(&self, s: f64) -> f64 {
        let i = (s / Self::SPACING) as usize;
        self.0.get(i).or(self.0.last()).copied().unwrap_or(f64::INFINITY)
    }
}

/// Returns the speed limit of the lane at a pose, m/s, if known.
pub(super) fn lane_limit(road: &Road<'_>, p: Vec2, heading: f64) -> Option<f64> {
    road.lane(lane_along(road, p, heading, SPEED_LIMIT_LANE)?.lane).speed_limit
}

/// Tolerances within which a pose counts as on a lane.
#[derive(Clone, Copy)]
pub(super) struct LaneTolerance {
    /// Largest distance from the centre line, metres.
    pub(super) distance: f64,
    /// Largest angle to the lane, radians.
    pub(super) angle: f64,
}

/// Returns the lane that suits a pose best among those within the tolerances.
pub(super) fn lane_along(
    road: &Road<'_>,
    p: Vec2,
    heading: f64,
    tolerance: LaneTolerance,
) -> Option<LaneHit> {
    let mut hits: Vec<LaneHit> = Vec::new();
    road.lanes_near(p, tolerance.distance, &mut hits);
    let off = |h: &LaneHit| wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - heading).abs();
    let cost = |h: &LaneHit| h.projection.distance + 2.0 * off(h);
    let along = hits.into_iter().filter(|h| off(h) < tolerance.angle);
    along.min_by(|a, b| cost(a).total_cmp(&cost(b)))
}
