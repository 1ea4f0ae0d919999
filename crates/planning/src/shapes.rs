//! Distances between segments, boxes and outlines. Touching counts as contact.

use reactsim_geometry::{Bounds, OrientedBox, Vec2, point_in_ring, point_segment};

/// Number of segments of a line per bounding box.
pub(crate) const CHUNK: usize = 12;
/// Margin in metres of tests that skip what is too far away: more than rounding errors of coordinates.
pub(crate) const SKIP_MARGIN: f64 = 1e-6;

/// Ground that an object covers.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    Box(OrientedBox),
    /// The ground inside a ring.
    Outline(Vec<Vec2>),
}

impl Shape {
    /// Returns the distance to a box, metres; 0 if they touch or overlap.
    pub(crate) fn distance(&self, other: &OrientedBox) -> f64 {
        match self {
            Self::Box(own) => own.signed_distance(other).max(0.0),
            Self::Outline(ring) => box_ring_distance(other, ring),
        }
    }
}

/// Returns the edges of a ring, open or closed.
pub(crate) fn edges(ring: &[Vec2]) -> impl Iterator<Item = (Vec2, Vec2)> + '_ {
    let closing = ring.last().copied().zip(ring.first().copied());
    ring.windows(2).map(|pair| (pair[0], pair[1])).chain(closing)
}

/// Returns the bounds of each [`CHUNK`] segments between points, inflated by `margin` metres.
pub(crate) fn chunk_bounds(points: &[Vec2], margin: f64) -> Vec<Bounds> {
    let bounds = |first: usize| {
        let last = (first + CHUNK + 1).min(points.len());
        Bounds::of(points[first..last].iter().copied()).inflated(margin)
    };
    (0..points.len().max(2) - 1).step_by(CHUNK).map(bounds).collect()
}

/// Returns whether a closed ring contains `p`; its boundary is inside.
pub(crate) fn ring_covers(ring: &[Vec2], p: Vec2) -> bool {
    point_in_ring(p, ring) != Some(false)
}

/// Returns the squared distance from a point to a closed box, m².
fn point_box(p: Vec2, other: &OrientedBox) -> f64 {
    let local = other.to_local(p);
    let beyond = |along: f64, half: f64| (along.abs() - half).max(0.0);
    let (x, y) = (beyond(local.x, other.half_length), beyond(local.y, other.half_width));
    x * x + y * y
}

/// Returns the squared distance from a segment to a closed box, m².
pub(crate) fn segment_box(a: Vec2, b: Vec2, other: &OrientedBox) -> f64 {
    if other.intersects_segment(a, b) {
        return 0.0;
    }
    let corners = other.corners().into_iter().map(|corner| point_segment(corner, a, b).0);
    corners.fold(point_box(a, other).min(point_box(b, other)), f64::min)
}

/// Returns whether a segment is within `reach` metres of a closed box.
pub(crate) fn is_segment_near_box(a: Vec2, b: Vec2, other: &OrientedBox, reach: f64) -> bool {
    // Most segments that are too far away are on the far side of one edge of the box.
    let (p, q) = (other.to_local(a), other.to_local(b));
    let is_beyond = |from: f64, to: f64, half: f64| {
        let bound = half + reach + SKIP_MARGIN;
        from.min(to) > bound || from.max(to) < -bound
    };
    !is_beyond(p.x, q.x, other.half_length)
        && !is_beyond(p.y, q.y, other.half_width)
        && segment_box(a, b, other) <= reach * reach
}

/// Returns the squared distance between two segments, m².
pub(crate) fn segments((a, b): (Vec2, Vec2), (c, d): (Vec2, Vec2)) -> f64 {
    let side = |from: Vec2, to: Vec2, p: Vec2| (to - from).perp(&(p - from));
    let crosses = side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0;
    if crosses {
        return 0.0;
    }
    let ends =
        [point_segment(a, c, d), point_segment(b, c, d), point_segment(c, a, b), point_segment(d, a, b)];
    ends.into_iter().map(|(distance, _)| distance).fold(f64::INFINITY, f64::min)
}

/// Returns the distance from a box to the ground inside a ring, metres; 0 if they touch or overlap.
pub(crate) fn box_ring_distance(other: &OrientedBox, ring: &[Vec2]) -> f64 {
    if ring_covers(ring, other.center) {
        return 0.0;
    }
    // The box is at most as far from the edge nearest to its centre as its centre is. Edges that are farther
    // from the centre by more than the radius are farther from the box.
    let to_center = |(a, b): (Vec2, Vec2)| point_segment(other.center, a, b).0;
    let least = edges(ring).map(to_center).fold(f64::INFINITY, f64::min).sqrt();
    let reach = least + other.radius() + SKIP_MARGIN;
    let near = edges(ring).filter(|&edge| to_center(edge) <= reach * reach);
    near.map(|(a, b)| segment_box(a, b, other)).fold(f64::INFINITY, f64::min).sqrt()
}

/// Returns whether a box touches or overlaps the ground inside a ring.
pub(crate) fn box_touches_ring(other: &OrientedBox, ring: &[Vec2]) -> bool {
    ring_covers(ring, other.center) || edges(ring).any(|(a, b)| segment_box(a, b, other) <= 0.0)
}

