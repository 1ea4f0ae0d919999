//! Indexed lists of areas.

use reactsim_geometry::{Bounds, Grid, Vec2};

use super::Area;

/// Cell size of the index, metres.
const CELL_SIZE: f64 = 6.0;

/// A list of areas with a spatial index.
#[derive(Clone, Debug)]
pub struct Areas {
    areas: Vec<Area>,
    grid: Grid,
}

impl Areas {
    /// Indexes the areas.
    pub fn new(areas: Vec<Area>) -> Self {
        let bounds: Vec<_> = areas.iter().map(Area::bounds).collect();
        Self { grid: Grid::new(&bounds, CELL_SIZE), areas }
    }

    /// Returns the areas, in their order.
    pub fn list(&self) -> &[Area] {
        &self.areas
    }

    /// Returns the indices of the areas that strictly contain `p`, ascending.
    pub fn at(&self, p: Vec2) -> impl Iterator<Item = usize> + '_ {
        self.grid.at(p).iter().map(|&i| i as usize).filter(move |&i| self.areas[i].contains(p))
    }

    /// Returns whether an area strictly contains `p`.
    pub fn contains(&self, p: Vec2) -> bool {
        self.at(p).next().is_some()
    }

    /// Returns the indices of the areas whose bounds intersect `within`, ascending.
    pub fn within(&self, within: &Bounds) -> Vec<usize> {
        let mut found = Vec::new();
        self.grid.visit(within, |i| found.push(i as usize));
        found.sort_unstable();
        found.dedup();
        found.retain(|&i| self.areas[i].bounds().intersects(within));
        found
    }

    /// Returns the distance from `p` to the nearest area, metres; infinite without areas.
    pub fn distance(&self, p: Vec2) -> f64 {
        self.areas.iter().map(|area| area.distance(p)).fold(f64::INFINITY, f64::min)
    }
}
