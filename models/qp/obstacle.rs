//! Obstacles: boxes at the times at which bounds are checked, and the parts of a path that they occupy.

use reactsim_geometry::{Bounds, OrientedBox, Vec2, left};
use reactsim_scene::Road;

use super::path::{Path, STATIONS};
use super::speed::CHECKED;

/// Number of times at which an obstacle is known: now, and the checked steps.
pub(super) const TIMES: usize = CHECKED.len() + 1;

/// Returns the step of a time index.
pub(super) fn step_of(time: usize) -> usize {
    if time == 0 { 0 } else { CHECKED[time - 1] }
}

/// A moving agent or a static object over the next seconds.
#[derive(Clone, Debug)]
pub(super) struct Obstacle {
    pub(super) boxes: [OrientedBox; TIMES],
    /// Velocities at the same times, m/s.
    pub(super) velocities: [Vec2; TIMES],
    /// Bounds of all boxes.
    pub(super) bounds: Bounds,
    /// Whether the obstacle is the AV.
    pub(super) is_av: bool,
    /// Last time index at which a vehicle waits for this obstacle when it crosses; not used for
    /// leaders.
    pub(super) crossing_horizon: usize,
    /// Whether the obstacle counts only as a leader: vehicles follow it but do not wait for it when it
    /// crosses, because it yields itself or its plan is unknown.
    pub(super) leader_only: bool,
    /// Lateral clearance, metres.
    pub(super) side: f64,
    /// Present height of the road under it, metres; NaN if unknown, and in scenarios of one level.
    pub(super) height: f64,
}

impl Obstacle {
    /// Creates an obstacle from its boxes.
    pub(super) fn new(boxes: [OrientedBox; TIMES], velocities: [Vec2; TIMES]) -> Self {
        let mut bounds = Bounds::EMPTY;
        for b in &boxes {
            bounds = bounds.union(&Bounds::around(b.center, b.radius()));
        }
        Self {
            boxes,
            velocities,
            bounds,
            is_av: false,
            crossing_horizon: TIMES,
            leader_only: false,
            side: 0.0,
            height: f64::NAN,
        }
    }

    /// Creates a static obstacle.
    pub(super) fn standing(b: OrientedBox) -> Self {
        Self::new([b; TIMES], [Vec2::zeros(); TIMES])
    }

    pub(super) fn at_height(self, height: f64) -> Self {
        Self { height, ..self }
    }

    /// Returns whether the obstacle is on another level than a vehicle at `p` with this height.
    pub(super) fn is_apart(&self, road: &Road<'_>, p: Vec2, height: f64) -> bool {
        road.is_apart((self.boxes[0].center, self.height), (p, height))
    }

    /// Returns the speed at a time, m/s: negative if it is in reverse.
    pub(super) fn speed(&self, time: usize) -> f64 {
        let velocity = self.velocities[time];
        let speed = velocity.norm();
        if velocity.dot(&self.boxes[time].axis) < 0.0 { -speed } else { speed }
    }

    /// Returns whether the obstacle never moves.
    pub(super) fn stands(&self) -> bool {
        self.velocities.iter().all(|v| v.norm_squared() < 0.04)
    }
}

/// The part of a path that an obstacle occupies at a time: a vehicle whose centre is between the two
/// arc lengths touches it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Span {
    /// First arc length, metres.
    pub(super) from: f64,
    /// Last arc length, metres.
    pub(super) to: f64,
    /// Speed of the obstacle along the path, m/s.
    pub(super) speed: f64,
}

/// Half extents of a vehicle, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub(super) length: f64,
    pub(super) width: f64,
}

impl Extent {
    /// Returns the box with this centre and this unit vector along its length.
    pub(super) fn at(self, center: Vec2, axis: Vec2) -> OrientedBox {
        OrientedBox { center, axis, half_length: self.length, half_width: self.width }
    }
}

