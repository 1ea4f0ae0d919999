//! The geometry of boxes against parry2d, over random pairs of boxes.
//!
//! parry gets the boxes as convex polygons: its general algorithm for convex shapes (GJK) shares nothing with
//! the closed forms here. The time to impact is itself parry's; it is checked by distances alone, with which
//! its search shares no code either.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(
    clippy::disallowed_methods,
    reason = "expected values may come from the platform: they have tolerances"
)]

use std::f64::consts::{FRAC_PI_2, PI};

use parry2d_f64::math::{Isometry, Point, Vector};
use parry2d_f64::query::{PointQuery, contact, distance, intersection_test};
use parry2d_f64::shape::{ConvexPolygon, Segment};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use reactsim_geometry::{OrientedBox, Vec2, rounded_distance, time_to_impact};

/// Number of pairs of boxes per kind.
const PAIRS: usize = 1000;
/// Tolerance of distances, metres.
const TOLERANCE: f64 = 1e-6;
/// Relative tolerance of distances, at which GJK stops.
const RELATIVE_TOLERANCE: f64 = 1e-7;
/// Tolerance of positions at the time of impact, metres.
const CAST_TOLERANCE: f64 = 1e-3;
/// Horizon of the time to impact, seconds.
const HORIZON: f64 = 10.0;
/// Rounding of the corners in the metrics.
const ROUNDING: f64 = 0.7;

#[derive(Clone, Copy, Debug)]
struct Rectangle {
    x: f64,
    y: f64,
    heading: f64,
    length: f64,
    width: f64,
}

impl Rectangle {
    fn ours(&self) -> OrientedBox {
        OrientedBox::new(Vec2::new(self.x, self.y), self.heading, self.length, self.width)
    }

    fn pose(&self) -> Isometry<f64> {
        Isometry::new(Vector::new(self.x, self.y), self.heading)
    }

    /// Returns the box with all sides moved outwards by `margin`, as parry's shape.
    fn shape(&self, margin: f64) -> ConvexPolygon {
        let (x, y) = (0.5 * self.length + margin, 0.5 * self.width + margin);
        let corners = [(x, y), (-x, y), (-x, -y), (x, -y)];
        ConvexPolygon::from_convex_polyline(corners.map(|(x, y)| Point::new(x, y)).into()).unwrap()
    }

    /// Returns the box after `time` seconds at this velocity.
    fn moved(&self, velocity: (f64, f64), time: f64) -> Self {
        Self { x: self.x + velocity.0 * time, y: self.y + velocity.1 * time, ..*self }
    }

    /// Returns the point of the box at these fractions of its half length and half width.
    fn at(&self, ahead: f64, left: f64) -> (f64, f64) {
        let (sin, cos) = self.heading.sin_cos();
        let (ahead, left) = (0.5 * ahead * self.length, 0.5 * left * self.width);
        (self.x + ahead * cos - left * sin, self.y + ahead * sin + left * cos)
    }
}

/// Relation of the two boxes of a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Some metres apart, or overlapping.
    Near,
    /// Up to two kilometres apart.
    Far,
    /// The second box has its centre in the first and is smaller.
    Contained,
    /// The second box touches a side of the first with a corner or a side.
    Touching,
    /// Near, with sides that are parallel or at right angles.
    RightAngles,
}

impl Kind {
    const ALL: [Self; 5] = [Self::Near, Self::Far, Self::Contained, Self::Touching, Self::RightAngles];
}

/// Source of random boxes.
struct Draw(ChaCha8Rng);

impl Draw {
    /// Draws a number between two others.
    fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn right_angles(&mut self) -> f64 {
        (self.0.next_u32() % 4) as f64 * FRAC_PI_2
    }

    /// Draws a box as far from the origin as boxes are in world coordinates.
    fn rectangle(&mut self) -> Rectangle {
        Rectangle {
            x: self.between(-1e4, 1e4),
            y: self.between(-1e4, 1e4),
            heading: self.between(-PI, PI),
            length: self.between(0.3, 20.0),
            width: self.between(0.3, 4.0),
        }
    }

