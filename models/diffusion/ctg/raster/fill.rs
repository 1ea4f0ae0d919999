//! Filling of outlines.

use reactsim_geometry::Vec2;

/// Visits the cells, column and row, of a raster of `size` by `size` cells whose centres lie inside these
/// rings, by the even-odd rule. Coordinates are in cells; the centre of the first one is at (0.5, 0.5).
pub(super) fn fill(rings: &[Vec<Vec2>], size: usize, mut visit: impl FnMut(usize, usize)) {
    let ys = || rings.iter().flatten().map(|p| p.y);
    let (low, high) = (ys().fold(f64::INFINITY, f64::min), ys().fold(f64::NEG_INFINITY, f64::max));
    let mut crossings = Vec::new();
    for row in first_centre(low)..first_centre(high).min(size) {
        let y = row as f64 + 0.5;
        crossings.clear();
        for ring in rings {
            let ends = ring.iter().skip(1).chain(ring.first());
            for (a, b) in ring.iter().zip(ends) {
                if (a.y <= y) != (b.y <= y) {
                    crossings.push(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
                }
            }
        }
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            for column in first_centre(pair[0])..first_centre(pair[1]).min(size) {
                visit(column, row);
            }
        }
    }
}

/// Returns the first cell whose centre is at this coordinate or beyond; 0 if it is no number.
fn first_centre(x: f64) -> usize {
    (x - 0.5).ceil().max(0.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(rings: &[Vec<Vec2>], size: usize) -> Vec<(usize, usize)> {
        let mut found = Vec::new();
        fill(rings, size, |column, row| found.push((column, row)));
        found
    }

    fn square(from: f64, to: f64) -> Vec<Vec2> {
        vec![Vec2::new(from, from), Vec2::new(to, from), Vec2::new(to, to), Vec2::new(from, to)]
    }

    #[test]
    fn cells_count_by_their_centres_and_holes_are_left_out() {
        assert_eq!(cells(&[square(0.6, 2.4)], 4), [(1, 1)]);
        assert_eq!(cells(&[square(0.4, 1.6)], 4), [(0, 0), (1, 0), (0, 1), (1, 1)]);
        let ring = cells(&[square(0.0, 3.0), square(1.0, 2.0)], 4);
        assert_eq!(ring.len(), 8);
        assert!(!ring.contains(&(1, 1)));
    }

    #[test]
    fn what_lies_outside_of_the_raster_is_cut() {
        assert_eq!(cells(&[square(-5.0, 50.0)], 3).len(), 9);
        assert!(cells(&[square(7.0, 9.0)], 3).is_empty());
        assert!(cells(&[square(-9.0, -7.0)], 3).is_empty());
        assert!(cells(&[vec![Vec2::new(f64::NAN, 1.0); 3]], 3).is_empty());
        assert!(cells(&[], 3).is_empty());
    }
}