/// Returns the part of a path that an obstacle occupies at each time.
pub(super) fn spans(path: &Path, me: Extent, obstacle: &Obstacle) -> [Option<Span>; TIMES] {
    let mut spans = [None; TIMES];
    let side = obstacle.side;
    let reach = me.length + me.width + side;
    let mut near = Bounds::EMPTY;
    for station in &path.stations {
        near = near.union(&Bounds::around(station.centre, reach));
    }
    if !near.intersects(&obstacle.bounds) {
        return spans;
    }
    let stands = obstacle.stands();
    for time in 0..TIMES {
        if stands && time > 0 {
            spans[time] = spans[0];
            continue;
        }
        let b = &obstacle.boxes[time];
        let limit = reach + b.half_length + b.half_width + path.spacing;
        for (j, station) in path.stations.iter().enumerate() {
            let d = b.center - station.centre;
            if d.norm_squared() > limit * limit {
                continue;
            }
            let Some((low, high)) = extent_between(b, station.centre, station.axis, me.width + side) else {
                continue;
            };
            // The stretch of the path that this station represents.
            let before = if j == 0 { f64::INFINITY } else { 0.6 * path.spacing };
            let after = if j == STATIONS { f64::INFINITY } else { 0.6 * path.spacing };
            if high < -me.length - before || low > me.length + after {
                continue;
            }
            let here = Span {
                from: station.arc + low - me.length,
                to: station.arc + high + me.length,
                speed: obstacle.velocities[time].dot(&station.axis),
            };
            spans[time] = Some(match spans[time] {
                None => here,
                Some(s) if here.from < s.from => Span { to: s.to.max(here.to), ..here },
                Some(s) => Span { to: s.to.max(here.to), ..s },
            });
        }
    }
    spans
}

/// Returns the extent of a box along an axis through `centre`, limited to its part within `width` of
/// the axis: the smallest and the largest coordinate.
fn extent_between(b: &OrientedBox, centre: Vec2, axis: Vec2, width: f64) -> Option<(f64, f64)> {
    let aside = left(axis);
    let corners = b.corners().map(|c| {
        let d = c - centre;
        (d.dot(&axis), d.dot(&aside))
    });
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut take = |x: f64| (low, high) = (low.min(x), high.max(x));
    for i in 0..4 {
        let (p, q) = (corners[i], corners[(i + 1) % 4]);
        if p.1.abs() <= width {
            take(p.0);
        }
        for edge in [-width, width] {
            if (p.1 < edge) != (q.1 < edge) {
                take(p.0 + (q.0 - p.0) * (edge - p.1) / (q.1 - p.1));
            }
        }
    }
    (low <= high).then_some((low, high))
}

/// Returns the lateral extent of an obstacle next to a box of half length `length`: smallest and
/// largest offset from the axis, metres, left positive.
pub(super) fn lateral_extent(b: &OrientedBox, centre: Vec2, axis: Vec2, length: f64) -> Option<(f64, f64)> {
    extent_between(b, centre, left(axis), length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_of_a_box_near_an_axis_is_cut_exactly() {
        let b = OrientedBox::new(Vec2::new(10.0, 0.0), 0.0, 4.0, 2.0);
        let x = Vec2::new(1.0, 0.0);
        assert_eq!(extent_between(&b, Vec2::zeros(), x, 1.0), Some((8.0, 12.0)));
        assert_eq!(extent_between(&b, Vec2::new(0.0, 2.5), x, 1.0), None);
        // Rotated by 90 degrees, 2 m long and 4 m wide: two corners are cut off.
        let b = OrientedBox::new(Vec2::new(10.0, 2.5), std::f64::consts::FRAC_PI_2, 4.0, 2.0);
        let (low, high) = extent_between(&b, Vec2::zeros(), x, 1.0).unwrap();
        assert!((low - 9.0).abs() < 1e-9 && (high - 11.0).abs() < 1e-9);
        // At 45 degrees only its tip reaches the band.
        let b = OrientedBox::new(Vec2::new(10.0, 2.0), std::f64::consts::FRAC_PI_4, 2.0, 2.0);
        let (low, high) = extent_between(&b, Vec2::zeros(), x, 1.0).unwrap();
        let half = 2.0_f64.sqrt() - 1.0;
        assert!((low - (10.0 - half)).abs() < 1e-9 && (high - (10.0 + half)).abs() < 1e-9);
    }
}
