//! Signed distance of two boxes by the construction of the official code: the distance of the origin to the
//! Minkowski difference, an octagon with the edges of both boxes.
//!
//! A separating-axis test gives the same up to rounding; far from the origin of the world, where corners are
//! rounded to millimetres, this would differ by millimetres.

/// Indices of the corners of the first and the second box that form the octagon, if the edge of the first box
/// at its lowest corner turns less than that of the second.
const FIRST: [usize; 8] = [0, 1, 1, 2, 2, 3, 3, 0];
const SECOND: [usize; 8] = [0, 0, 1, 1, 2, 2, 3, 3];

/// Returns the distance of two boxes, given by corners in counter-clockwise order, in metres: minus the
/// smallest penetration if they overlap.
pub(super) fn signed_distance(a: &[[f32; 2]; 4], b: &[[f32; 2]; 4]) -> f64 {
    let (a, b) = (from_lowest(a, 1.0), from_lowest(b, -1.0));
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    let edge = |c: &[[f64; 2]; 4]| [c[1][0] - c[0][0], c[1][1] - c[0][1]];
    // Lengths do not change the sign.
    let (of_a, of_b) = if cross(edge(&a), edge(&b)) >= 0.0 { (&FIRST, &SECOND) } else { (&SECOND, &FIRST) };
    let corner = |k: usize| {
        let (a, b) = (a[of_a[k]], b[of_b[k]]);
        [a[0] + b[0], a[1] + b[1]]
    };
    let (mut nearest_squared, mut nearest_edge) = (f64::INFINITY, f64::INFINITY);
    let (mut has_edge, mut is_inside) = (false, true);
    let mut from = corner(0);
    for k in 0..8 {
        let to = corner((k + 1) % 8);
        nearest_squared = nearest_squared.min(from[0] * from[0] + from[1] * from[1]);
        let edge = [to[0] - from[0], to[1] - from[1]];
        let length_squared = edge[0] * edge[0] + edge[1] * edge[1];
        // Edges of boxes without extent have no direction; their corners are enough.
        if length_squared > 0.0 {
            let along = -(edge[0] * from[0] + edge[1] * from[1]);
            let across = cross(edge, from);
            (has_edge, is_inside) = (true, is_inside && across <= 0.0);
            if 0.0 <= along && along <= length_squared {
                nearest_edge = nearest_edge.min(across * across / length_squared);
            }
        }
        from = to;
    }
    let distance = nearest_squared.min(nearest_edge).sqrt();
    if has_edge && is_inside { -distance } else { distance }
}

/// Multiplies the corners by 1 or -1 and rotates them so that the lowest comes first; on ties the first of
/// them.
fn from_lowest(corners: &[[f32; 2]; 4], sign: f32) -> [[f64; 2]; 4] {
    let mut lowest = 0;
    for k in 1..4 {
        if sign * corners[k][1] < sign * corners[lowest][1] {
            lowest = k;
        }
    }
    let mut rotated = [[0.0; 2]; 4];
    for (k, rotated) in rotated.iter_mut().enumerate() {
        let corner = corners[(lowest + k) % 4];
        *rotated = [f64::from(sign * corner[0]), f64::from(sign * corner[1])];
    }
    rotated
}

#[cfg(test)]
mod tests {
    use super::super::footprint::corners;
    use super::*;

    #[test]
    fn distances_are_those_of_the_boxes() {
        let unit = corners([0.0, 0.0], 0.0, 2.0, 2.0);
        for (center, heading, expected) in [
            ([5.0, 0.0], 0.0, 3.0),
            ([4.0, 4.0], 0.0, 8f64.sqrt()),
            ([0.5, 0.0], 0.0, -1.5),
            ([0.0, 0.0], 0.0, -2.0),
            ([4.0, 0.0], std::f32::consts::FRAC_PI_4, 3.0 - 2f64.sqrt()),
            ([2.0, 0.0], 0.0, 0.0),
        ] {
            let other = corners(center, heading, 2.0, 2.0);
            let found = signed_distance(&unit, &other);
            assert!((found - expected).abs() < 1e-6, "{center:?} {heading}: {found}, expected {expected}");
            assert!((signed_distance(&other, &unit) - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn boxes_without_extent_are_points() {
        let point = corners([3.0, 4.0], 0.3, 0.0, 0.0);
        assert_eq!(signed_distance(&point, &corners([0.0, 0.0], 0.0, 0.0, 0.0)), 5.0);
    }
}
