//! Oriented boxes: corners, containment, sharp and rounded overlap.

use super::{Vec2, direction, left, math};

/// A rectangle in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    /// Centre, metres.
    pub center: Vec2,
    /// Unit vector along the length.
    pub axis: Vec2,
    /// Half of the extent along `axis`, metres.
    pub half_length: f64,
    /// Half of the extent across `axis`, metres.
    pub half_width: f64,
}

impl OrientedBox {
    /// Creates a box from its centre (m), heading (rad) and full extents (m).
    #[inline]
    pub fn new(center: Vec2, heading: f64, length: f64, width: f64) -> Self {
        Self { center, axis: direction(heading), half_length: 0.5 * length, half_width: 0.5 * width }
    }

    /// Returns the unit vector to the left of the box.
    #[inline]
    pub fn left(&self) -> Vec2 {
        left(self.axis)
    }

    /// Returns the corners: front left, front right, rear right, rear left.
    #[inline]
    pub fn corners(&self) -> [Vec2; 4] {
        let (ahead, aside) = (self.axis * self.half_length, self.left() * self.half_width);
        let c = self.center;
        [c + ahead + aside, c + ahead - aside, c - ahead - aside, c - ahead + aside]
    }

    /// Returns the radius of the circumscribed circle, metres.
    #[inline]
    pub fn radius(&self) -> f64 {
        math::hypot(self.half_length, self.half_width)
    }

    /// Returns `point` in the frame of the box: x ahead and y to the left of its centre.
    #[inline]
    pub fn to_local(&self, point: Vec2) -> Vec2 {
        let d = point - self.center;
        Vec2::new(d.dot(&self.axis), d.dot(&self.left()))
    }

    /// Returns whether the closed box contains `point`.
    #[inline]
    pub fn contains(&self, point: Vec2) -> bool {
        let local = self.to_local(point);
        local.x.abs() <= self.half_length && local.y.abs() <= self.half_width
    }

    /// Returns the distance from `point` to the box, metres; 0 inside.
    fn distance_to(&self, point: Vec2) -> f64 {
        let local = self.to_local(point);
        let x = (local.x.abs() - self.half_length).max(0.0);
        let y = (local.y.abs() - self.half_width).max(0.0);
        math::hypot(x, y)
    }

    /// Returns whether the closed segment `a`-`b` intersects the closed box (slab test in the frame of the
    /// box).
    pub fn intersects_segment(&self, a: Vec2, b: Vec2) -> bool {
        let (p, q) = (self.to_local(a), self.to_local(b));
        let d = q - p;
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for (start, step, half) in [(p.x, d.x, self.half_length), (p.y, d.y, self.half_width)] {
            if step == 0.0 {
                if start.abs() > half {
                    return false;
                }
            } else {
                let (t0, t1) = ((-half - start) / step, (half - start) / step);
                enter = enter.max(t0.min(t1));
                leave = leave.min(t0.max(t1));
            }
        }
        enter <= leave
    }

    /// Returns the largest separation along the four edge normals, metres. A negative value is minus the
    /// penetration depth of overlapping boxes; a positive value is a lower bound of the distance.
    #[inline]
    pub fn separation(&self, other: &Self) -> f64 {
        let d = other.center - self.center;
        let cos = self.axis.dot(&other.axis).abs();
        let sin = self.axis.perp(&other.axis).abs();
        let (a, b) = (self, other);
        let on_a_x = d.dot(&a.axis).abs() - a.half_length - (b.half_length * cos + b.half_width * sin);
        let on_a_y = d.perp(&a.axis).abs() - a.half_width - (b.half_length * sin + b.half_width * cos);
        let on_b_x = d.dot(&b.axis).abs() - b.half_length - (a.half_length * cos + a.half_width * sin);
        let on_b_y = d.perp(&b.axis).abs() - b.half_width - (a.half_length * sin + a.half_width * cos);
        on_a_x.max(on_a_y).max(on_b_x).max(on_b_y)
    }

    /// Returns the signed distance between two sharp boxes, metres: the Euclidean distance if disjoint, else
    /// minus the penetration depth.
    pub fn signed_distance(&self, other: &Self) -> f64 {
        let separation = self.separation(other);
        if separation <= 0.0 {
            return separation;
        }
        // Relative to this box: far from the origin of the map, corners would lose the digits that decide
        // contact.
        let (near, far) =
            (Self { center: Vec2::zeros(), ..*self }, Self { center: other.center - self.center, ..*other });
        let from_other = far.corners().into_iter().map(|c| near.distance_to(c));
        let from_self = near.corners().into_iter().map(|c| far.distance_to(c));
        from_other.chain(from_self).fold(f64::INFINITY, f64::min)
    }
}

/// Returns the signed distance, in metres, between two boxes whose corners are rounded with radius
/// `rounding * min(length, width) / 2`.
///
/// A negative distance is a collision; touching boxes give 0. `rounding` 0.7 is the convention of the Waymo
/// sim-agents metrics, 0 gives sharp boxes (ReactSim-Bench, "Metric Computation Details": rounded-box signed
/// distance below 0).
pub fn rounded_distance(a: &OrientedBox, b: &OrientedBox, rounding: f64) -> f64 {
    let radius = |o: &OrientedBox| rounding * o.half_length.min(o.half_width);
    let core = |o: &OrientedBox, r: f64| OrientedBox {
        half_length: o.half_length - r,
        half_width: o.half_width - r,
        ..*o
    };
    let (ra, rb) = (radius(a), radius(b));
    core(a, ra).signed_distance(&core(b, rb)) - ra - rb
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn touching_boxes_have_distance_zero() {
        let a = OrientedBox::new(Vec2::new(0.0, 0.0), 0.0, 4.0, 2.0);
        let b = OrientedBox::new(Vec2::new(4.0, 0.0), 0.0, 4.0, 2.0);
        assert_eq!(a.signed_distance(&b), 0.0);
        assert!(rounded_distance(&a, &b, 0.7).abs() < 1e-12);
    }

    #[test]
    fn rounded_corners_miss_where_sharp_ones_meet() {
        let a = OrientedBox::new(Vec2::new(0.0, 0.0), 0.0, 4.0, 2.0);
        let b = OrientedBox::new(Vec2::new(3.9, 1.9), 0.0, 4.0, 2.0);
        assert!(a.signed_distance(&b) < 0.0);
        assert!(rounded_distance(&a, &b, 0.7) > 0.0);
    }

    #[test]
    fn only_a_segment_through_the_box_intersects_it() {
        let a = OrientedBox::new(Vec2::new(0.0, 0.0), 0.5, 4.0, 2.0);
        assert!(a.intersects_segment(Vec2::new(-9.0, 0.0), Vec2::new(9.0, 0.3)));
        assert!(!a.intersects_segment(Vec2::new(-9.0, 4.0), Vec2::new(9.0, 4.0)));
        assert!(!a.intersects_segment(Vec2::new(3.0, 0.0), Vec2::new(9.0, 0.0)));
    }
}
