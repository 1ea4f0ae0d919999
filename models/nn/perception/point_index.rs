//! Points in cells, to find the nearest of many.

use reactsim_geometry::{Bounds, Grid, Vec2};

use super::Nearest;

/// Points in cells.
#[derive(Clone, Debug)]
pub struct PointIndex {
    points: Vec<Vec2>,
    grid: Grid,
}

/// Size of the cells, metres.
const CELL: f64 = 10.0;
/// Distance in metres within which the nearest points are sought first.
const FIRST_REACH: f64 = 15.0;
/// Margin of squared distances, m²: [`Nearest`] takes smaller differences for none.
const MARGIN: f64 = 1e-5;

impl PointIndex {
    /// Indexes points, metres.
    pub fn new(points: Vec<Vec2>) -> Self {
        let bounds: Vec<Bounds> = points.iter().map(|p| Bounds::around(*p, 0.0)).collect();
        Self { grid: Grid::new(&bounds, CELL), points }
    }

    /// Fills `nearest` with what it keeps if all accepted points are offered in order, each with its squared
    /// distance to `to`, m².
    pub fn nearest(&self, to: Vec2, accept: impl Fn(usize) -> bool, nearest: &mut Nearest) {
        let mut reach = FIRST_REACH;
        while reach.is_finite() {
            nearest.clear();
            let near = self.around(to, reach);
            for &i in near.iter().filter(|i| accept(**i)) {
                nearest.offer((self.points[i] - to).norm_squared(), i);
            }
            let found_all = nearest.worst().is_some_and(|worst| worst < reach * reach - MARGIN);
            if found_all || near.len() == self.points.len() {
                return;
            }
            reach *= 2.0;
        }
    }

    /// Returns the points within `reach` metres of `to` and some that are farther, ascending.
    pub fn around(&self, to: Vec2, reach: f64) -> Vec<usize> {
        let mut near = Vec::new();
        self.grid.visit(&Bounds::around(to, reach), |i| near.push(i as usize));
        near.sort_unstable();
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_are_those_of_all_points() {
        // Clusters, far points, and points that are equally far.
        let at = |i: u32| {
            let spread = if i.is_multiple_of(5) { 300.0 } else { 20.0 };
            let part = |of: u32| f64::from((i * of) % 101) / 101.0 - 0.5;
            Vec2::new((spread * part(37)).round(), (spread * part(53)).round())
        };
        let points: Vec<Vec2> = (0..300).map(at).collect();
        let index = PointIndex::new(points.clone());
        for k in [1, 8, 290, 400] {
            for to in [Vec2::zeros(), Vec2::new(3.0, -7.5), Vec2::new(140.0, 90.0), Vec2::new(-1e4, 2e3)] {
                for accept in [|_| true, |i: usize| i.is_multiple_of(3), |_| false] {
                    let (mut found, mut wanted) = (Nearest::new(k), Nearest::new(k));
                    index.nearest(to, accept, &mut found);
                    for (i, p) in points.iter().enumerate().filter(|(i, _)| accept(*i)) {
                        wanted.offer((p - to).norm_squared(), i);
                    }
                    assert!(found.found().eq(wanted.found()), "{k} {to}");
                }
            }
        }
    }

    #[test]
    fn without_points_there_is_none() {
        let mut nearest = Nearest::new(3);
        PointIndex::new(Vec::new()).nearest(Vec2::zeros(), |_| true, &mut nearest);
        assert_eq!(nearest.found().count(), 0);
    }
}
