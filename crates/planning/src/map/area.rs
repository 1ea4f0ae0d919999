//! Areas of the map: polygons, and corridors around a centre line.

use reactsim_geometry::{
    Bounds, Polygon, PolygonIndex, Polyline, Vec2, left, math, point_segment, ring_distance,
};

use crate::PlanningError;
use crate::shapes::{CHUNK, SKIP_MARGIN, chunk_bounds};

/// Minimum number of points of the outer ring of a polygon.
const MIN_RING_POINTS: usize = 3;

/// An area of the map. Its boundary is outside.
#[derive(Clone, Debug)]
pub struct Area {
    shape: Shape,
    bounds: Bounds,
}

#[derive(Clone, Debug)]
enum Shape {
    Polygon { polygon: Polygon, index: PolygonIndex },
    Corridor { line: Polyline, half_width: f64, sides: Vec<Vec2>, chunks: Vec<Bounds> },
}

impl Area {
    /// Creates the area of a polygon.
    ///
    /// # Errors
    /// [`PlanningError`] if the outer ring has fewer than three points, or a point is not finite.
    pub fn polygon(polygon: Polygon) -> Result<Self, PlanningError> {
        if polygon.exterior.len() < MIN_RING_POINTS {
            let points = polygon.exterior.len();
            let text = format!("the outline has {points} points; it needs at least {MIN_RING_POINTS}");
            return Err(PlanningError(text));
        }
        let mut points = polygon.exterior.iter().chain(polygon.holes.iter().flatten());
        if let Some(bad) = points.position(|p| !(p.x.is_finite() && p.y.is_finite())) {
            let text = format!("point {bad} of the outline is not finite; remove it or correct the map");
            return Err(PlanningError(text));
        }
        let index = PolygonIndex::new(&polygon);
        Ok(Self { bounds: polygon.bounds(), shape: Shape::Polygon { polygon, index } })
    }

    /// Creates the area of a ring without holes, open or closed.
    ///
    /// # Errors
    /// As [`Self::polygon`].
    pub fn ring(exterior: Vec<Vec2>) -> Result<Self, PlanningError> {
        Self::polygon(Polygon { exterior, holes: Vec::new() })
    }

    /// Creates the area within `half_width` metres of a line, with flat ends and round joins.
    ///
    /// # Errors
    /// [`PlanningError`] if the half-width is not positive.
    pub fn corridor(line: Polyline, half_width: f64) -> Result<Self, PlanningError> {
        if !(half_width > 0.0 && half_width.is_finite()) {
            let text = format!("the half-width of the corridor is {half_width} m; it must be positive");
            return Err(PlanningError(text));
        }
        let bounds = Bounds::of(line.points().iter().copied()).inflated(half_width);
        let chunks = chunk_bounds(line.points(), half_width + SKIP_MARGIN);
        let (right, left) = (line.aside(-half_width), line.aside(half_width));
        let sides = right.points().iter().chain(left.points().iter().rev()).copied().collect();
        Ok(Self { bounds, shape: Shape::Corridor { line, half_width, sides, chunks } })
    }

    /// Returns whether this is a corridor around a centre line.
    pub(crate) fn is_corridor(&self) -> bool {
        matches!(self.shape, Shape::Corridor { .. })
    }

    /// Returns the axis-aligned bounds.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Returns whether `p` is strictly inside.
    pub fn contains(&self, p: Vec2) -> bool {
        self.bounds.contains(p)
            && match &self.shape {
                Shape::Polygon { index, .. } => index.contains(p),
                Shape::Corridor { line, half_width, chunks, .. } => in_corridor(line, chunks, *half_width, p),
            }
    }

    /// Returns the distance from `p` to the area, metres; 0 inside and on the boundary.
    pub fn distance(&self, p: Vec2) -> f64 {
        if self.contains(p) {
            return 0.0;
        }
        match &self.shape {
            Shape::Polygon { polygon, .. } => {
                let holes = polygon.holes.iter().map(|hole| ring_distance(p, hole));
                holes.fold(ring_distance(p, &polygon.exterior), f64::min)
            }
            Shape::Corridor { line, half_width, .. } => corridor_distance(line, *half_width, p),
        }
    }

    /// Returns whether the area is less than `distance` metres from `p`.
    pub fn is_within(&self, p: Vec2, distance: f64) -> bool {
        match &self.shape {
            Shape::Polygon { .. } if self.contains(p) => 0.0 < distance,
            Shape::Polygon { index, .. } => index.is_boundary_within(p, distance),
            Shape::Corridor { .. } => self.distance(p) < distance,
        }
    }

    /// Returns the outer ring: that of the polygon, or the two sides of the corridor, counter-clockwise,
    /// with its points on the normals of the centre line.
    pub fn outline(&self) -> &[Vec2] {
        match &self.shape {
            Shape::Polygon { polygon, .. } => &polygon.exterior,
            Shape::Corridor { sides, .. } => sides,
        }
    }
}