    fn pair(&mut self, kind: Kind) -> (Rectangle, Rectangle) {
        let (mut a, b) = (self.rectangle(), self.rectangle());
        let near = |by: f64, draw: &mut Self, a: &Rectangle| Rectangle {
            x: a.x + draw.between(-by, by),
            y: a.y + draw.between(-by, by),
            ..b
        };
        let b = match kind {
            Kind::Near => near(12.0, self, &a),
            Kind::Far => near(2000.0, self, &a),
            Kind::Contained => {
                let (x, y) = a.at(self.between(-1.0, 1.0), self.between(-1.0, 1.0));
                Rectangle { x, y, length: 0.2 * a.length, width: 0.2 * a.width, ..b }
            }
            Kind::Touching => {
                let b = if self.0.next_u32().is_multiple_of(2) {
                    Rectangle { heading: a.heading + self.right_angles(), ..b }
                } else {
                    b
                };
                // The corner of the second box that touches, relative to its centre, in the frame of the
                // first.
                let (sin, cos) = (b.heading - a.heading).sin_cos();
                let (ahead, left) = (0.5 * b.length.copysign(sin), 0.5 * b.width.copysign(cos));
                let corner = (ahead * cos - left * sin, ahead * sin + left * cos);
                let along = self.between(-1.0, 1.0) - 2.0 * corner.0 / a.length;
                let (x, y) = a.at(along, -1.0 - 2.0 * corner.1 / a.width);
                Rectangle { x, y, ..b }
            }
            Kind::RightAngles => {
                a.heading = self.right_angles();
                Rectangle { heading: self.right_angles(), ..near(12.0, self, &a) }
            }
        };
        (a, b)
    }

    /// Draws pairs of all kinds and passes them to a check.
    fn pairs(seed: u64, mut check: impl FnMut(Kind, Rectangle, Rectangle, &mut Self)) {
        let mut draw = Self(ChaCha8Rng::seed_from_u64(seed));
        for kind in Kind::ALL {
            for _ in 0..PAIRS {
                let (a, b) = draw.pair(kind);
                check(kind, a, b, &mut draw);
            }
        }
    }
}

/// Returns parry's distance of two boxes with all sides moved outwards by `margin`, 0 if they overlap.
fn parry_distance(a: &Rectangle, b: &Rectangle, margin: f64) -> f64 {
    distance(&a.pose(), &a.shape(margin), &b.pose(), &b.shape(margin)).unwrap()
}

fn parry_overlap(a: &Rectangle, b: &Rectangle, margin: f64) -> bool {
    intersection_test(&a.pose(), &a.shape(margin), &b.pose(), &b.shape(margin)).unwrap()
}

#[test]
fn distances_and_overlaps_agree_with_parry() {
    Draw::pairs(1, |kind, a, b, _| {
        let what = format!("{kind:?}: {a:?}, {b:?}");
        let (ours, theirs) = (a.ours().signed_distance(&b.ours()), parry_distance(&a, &b, 0.0));
        let tolerance = TOLERANCE + RELATIVE_TOLERANCE * theirs;
        assert!((ours.max(0.0) - theirs).abs() <= tolerance, "{what}: ours {ours}, parry {theirs}");
        assert!((b.ours().signed_distance(&a.ours()) - ours).abs() <= tolerance, "{what}: not symmetric");
        // A lower bound of the distance with the same sign.
        let separation = a.ours().separation(&b.ours());
        assert!(separation <= theirs + tolerance, "{what}: {separation} of {theirs}");
        for overlaps in [ours <= 0.0, separation <= 0.0] {
            assert!(overlaps || !parry_overlap(&a, &b, -TOLERANCE), "{what}: parry finds an overlap");
            assert!(!overlaps || parry_overlap(&a, &b, TOLERANCE), "{what}: parry finds no overlap");
        }
        match kind {
            Kind::Touching => assert!(ours.abs() <= TOLERANCE, "{what}: ours {ours}"),
            Kind::Contained => assert!(ours < 0.0, "{what}: ours {ours}"),
            _ => {}
        }
    });
}

#[test]
fn penetration_depths_agree_with_parry() {
    let (mut compared, mut all) = (0, 0);
    Draw::pairs(2, |kind, a, b, _| {
        let ours = a.ours().signed_distance(&b.ours());
        // Boxes that only touch have no depth. For parallel sides the direction of the least depth, which
        // parry searches for, is ambiguous.
        if ours > -TOLERANCE || matches!(kind, Kind::Touching | Kind::RightAngles) {
            return;
        }
        all += 1;
        // parry's search for the depth can end without a result.
        let found = contact(&a.pose(), &a.shape(0.0), &b.pose(), &b.shape(0.0), 1.0).unwrap();
        let Some(found) = found else { return };
        compared += 1;
        assert!((ours - found.dist).abs() <= TOLERANCE, "{a:?}, {b:?}: ours {ours}, parry {}", found.dist);
    });
    assert!(all > PAIRS && compared * 100 >= all * 99, "{compared} of {all}");
}

