//! Drivable area, which some files contain as boundary rings.

use reactsim_geometry::{Polygon, Vec2, point_in_ring};

/// Prefix of the keys of boundary features.
pub(super) const KEY_PREFIX: &str = "boundary_";
/// Maximum number of rings; part of a city has some dozen.
const MAX_RINGS: usize = 500;
/// Maximum product of the numbers of points and rings, which bounds the work of comparing rings.
const MAX_COMPARISONS: usize = 100_000_000;
/// Maximum number of points of a ring that are tested for being inside another ring.
const MAX_TESTED_POINTS: usize = 8;

/// Joins boundary lines to polygons; `None` unless the lines form closed rings only. Rings inside others are
/// holes. Newer files split a ring into successive pieces.
pub(super) fn ground(lines: &[&[Vec2]]) -> Option<Vec<Polygon>> {
    let mut rings: Vec<Vec<Vec2>> = Vec::new();
    let mut ring: Vec<Vec2> = Vec::new();
    for line in lines {
        ring.extend_from_slice(line);
        if ring.len() > 3 && ring.first() == ring.last() {
            ring.pop();
            rings.push(std::mem::take(&mut ring));
        }
    }
    let points: usize = rings.iter().map(Vec::len).sum();
    let too_large = rings.len() > MAX_RINGS || points.saturating_mul(rings.len()) > MAX_COMPARISONS;
    if !ring.is_empty() || rings.is_empty() || too_large {
        return None;
    }
    Some(nest(rings))
}

/// Groups rings into polygons. Rings do not cross, so each is entirely inside or outside another. A ring
/// inside an even number of others is an exterior; a ring inside an odd number is a hole of the smallest ring
/// around it.
fn nest(rings: Vec<Vec<Vec2>>) -> Vec<Polygon> {
    let around: Vec<Vec<usize>> = (0..rings.len())
        .map(|i| {
            let holds = |j: &usize| *j != i && inside(&rings[i], &rings[*j]);
            (0..rings.len()).filter(holds).collect()
        })
        .collect();
    let mut polygons: Vec<(usize, Polygon)> = Vec::new();
    for (i, ring) in rings.iter().enumerate().filter(|(i, _)| around[*i].len().is_multiple_of(2)) {
        polygons.push((i, Polygon { exterior: ring.clone(), holes: Vec::new() }));
    }
    for (i, ring) in rings.into_iter().enumerate().filter(|(i, _)| !around[*i].len().is_multiple_of(2)) {
        // The innermost ring around this one is inside one ring fewer.
        let outer = around[i].iter().copied().find(|o| around[*o].len() + 1 == around[i].len());
        if let Some((_, polygon)) = outer.and_then(|o| polygons.iter_mut().find(|(p, _)| *p == o)) {
            polygon.holes.push(ring);
        }
    }
    polygons.into_iter().map(|(_, polygon)| polygon).collect()
}

/// Returns whether a ring is inside another. Rings may touch, so the first point that is not on the other
/// ring decides.
fn inside(ring: &[Vec2], other: &[Vec2]) -> bool {
    ring.iter().take(MAX_TESTED_POINTS).find_map(|p| point_in_ring(*p, other)).unwrap_or(false)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests stop at what they did not expect")]

    use super::*;

    fn square(x: f64, y: f64, side: f64) -> Vec<Vec2> {
        [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side), (0.0, 0.0)]
            .map(|(dx, dy)| Vec2::new(x + dx, y + dy))
            .to_vec()
    }

    fn slices(lines: &[Vec<Vec2>]) -> Vec<&[Vec2]> {
        lines.iter().map(Vec::as_slice).collect()
    }

    #[test]
    fn rings_nest() {
        let lines =
            [square(2.0, 2.0, 6.0), square(0.0, 0.0, 10.0), square(20.0, 0.0, 5.0), square(3.0, 3.0, 2.0)];
        let ground = ground(&slices(&lines)).unwrap();
        assert_eq!(ground.len(), 3);
        let drivable = |x, y| ground.iter().any(|p| p.contains(Vec2::new(x, y)));
        assert!(drivable(1.0, 1.0) && drivable(22.0, 2.0) && drivable(4.0, 4.0));
        assert!(!drivable(7.0, 7.0) && !drivable(15.0, 2.0));
    }

    #[test]
    fn pieces_of_a_ring_are_joined_and_open_lines_give_none() {
        let whole = square(0.0, 0.0, 10.0);
        let pieces = [whole[..2].to_vec(), whole[2..4].to_vec(), whole[4..].to_vec(), square(20.0, 0.0, 5.0)];
        assert_eq!(ground(&slices(&pieces)).unwrap().len(), 2);
        assert!(ground(&slices(&pieces[..2])).is_none());
        assert!(ground(&[]).is_none());
    }
}
