//! A quick proof that an agent stays beside a section of a path.

use reactsim_geometry::Vec2;
use reactsim_scene::dynamics::DrivenPath;

use super::forecast::Band;

/// A section of a path that bends little, with bounds across a straight axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strip {
    /// Position of the first point.
    origin: Vec2,
    first: usize,
    last: usize,
    /// Unit vector from the first to the last point.
    axis: Vec2,
    /// Smallest and largest position across the axis, metres, left positive, 0 at the first point.
    low: f64,
    high: f64,
    /// Largest sine of the angle between the path and the axis.
    sine: f64,
}

/// Largest sine of the angle between a section and its axis, and largest turn of a piece of it, radians.
const MAX_SINE: f64 = 0.3;
/// Number of points that are bounded together.
const PIECE: usize = 8;
/// Largest distance, metres, of an arc of a section from its chord.
const BULGE: f64 = 0.04;
/// Margin for rounding, metres.
const MARGIN: f64 = 1e-6;

impl Strip {
    /// Bounds the path between the points of index `first` and `last`. `None` for a single point, and for a
    /// section that bends too much.
    pub(super) fn of(path: &DrivenPath, first: usize, last: usize) -> Option<Self> {
        let points = path.points();
        let origin = points[first].pose.position;
        let chord = points[last].pose.position - origin;
        let length = chord.norm();
        if !(length > 0.0) {
            return None;
        }
        let axis = chord / length;
        let (mut low, mut high, mut sine) = (0.0_f64, 0.0_f64, 0.0_f64);
        for begin in (first..last).step_by(PIECE) {
            let end = (begin + PIECE).min(last);
            let (point, turn) = (&points[begin], path.turn_between(begin, end));
            // Within the piece the sine of the angle to the axis changes at most by the turn.
            let slope = axis.perp(&point.axis);
            sine = sine.max(slope.abs() + turn);
            if sine > MAX_SINE || axis.dot(&point.axis) <= 0.0 {
                return None;
            }
            let distance = (end - begin) as f64 * DrivenPath::STEP;
            let across = axis.perp(&(point.pose.position - origin));
            low = low.min(across).min(across + distance * (slope - turn));
            high = high.max(across).max(across + distance * (slope + turn));
        }
        Some(Self { origin, first, last, axis, low, high, sine })
    }

    /// Returns a lower bound of the absolute offset, metres, at which [`DrivenPath::project`] finds any point
    /// of the band beside the points up to index `last`, which is in the section. `path` is that of the
    /// strip.
    ///
    /// Let `d` lead from the point that is found to the point of the band, `n` be its part across the axis of
    /// the strip, and `along` its part along the path. The offset is `(n - sin · along) / cos` of the angle
    /// between path and axis. Between the ends `|along|` is at most `(0.5 + |offset| sin h) / cos h`, since
    /// neither neighbour, 1 m away, is nearer; `h` is half the turn of an arc, at most 0.15.
    pub(super) fn offset_at_least(&self, path: &DrivenPath, band: &Band, last: usize) -> f64 {
        let points = path.points();
        let (low, high) = across(band, &self.axis, &(band.origin - self.origin));
        let beside = (low - self.high).max(self.low - high);
        let between = (beside - 0.506 * self.sine) / (1.0 + 0.152 * self.sine);
        let at_end = |index: usize| {
            let end = &points[index];
            let from_end = band.origin - end.pose.position;
            let (low, high) = across(band, &self.axis, &from_end);
            let along = end.axis.dot(&from_end);
            let farthest = along.abs().max((along + band.length * end.axis.dot(&band.axis)).abs());
            low.max(-high) - self.axis.perp(&end.axis).abs() * (farthest + band.high - band.low)
        };
        between.min(at_end(self.first)).min(at_end(last)) - MARGIN
    }

    /// Returns an upper bound, metres, of half the extent across the path of boxes in the band.
    pub(super) fn half_extent_at_most(&self, band: &Band, half_length: f64, half_width: f64) -> f64 {
        let sine = (self.axis.perp(&band.axis).abs() + band.sine + self.sine).min(1.0);
        half_length * sine + half_width + MARGIN
    }

    /// Returns a lower bound of the distance, metres, between boxes in the band and a vehicle that follows
    /// the section; boxes are given by half length and half width.
    pub(super) fn distance_at_least(&self, own: (f64, f64), band: &Band, other: (f64, f64)) -> f64 {
        let (low, high) = across(band, &self.axis, &(band.origin - self.origin));
        let sine = (self.axis.perp(&band.axis).abs() + band.sine).min(1.0);
        let extents = own.0 * self.sine + own.1 + other.0 * sine + other.1;
        (low - self.high).max(self.low - high) - extents - BULGE - MARGIN
    }