#[test]
fn rounded_distances_agree_with_parry() {
    Draw::pairs(3, |kind, a, b, _| {
        let ours = rounded_distance(&a.ours(), &b.ours(), ROUNDING);
        let radius = |r: &Rectangle| 0.5 * ROUNDING * r.length.min(r.width);
        let (ra, rb) = (radius(&a), radius(&b));
        // A box with rounded corners is everything within the radius of a smaller box.
        let (core_a, core_b) = (a.shape(-ra), b.shape(-rb));
        let cores = distance(&a.pose(), &core_a, &b.pose(), &core_b).unwrap();
        let theirs = cores - ra - rb;
        let tolerance = TOLERANCE + RELATIVE_TOLERANCE * cores;
        let agrees =
            if cores > 0.0 { (ours - theirs).abs() <= tolerance } else { ours <= theirs + tolerance };
        assert!(agrees, "{kind:?}: {a:?}, {b:?}: ours {ours}, parry {theirs}");
    });
}

#[test]
fn points_and_segments_in_boxes_agree_with_parry() {
    Draw::pairs(4, |_, a, b, draw| {
        // Corners of the other box, and points on both sides of the own outline.
        let ends = [b.at(1.0, 1.0), b.at(-1.0, draw.between(-1.0, 1.0))];
        let inner = a.at(draw.between(-1.1, 1.1), draw.between(-1.1, 1.1));
        let (pose, smaller, larger) = (a.pose(), a.shape(-TOLERANCE), a.shape(TOLERANCE));
        for (x, y) in ends.into_iter().chain([inner]) {
            let (contains, point) = (a.ours().contains(Vec2::new(x, y)), Point::new(x, y));
            assert!(contains || !smaller.contains_point(&pose, &point), "{a:?}, {point}: parry contains it");
            assert!(!contains || larger.contains_point(&pose, &point), "{a:?}, {point}: parry does not");
        }
        for [p, q] in [ends, [ends[0], inner]] {
            let crosses = a.ours().intersects_segment(Vec2::new(p.0, p.1), Vec2::new(q.0, q.1));
            let segment = Segment::new(Point::new(p.0, p.1), Point::new(q.0, q.1));
            let theirs = |shape: &ConvexPolygon| {
                intersection_test(&pose, shape, &Isometry::identity(), &segment).unwrap()
            };
            assert!(crosses || !theirs(&smaller), "{a:?}, {segment:?}: parry finds a crossing");
            assert!(!crosses || theirs(&larger), "{a:?}, {segment:?}: parry finds no crossing");
        }
    });
}

/// Returns the least distance of two boxes that move from now to `end`, with all sides moved outwards by
/// `margin`. The distance of convex shapes at constant velocities is a convex function of time, so that a
/// ternary search finds its minimum.
fn least_distance(a: (Rectangle, (f64, f64)), b: (Rectangle, (f64, f64)), margin: f64, end: f64) -> f64 {
    let at = |t: f64| parry_distance(&a.0.moved(a.1, t), &b.0.moved(b.1, t), margin);
    let (mut from, mut to) = (0.0, end);
    let mut least = at(0.0).min(at(end));
    for _ in 0..60 {
        let (early, late) = (from + (to - from) / 3.0, to - (to - from) / 3.0);
        let (x, y) = (at(early), at(late));
        least = least.min(x).min(y);
        if x < y { to = late } else { from = early }
    }
    least
}

#[test]
fn times_to_impact_agree_with_distances_of_parry() {
    let mut hits = 0;
    Draw::pairs(5, |kind, a, b, draw| {
        let v = (draw.between(-20.0, 20.0), draw.between(-20.0, 20.0));
        // Half of the second boxes are aimed at a point near the first.
        let w = if draw.0.next_u32().is_multiple_of(2) {
            let (time, aim) =
                (draw.between(0.5, 12.0), a.at(draw.between(-1.5, 1.5), draw.between(-1.5, 1.5)));
            (v.0 + (aim.0 - b.x) / time, v.1 + (aim.1 - b.y) / time)
        } else {
            (draw.between(-20.0, 20.0), draw.between(-20.0, 20.0))
        };
        let velocity = |v: (f64, f64)| Vec2::new(v.0, v.1);
        let ours = time_to_impact((&a.ours(), velocity(v)), (&b.ours(), velocity(w)), HORIZON);
        let what = format!("{kind:?}: {a:?} at {v:?}, {b:?} at {w:?}: {ours:?}");
        if let Some(time) = ours {
            assert!((0.0..=HORIZON).contains(&time), "{what}");
            let (a_then, b_then) = (a.moved(v, time), b.moved(w, time));
            let gap = parry_distance(&a_then, &b_then, CAST_TOLERANCE);
            assert!(gap <= TOLERANCE, "{what}: parry finds a gap of {gap} m");
            hits += 1;
        }
        // Before the impact, or within the horizon, slightly smaller boxes must not touch.
        if ours != Some(0.0) {
            let least = least_distance((a, v), (b, w), -CAST_TOLERANCE, ours.unwrap_or(HORIZON));
            assert!(least > 0.0, "{what}: parry finds an earlier impact");
        }
    });
    assert!(hits > PAIRS, "{hits} impacts");
}
