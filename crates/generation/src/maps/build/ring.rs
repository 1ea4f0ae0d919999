//! Outlines of lines and corners, and crossings of segments.

use reactsim_geometry::{Vec2, left};

/// Returns the directions of a polyline at its points; at the ends, those of the end segments.
fn tangents(points: &[Vec2]) -> Vec<Vec2> {
    let last = points.len() - 1;
    (0..points.len())
        .map(|i| {
            let d = points[(i + 1).min(last)] - points[i.saturating_sub(1)];
            d / d.norm().max(1e-12)
        })
        .collect()
}

/// Returns the line shifted to the left by `offset` metres.
pub(super) fn beside(points: &[Vec2], offset: f64) -> Vec<Vec2> {
    points.iter().zip(tangents(points)).map(|(&p, t)| p + left(t) * offset).collect()
}

/// Returns the ring at distance `half` around a line, with flat ends, counter-clockwise. At least two
/// points, none repeated.
pub fn ribbon(points: &[Vec2], half: f64) -> Vec<Vec2> {
    let mut ring = beside(points, -half);
    let mut back = beside(points, half);
    back.reverse();
    ring.append(&mut back);
    ring
}

/// Returns the surface between two edges that meet at `corner` and an arc of this radius tangent to both: a
/// kerb return.
///
/// `along` and `other` are unit vectors from the corner along the edges. Empty if they are nearly parallel.
pub fn fillet(corner: Vec2, along: Vec2, other: Vec2, radius: f64) -> Vec<Vec2> {
    let cos = along.dot(&other).clamp(-1.0, 1.0);
    let middle = along + other;
    if cos.abs() > 0.98 || middle.norm() < 1e-6 {
        return Vec::new();
    }
    // Tangent of half the angle at the corner, from the cosine of the angle.
    let tan_half = ((1.0 - cos) / (1.0 + cos)).sqrt();
    let sin_half = ((1.0 - cos) / 2.0).sqrt();
    let reach = radius / tan_half;
    let centre = corner + middle / middle.norm() * (radius / sin_half);
    let (a, b) = (corner + along * reach - centre, corner + other * reach - centre);
    let mut ring = vec![corner, corner + along * reach];
    const PARTS: usize = 8;
    for i in 1..PARTS {
        // Points on the arc, spaced evenly enough: normalised blends of its two radii.
        let u = i as f64 / PARTS as f64;
        let d = a * (1.0 - u) + b * u;
        ring.push(centre + d / d.norm() * radius);
    }
    ring.push(corner + other * reach);
    ring
}

/// Returns the intersection of two segments. A segment includes the border of its left side, so that a line
/// through a corner crosses once.
pub(in crate::maps) fn cross(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> Option<Vec2> {
    let (ab, cd) = (b - a, d - c);
    let (of_c, of_d) = (ab.perp(&(c - a)), ab.perp(&(d - a)));
    let (of_a, of_b) = (cd.perp(&(a - c)), cd.perp(&(b - c)));
    if (of_c >= 0.0) == (of_d >= 0.0) || (of_a >= 0.0) == (of_b >= 0.0) {
        return None;
    }
    Some(c + cd * (of_c / (of_c - of_d)))
}

#[cfg(test)]
mod tests {
    use super::super::ground::area;
    use super::*;

    #[test]
    fn a_ribbon_has_the_area_of_its_line() {
        let ring = ribbon(&[Vec2::zeros(), Vec2::new(10.0, 0.0), Vec2::new(20.0, 0.0)], 1.5);
        assert!((area(&ring) - 60.0).abs() < 1e-9);
    }

    #[test]
    fn a_fillet_is_what_a_square_has_beside_its_circle() {
        let ring = fillet(Vec2::zeros(), Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0), 6.0);
        let exact = 36.0 * (1.0 - std::f64::consts::FRAC_PI_4);
        assert!((area(&ring).abs() - exact).abs() < 0.3, "{} {exact}", area(&ring));
        assert!(fillet(Vec2::zeros(), Vec2::new(1.0, 0.0), Vec2::new(-1.0, 0.0), 6.0).is_empty());
    }
}