/// Returns whether a closed ring contains a whole box.
pub(crate) fn ring_covers_box(ring: &[Vec2], other: &OrientedBox) -> bool {
    let corners = other.corners();
    ring_covers(ring, other.center)
        && corners.iter().all(|&corner| ring_covers(ring, corner))
        && !edges(ring).any(|(a, b)| crosses_interior(a, b, other))
}

/// Returns whether a segment passes through the interior of a box.
fn crosses_interior(a: Vec2, b: Vec2, other: &OrientedBox) -> bool {
    /// Depth in metres below which a segment is on the boundary.
    const BOUNDARY: f64 = 1e-9;
    let inner = OrientedBox {
        half_length: other.half_length - BOUNDARY,
        half_width: other.half_width - BOUNDARY,
        ..*other
    };
    inner.intersects_segment(a, b)
}

/// Returns the centroid of the ground inside a ring; the mean of its points if it has no area.
pub(crate) fn ring_centroid(ring: &[Vec2]) -> Vec2 {
    let Some(&origin) = ring.first() else { return Vec2::zeros() };
    let (mut doubled_area, mut moment) = (0.0, Vec2::zeros());
    for (a, b) in edges(ring) {
        let (a, b) = (a - origin, b - origin);
        let cross = a.perp(&b);
        doubled_area += cross;
        moment += (a + b) * cross;
    }
    if doubled_area == 0.0 {
        return ring.iter().sum::<Vec2>() / ring.len() as f64;
    }
    origin + moment / (3.0 * doubled_area)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64) -> Vec2 {
        Vec2::new(x, y)
    }

    fn square() -> Vec<Vec2> {
        vec![v(0.0, 0.0), v(4.0, 0.0), v(4.0, 4.0), v(0.0, 4.0)]
    }

    #[test]
    fn boxes_and_rings_have_distances() {
        let near = OrientedBox::new(v(7.0, 2.0), 0.0, 4.0, 2.0);
        assert!((box_ring_distance(&near, &square()) - 1.0).abs() < 1e-12);
        assert_eq!(box_ring_distance(&OrientedBox::new(v(5.0, 2.0), 0.3, 4.0, 2.0), &square()), 0.0);
        assert_eq!(box_ring_distance(&OrientedBox::new(v(2.0, 2.0), 0.0, 1.0, 1.0), &square()), 0.0);
        assert!((segments((v(0.0, 0.0), v(1.0, 0.0)), (v(3.0, -1.0), v(3.0, 1.0))) - 4.0).abs() < 1e-12);
        assert_eq!(segments((v(0.0, 0.0), v(4.0, 0.0)), (v(3.0, -1.0), v(3.0, 1.0))), 0.0);
    }

    /// Boxes around a ring of many edges, inside and outside.
    fn boxes() -> impl Iterator<Item = OrientedBox> {
        (0..400).map(|i| {
            let i = f64::from(i);
            let at = v(9.0 * (1.3 * i).sin(), 9.0 * (0.7 * i).cos());
            OrientedBox::new(at, 0.4 * i, 1.0 + (2.1 * i).sin().abs() * 4.0, 0.5 + (0.9 * i).cos().abs())
        })
    }

    fn star() -> Vec<Vec2> {
        let corner = |i: usize| reactsim_geometry::direction(i as f64 * 0.1) * (5.0 + 2.0 * (i % 2) as f64);
        (0..63).map(corner).collect()
    }

    #[test]
    fn skipped_edges_do_not_change_distances() {
        let ring = star();
        for other in boxes() {
            let all = edges(&ring).map(|(a, b)| segment_box(a, b, &other)).fold(f64::INFINITY, f64::min);
            let expected = if ring_covers(&ring, other.center) { 0.0 } else { all.sqrt() };
            assert_eq!(box_ring_distance(&other, &ring), expected);
            assert_eq!(box_touches_ring(&other, &ring), expected <= 0.0);
            for ((a, b), reach) in edges(&ring).zip([0.0, 0.3, 1.0, 2.0].into_iter().cycle()) {
                let is_near = segment_box(a, b, &other) <= reach * reach;
                assert_eq!(is_segment_near_box(a, b, &other, reach), is_near);
            }
        }
    }

    #[test]
    fn a_ring_covers_boxes_that_touch_its_boundary() {
        assert!(ring_covers_box(&square(), &OrientedBox::new(v(2.0, 1.0), 0.0, 4.0, 2.0)));
        assert!(!ring_covers_box(&square(), &OrientedBox::new(v(2.1, 1.0), 0.0, 4.0, 2.0)));
        let notched = [v(0.0, 0.0), v(4.0, 0.0), v(4.0, 4.0), v(2.0, 1.5), v(0.0, 4.0)];
        assert!(!ring_covers_box(&notched, &OrientedBox::new(v(2.0, 1.0), 0.0, 3.0, 1.8)));
    }

    #[test]
    fn centroids_weigh_area() {
        let half = [v(0.0, 0.0), v(3.0, 0.0), v(0.0, 3.0), v(0.0, 1.5)];
        assert!((ring_centroid(&half) - v(1.0, 1.0)).norm() < 1e-12);
    }
}