/// Returns whether `p` is closer to the line than the half-width and not beyond its flat ends.
///
/// `chunks` are the bounds of the ground within the half-width of each [`CHUNK`] segments.
fn in_corridor(line: &Polyline, chunks: &[Bounds], half_width: f64, p: Vec2) -> bool {
    let last = line.segments() - 1;
    let is_inside = |i: usize| {
        let (a, b) = line.segment(i);
        let (d2, t) = point_segment(p, a, b);
        let beyond = (t <= 0.0 && i == 0) || (t >= 1.0 && i == last);
        d2 < half_width * half_width && !beyond
    };
    let near = chunks.iter().enumerate().filter(|(_, chunk)| chunk.contains(p));
    near.map(|(i, _)| i * CHUNK..((i + 1) * CHUNK).min(last + 1)).any(|mut segments| segments.any(is_inside))
}

/// Returns the distance to the union of the rectangles around the segments and the discs around the joins.
fn corridor_distance(line: &Polyline, half_width: f64, p: Vec2) -> f64 {
    let rectangles = (0..line.segments()).map(|i| rectangle_distance(line.segment(i), half_width, p));
    let joins = &line.points()[1..line.segments()];
    let discs = joins.iter().map(|join| ((p - join).norm() - half_width).max(0.0));
    rectangles.chain(discs).fold(f64::INFINITY, f64::min)
}

/// Returns the distance from `p` to the rectangle within `half_width` of a segment.
fn rectangle_distance((a, b): (Vec2, Vec2), half_width: f64, p: Vec2) -> f64 {
    let length = (b - a).norm();
    let ahead = (b - a) / length;
    let (along, aside) = (ahead.dot(&(p - a)), left(ahead).dot(&(p - a)));
    let beyond = (-along).max(along - length).max(0.0);
    math::hypot(beyond, (aside.abs() - half_width).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64) -> Vec2 {
        Vec2::new(x, y)
    }

    #[test]
    fn a_boundary_point_is_outside_at_distance_zero() {
        let square = Area::ring(vec![v(0.0, 0.0), v(4.0, 0.0), v(4.0, 4.0), v(0.0, 4.0)]).unwrap();
        assert!(square.contains(v(2.0, 2.0)));
        assert!(!square.contains(v(4.0, 2.0)));
        assert_eq!(square.distance(v(4.0, 2.0)), 0.0);
        assert_eq!(square.distance(v(7.0, 8.0)), 5.0);
    }

    #[test]
    fn a_corridor_has_flat_ends_and_round_joins() {
        let line = Polyline::new(&[v(0.0, 0.0), v(10.0, 0.0), v(10.0, 10.0)]).unwrap();
        let corridor = Area::corridor(line, 2.0).unwrap();
        assert!(corridor.contains(v(5.0, 1.9)));
        assert!(!corridor.contains(v(-0.1, 0.0)));
        assert!(corridor.contains(v(11.0, -1.0)));
        assert!(!corridor.contains(v(11.9, -1.9)));
        assert_eq!(corridor.distance(v(5.0, -3.0)), 1.0);
        assert_eq!(corridor.distance(v(-3.0, 6.0)), 5.0);
        assert!((corridor.distance(v(13.0, -4.0)) - 3.0).abs() < 1e-12);
        assert_eq!(corridor.outline().len(), 6);
    }

    #[test]
    fn corridors_of_many_segments_contain_what_is_near_any_segment() {
        let points: Vec<Vec2> = (0..40).map(f64::from).map(|x| v(x, 3.0 * (0.4 * x).sin())).collect();
        let line = Polyline::new(&points).unwrap();
        let corridor = Area::corridor(line.clone(), 1.5).unwrap();
        for i in 0..2000 {
            let p = v(f64::from(i % 50) - 4.7, f64::from(i / 50) * 0.3 - 6.0);
            let nearest = line.project(p);
            let beyond = nearest.s == 0.0 || nearest.s == line.length();
            assert_eq!(corridor.contains(p), nearest.distance < 1.5 && !beyond, "{p:?}");
        }
    }

    #[test]
    fn areas_without_extent_are_refused() {
        let refusal = |area: Result<Area, PlanningError>| area.unwrap_err().to_string();
        let few = refusal(Area::ring(vec![v(0.0, 0.0), v(1.0, 0.0)]));
        assert_eq!(few, "the outline has 2 points; it needs at least 3");
        let ring = vec![v(0.0, 0.0), v(1.0, f64::NAN), v(0.0, 1.0)];
        assert!(refusal(Area::ring(ring)).starts_with("point 1 of the outline is not finite"));
        let line = Polyline::new(&[v(0.0, 0.0), v(1.0, 0.0)]).unwrap();
        assert!(refusal(Area::corridor(line, 0.0)).contains("is 0 m; it must be positive"));
    }
}