    /// Returns whether the section contains the path between two arc lengths, metres.
    pub(super) fn contains(&self, from: f64, to: f64) -> bool {
        from >= self.first as f64 * DrivenPath::STEP && to <= self.last as f64 * DrivenPath::STEP
    }
}

/// Returns the smallest and largest position of points of a band across an axis, metres, left positive.
/// `from` leads from the origin of the axis to that of the band.
fn across(band: &Band, axis: &Vec2, from: &Vec2) -> (f64, f64) {
    let (sine, cosine) = (axis.perp(&band.axis), axis.dot(&band.axis));
    let (begin, end) = (axis.perp(from), axis.perp(from) + band.length * sine);
    let sides = (band.low * cosine, band.high * cosine);
    (begin.min(end) + sides.0.min(sides.1), begin.max(end) + sides.0.max(sides.1))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use reactsim_geometry::{OrientedBox, direction};
    use reactsim_scene::dynamics::Pose;

    use super::*;

    fn band(at: Pose, length: f64, low: f64, high: f64, sine: f64) -> Band {
        Band { origin: at.position, axis: direction(at.heading), length, low, high, sine, speed: 0.0 }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn bounds_hold_wherever_the_projection_ends(
            curvature in -0.05..0.05_f64,
            fade in 2.0..100.0_f64,
            (x, y) in (-60.0..160.0_f64, -12.0..12.0_f64),
            (first, count, further) in (0..40_usize, 1..50_usize, 0..20_usize),
            near in prop::option::of(0..110_usize),
            (heading, turn) in (-3.2..3.2_f64, -0.5..0.5_f64),
            (length, low, high) in (0.0..60.0_f64, -1.0..0.0_f64, 0.0..1.0_f64),
            (along, aside, driven) in (0.0..1.0_f64, 0.0..1.0_f64, 0.0..1.0_f64),
            (half_length, half_width) in (0.2..9.0_f64, 0.2..1.5_f64),
        ) {
            let path = DrivenPath::fade(Pose { position: Vec2::new(3.0, 1.0), heading: 0.4 }, curvature, fade, 120.0);
            let last = first + count;
            let Some(strip) = Strip::of(&path, first, last + further) else { return Ok(()) };
            let (s, c) = 0.4_f64.sin_cos();
            let position = Vec2::new(3.0 + c * x - s * y, 1.0 + s * x + c * y);
            let band = band(Pose { position, heading }, length, low, high, turn.sin().abs());
            let left = Vec2::new(-band.axis.y, band.axis.x);
            let p = position + band.axis * (along * length) + left * (low + aside * (high - low));
            let at = path.project(p, first, last, near);
            prop_assert!(strip.offset_at_least(&path, &band, last) <= at.offset.abs());
            let (axis, own) = (direction(heading + turn), path.points()[at.index].axis);
            let extent = half_length * own.perp(&axis).abs() + half_width * own.dot(&axis).abs();
            prop_assert!(extent <= strip.half_extent_at_most(&band, half_length, half_width));

            let along = first as f64 + driven * (last + further - first) as f64;
            let place = path.point_at(along);
            let (ours, theirs) = ((2.4, 1.0), (half_length, half_width));
            let of = |center: Vec2, axis: Vec2, half: (f64, f64)| {
                OrientedBox { center, axis, half_length: half.0, half_width: half.1 }
            };
            let (a, b) = (of(place.pose.position, place.axis, ours), of(p, axis, theirs));
            prop_assert!(strip.distance_at_least(ours, &band, theirs) <= a.signed_distance(&b).max(0.0));
        }
    }

    #[test]
    fn neighbours_in_the_next_lane_are_beside_a_straight_section() {
        let path = DrivenPath::fade(Pose { position: Vec2::zeros(), heading: 0.0 }, 0.0, 1.0, 80.0);
        let strip = Strip::of(&path, 0, 70).unwrap();
        for x in [-30.0, 12.3, 90.0] {
            let beside = band(Pose { position: Vec2::new(x, 3.5), heading: 0.0 }, 40.0, 0.0, 0.0, 0.0);
            assert!(strip.offset_at_least(&path, &beside, 60) > 3.49);
            assert!(strip.half_extent_at_most(&beside, 5.0, 0.9) < 0.91);
            assert!(strip.distance_at_least((2.25, 0.9), &beside, (2.25, 0.9)) > 1.6);
        }
    }
}
