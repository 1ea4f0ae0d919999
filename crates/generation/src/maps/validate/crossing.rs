//! Crossings of segments.

use reactsim_geometry::{Bounds, Grid, Vec2};

use crate::maps::build::cross;

/// Reports every crossing of two segments by their indices, the lower one first.
pub(super) fn crossings(pieces: &[(Vec2, Vec2)], mut report: impl FnMut(usize, usize, Vec2)) {
    let bounds: Vec<Bounds> = pieces.iter().map(|&(a, b)| Bounds::of([a, b])).collect();
    let grid = Grid::new(&bounds, 8.0);
    for (i, &(a, b)) in pieces.iter().enumerate() {
        grid.visit(&bounds[i], |j| {
            let (c, d) = pieces[j as usize];
            if i < j as usize
                && let Some(at) = cross(a, b, c, d)
            {
                report(i, j as usize, at);
            }
        });
    }
}

/// Returns a crossing of two segments that `apart` allows to be compared.
pub(super) fn first_crossing(pieces: &[(Vec2, Vec2)], apart: impl Fn(usize, usize) -> bool) -> Option<Vec2> {
    let mut first = None;
    crossings(pieces, |i, j, at| {
        if apart(i, j) {
            first.get_or_insert(at);
        }
    });
    first
}
