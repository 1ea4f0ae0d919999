//! Unions of polygons.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::i_float::int::point::IntPoint;

use super::{Polygon, Vec2};

/// Grid spacing of map points, metres: finer than any survey, and coarse enough to keep files small.
pub const GRID_SPACING: f64 = 1.0 / 1024.0;

/// Rounds a point to the grid.
pub fn on_grid(p: Vec2) -> Vec2 {
    Vec2::new((p.x / GRID_SPACING).round() * GRID_SPACING, (p.y / GRID_SPACING).round() * GRID_SPACING)
}

/// Area in m² below which a hole or an island is dropped as a sliver between surfaces.
const SLIVER_AREA: f64 = 2.0;
/// Coordinate magnitude in metres from which points are refused: they would not fit into whole numbers.
const MAX_COORDINATE: f64 = 5e5;

/// Returns the union of `rings`, in any orientation, minus the union of `cut`.
///
/// Exteriors run counter-clockwise, holes clockwise. All points are on the grid and the arithmetic uses whole
/// numbers, so the result is the same on every machine.
pub fn union(rings: &[Vec<Vec2>], cut: &[Vec<Vec2>]) -> Vec<Polygon> {
    let mut overlay: Overlay<i32> = Overlay::new(rings.iter().chain(cut).map(Vec::len).sum());
    for (list, kind) in [(rings, ShapeType::Subject), (cut, ShapeType::Clip)] {
        for ring in list {
            // Nonzero winding adds up over rings, so all must have the same orientation.
            overlay.add_contour(&contour(ring, true), kind);
        }
    }
    let rule = if cut.is_empty() { OverlayRule::Subject } else { OverlayRule::Difference };
    polygons(&mut overlay, rule)
}

/// Returns the union of polygons, which may overlap or touch and have any orientation; otherwise like
/// [`union()`]. `None` if a coordinate exceeds 500 km, too far for whole numbers.
pub fn union_of(areas: &[Polygon]) -> Option<Vec<Polygon>> {
    let mut overlay: Overlay<i32> = Overlay::new(areas.iter().map(|p| p.exterior.len()).sum());
    for polygon in areas {
        let rings =
            std::iter::once((&polygon.exterior, true)).chain(polygon.holes.iter().map(|h| (h, false)));
        for (ring, counter_clockwise) in rings {
            if !ring.iter().all(|p| p.x.abs() < MAX_COORDINATE && p.y.abs() < MAX_COORDINATE) {
                return None;
            }
            // A hole subtracts one from the winding number, so ground that another polygon covers stays
            // covered.
            overlay.add_contour(&contour(ring, counter_clockwise), ShapeType::Subject);
        }
    }
    Some(polygons(&mut overlay, OverlayRule::Subject))
}

/// Returns the ring on the grid, with the given orientation.
fn contour(ring: &[Vec2], counter_clockwise: bool) -> Vec<IntPoint<i32>> {
    let whole =
        |p: &Vec2| IntPoint::new((p.x / GRID_SPACING).round() as i32, (p.y / GRID_SPACING).round() as i32);
    let mut contour: Vec<IntPoint<i32>> = ring.iter().map(whole).collect();
    let area = ring_area(ring);
    if if counter_clockwise { area < 0.0 } else { area > 0.0 } {
        contour.reverse();
    }
    contour
}

fn polygons(overlay: &mut Overlay<i32>, rule: OverlayRule) -> Vec<Polygon> {
    let back = |c: &[IntPoint<i32>]| -> Vec<Vec2> {
        c.iter().map(|p| Vec2::new(f64::from(p.x) * GRID_SPACING, f64::from(p.y) * GRID_SPACING)).collect()
    };
    let shapes = overlay.overlay(rule, FillRule::NonZero);
    let mut polygons = Vec::with_capacity(shapes.len());
    for shape in &shapes {
        let mut contours = shape.iter().map(|c| back(c)).filter(|c| ring_area(c).abs() >= SLIVER_AREA);
        let Some(mut exterior) = contours.next() else { continue };
        let mut holes: Vec<Vec<Vec2>> = contours.collect();
        if ring_area(&exterior) < 0.0 {
            exterior.reverse();
        }
        for hole in &mut holes {
            if ring_area(hole) > 0.0 {
                hole.reverse();
            }
        }
        polygons.push(Polygon { exterior, holes });
    }
    polygons
}

/// Returns the area of a ring, m², positive if counter-clockwise.
pub fn ring_area(ring: &[Vec2]) -> f64 {
    let Some(mut a) = ring.last().copied() else { return 0.0 };
    // Relative to a point of the ring, so that rings far from the origin lose no digits.
    let (o, mut sum) = (a, 0.0);
    for &b in ring {
        sum += (a - o).perp(&(b - o));
        a = b;
    }
    0.5 * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(x: (f64, f64), y: (f64, f64)) -> Vec<Vec2> {
        vec![Vec2::new(x.0, y.0), Vec2::new(x.1, y.0), Vec2::new(x.1, y.1), Vec2::new(x.0, y.1)]
    }

    fn polygon(exterior: Vec<Vec2>, holes: Vec<Vec<Vec2>>) -> Polygon {
        Polygon { exterior, holes }
    }

    #[test]
    fn overlapping_areas_are_one() {
        // The second runs clockwise, and covers half of the hole of the first.
        let mut second = rectangle((15.0, 40.0), (0.0, 20.0));
        second.reverse();
        let areas = [
            polygon(rectangle((0.0, 30.0), (0.0, 20.0)), vec![rectangle((10.0, 20.0), (5.0, 15.0))]),
            polygon(second, Vec::new()),
        ];
        let ground = union_of(&areas).unwrap();
        assert_eq!((ground.len(), ground[0].holes.len()), (1, 1));
        assert_eq!((ring_area(&ground[0].exterior), ring_area(&ground[0].holes[0])), (800.0, -50.0));
        // Side by side: no edge remains between them.
        let adjacent = [(0.0, 10.0), (10.0, 20.0)].map(|x| polygon(rectangle(x, (0.0, 5.0)), Vec::new()));
        let ground = union_of(&adjacent).unwrap();
        assert_eq!((ground.len(), ground[0].exterior.len()), (1, 4));
        assert_eq!(
            union_of(&[polygon(rectangle((0.0, 1e6), (0.0, 1.0)), Vec::new())]).map(|g| g.len()),
            None
        );
        assert_eq!(union_of(&[]).map(|g| g.len()), Some(0));
    }
}
