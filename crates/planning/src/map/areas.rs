//! Indexed lists of areas.

use reactsim_geometry::{Bounds, Grid, Vec2};

use super::Area;

/// Cell size of the index, metres.
const CELL_SIZE: f64 = 6.0;

/// Bound of the rounding errors of distances, metres.
const ROUNDING: f64 = 1e-6;

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

    /// Returns whether an area is less than `distance` metres from `p`.
    pub fn is_within(&self, p: Vec2, distance: f64) -> bool {
        // No point of an area is nearer than its bounds, up to rounding.
        let may_be = |area: &&Area| area.bounds().distance2(p).sqrt() - ROUNDING < distance;
        self.areas.iter().filter(may_be).any(|area| area.is_within(p, distance))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_area_is_within_a_distance_if_the_nearest_one_is() {
        let square = |x: f64, y: f64, side: f64| {
            let corners = [(x, y), (x + side, y), (x + side, y + side), (x, y + side)];
            Area::ring(corners.map(|(x, y)| Vec2::new(x, y)).to_vec()).unwrap()
        };
        let areas = Areas::new(vec![square(0.0, 0.0, 4.0), square(30.0, -2.0, 1.0), square(6.0, 6.0, 9.0)]);
        for k in 0..400 {
            let p = Vec2::new(f64::from(k % 20) * 2.3 - 8.0, f64::from(k / 20) * 1.9 - 12.0);
            let nearest = areas.list().iter().map(|area| area.distance(p)).fold(f64::INFINITY, f64::min);
            for distance in [0.0, 0.3, 2.0, nearest, nearest + 0.1] {
                assert_eq!(areas.is_within(p, distance), nearest < distance, "{p:?} {distance}");
            }
        }
        assert!(!Areas::new(Vec::new()).is_within(Vec2::zeros(), f64::INFINITY));
    }
}
