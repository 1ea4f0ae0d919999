//! The ground around the AV as a grid.

use reactsim_geometry::Vec2;

use super::fill::fill;
use super::shapes::{GroundShapes, Shape};
use crate::ctg::sight::MAP_LAYERS;

/// Edge of a cell, metres.
const CELL: f64 = 0.5;
/// Bits of a cell, in the order of the layers of the images.
const DRIVABLE: u8 = 1;
const LINE: u8 = 2;
const CROSSWALK: u8 = 4;

/// Drivable area, centre lines, crosswalks and speed limits within a square around the AV's position at the
/// current frame.
#[derive(Clone, Debug)]
pub(crate) struct Ground {
    /// Corner with the smallest coordinates, metres.
    corner: Vec2,
    /// Cells along an edge.
    size: usize,
    /// Bits of each cell, by row, then column.
    cells: Vec<u8>,
    /// Largest speed limit of the lanes at each cell, m/s; 0 where none is known.
    limits: Vec<f32>,
    /// Squared distance of each cell from the next drivable one, in cells; empty until it is needed.
    away: Vec<f32>,
}

impl Ground {
    /// Draws the ground within `radius` metres, a square.
    pub(crate) fn of(shapes: &GroundShapes, radius: f64) -> Self {
        let size = (2.0 * radius / CELL).ceil() as usize;
        let corner = shapes.center - Vec2::repeat(0.5 * CELL * size as f64);
        let mut ground = Self {
            corner,
            size,
            cells: vec![0; size * size],
            limits: vec![0.0; size * size],
            away: Vec::new(),
        };
        for (layer, bit) in
            [(&shapes.drivable, DRIVABLE), (&shapes.lines, LINE), (&shapes.crosswalks, CROSSWALK)]
        {
            for shape in layer {
                fill(&ground.rings(shape), size, |column, row| ground.cells[row * size + column] |= bit);
            }
        }
        for (shape, limit) in &shapes.limits {
            let limit = *limit as f32;
            fill(&ground.rings(shape), size, |column, row| {
                let cell = &mut ground.limits[row * size + column];
                *cell = cell.max(limit);
            });
        }
        ground
    }

    /// Returns the ground with the distances of all places from the drivable area.
    pub(crate) fn with_distances(mut self) -> Self {
        self.away = distances(&self.cells, self.size);
        self
    }

    /// Returns a shape in cells.
    fn rings(&self, shape: &Shape) -> Vec<Vec<Vec2>> {
        shape.iter().map(|ring| ring.iter().map(|p| (p - self.corner) / CELL).collect()).collect()
    }

    fn cell(&self, p: Vec2) -> Option<usize> {
        let at = (p - self.corner) / CELL;
        let inside = |x: f64| x >= 0.0 && x < self.size as f64;
        (inside(at.x) && inside(at.y)).then(|| at.y as usize * self.size + at.x as usize)
    }

    /// Returns the layers at a place: drivable area, centre lines, crosswalks; nothing beyond the square.
    pub(super) fn layers(&self, p: Vec2) -> [bool; MAP_LAYERS] {
        let bits = self.cell(p).map_or(0, |cell| self.cells[cell]);
        [DRIVABLE, LINE, CROSSWALK].map(|bit| bits & bit != 0)
    }

    /// Returns the speed limit at a place, m/s; `None` if none is known.
    pub(crate) fn speed_limit(&self, p: Vec2) -> Option<f64> {
        self.cell(p).map(|cell| f64::from(self.limits[cell])).filter(|limit| *limit > 0.0)
    }

    /// Returns the distance of a place from the drivable area, metres, and its gradient; 0 inside, beyond the
    /// square, and everywhere if nothing is drivable.
    pub(crate) fn away(&self, p: Vec2) -> (f64, Vec2) {
        // Bilinear between the centres of cells.
        let at = (p - self.corner) / CELL - Vec2::repeat(0.5);
        let last = self.size as f64 - 1.0;
        if self.away.is_empty() || !(at.x >= 0.0 && at.y >= 0.0 && at.x < last && at.y < last) {
            return (0.0, Vec2::zeros());
        }
        let (column, row) = (at.x as usize, at.y as usize);
        let (u, v) = (at.x - column as f64, at.y - row as f64);
        let value = |c: usize, r: usize| f64::from(self.away[(row + r) * self.size + column + c]).sqrt();
        let [a, b, c, d] = [value(0, 0), value(1, 0), value(0, 1), value(1, 1)];
        let distance = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v;
        let gradient = Vec2::new((b - a) * (1.0 - v) + (d - c) * v, (c - a) * (1.0 - u) + (d - b) * u);
        (distance * CELL, gradient)
    }
}

/// Returns the squared distance of each cell from the next drivable one, in cells (Felzenszwalb and
/// Huttenlocher, "Distance Transforms of Sampled Functions"); nothing if none is drivable.
fn distances(cells: &[u8], size: usize) -> Vec<f32> {
    if !cells.iter().any(|bits| bits & DRIVABLE != 0) {
        return Vec::new();
    }
    // Farther than any cell from any other.
    let far = 4.0 * (size * size) as f64;
    let mut all: Vec<f64> = cells.iter().map(|bits| if bits & DRIVABLE != 0 { 0.0 } else { far }).collect();
    let mut line = vec![0.0; size];
    for column in 0..size {
        (0..size).for_each(|row| line[row] = all[row * size + column]);
        for (row, value) in lower_envelope(&line).into_iter().enumerate() {
            all[row * size + column] = value;
        }
    }
    for row in all.chunks_mut(size) {
        row.copy_from_slice(&lower_envelope(row));
    }
    all.into_iter().map(|value| value as f32).collect()
}

/// Returns the smallest of f(q) + (p - q)² over all q, by p.
fn lower_envelope(f: &[f64]) -> Vec<f64> {
    // Parabolas that are lowest somewhere, and where each begins to be.
    let (mut lowest, mut from) = (vec![0usize], vec![f64::NEG_INFINITY]);
    let square = |q: usize| (q * q) as f64;
    for q in 1..f.len() {
        let meets = |r: usize| ((f[q] + square(q)) - (f[r] + square(r))) / (2 * (q - r)) as f64;
        let mut at = meets(lowest[lowest.len() - 1]);
        while at <= from[from.len() - 1] {
            lowest.pop();
            from.pop();
            at = meets(lowest[lowest.len() - 1]);
        }
        lowest.push(q);
        from.push(at);
    }
    let mut k = 0;
    let value = |p: usize| {
        while k + 1 < from.len() && from[k + 1] < p as f64 {
            k += 1;
        }
        let apart = p as f64 - lowest[k] as f64;
        f[lowest[k]] + apart * apart
    };
    (0..f.len()).map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes(drivable: Vec<Shape>) -> GroundShapes {
        let lane = vec![square(-8.0, 8.0)];
        let limits = vec![(lane.clone(), 10.0), (vec![square(-2.0, 2.0)], 15.0)];
        let center = Vec2::new(1.0, 0.0);
        GroundShapes { center, drivable, lines: vec![lane], limits, ..GroundShapes::default() }
    }

    fn square(from: f64, to: f64) -> Vec<Vec2> {
        vec![Vec2::new(from, from), Vec2::new(to, from), Vec2::new(to, to), Vec2::new(from, to)]
    }

    #[test]
    fn places_have_layers_and_the_largest_limit() {
        let ground = Ground::of(&shapes(vec![vec![square(-4.0, 4.0)]]), 20.0);
        assert_eq!(ground.layers(Vec2::new(3.0, -3.0)), [true, true, false]);
        assert_eq!(ground.layers(Vec2::new(6.0, -3.0)), [false, true, false]);
        assert_eq!(ground.layers(Vec2::new(60.0, 0.0)), [false; 3]);
        assert_eq!(ground.speed_limit(Vec2::new(6.0, 0.0)), Some(10.0));
        assert_eq!(ground.speed_limit(Vec2::new(1.0, 0.0)), Some(15.0));
        assert_eq!(ground.speed_limit(Vec2::new(12.0, 0.0)), None);
    }

    #[test]
    fn distances_grow_away_from_the_drivable_area() {
        let ground = Ground::of(&shapes(vec![vec![square(-4.0, 4.0)]]), 20.0).with_distances();
        for (p, distance) in [((0.0, 0.0), 0.0), ((10.0, 1.0), 6.0), ((1.0, -9.0), 5.0), ((7.0, 8.0), 5.0)] {
            let found = ground.away(Vec2::new(p.0, p.1)).0;
            // Distances are from centre to centre of cells.
            assert!((found - distance).abs() < 0.75 * CELL, "{p:?}: {found}");
        }
        let (at, gradient) = ground.away(Vec2::new(9.0, 1.1));
        assert!((gradient - Vec2::new(1.0, 0.0)).norm() < 1e-6, "{gradient}");
        let moved = ground.away(Vec2::new(9.2, 1.1)).0;
        assert!((moved - at - 0.2).abs() < 1e-6);
        assert_eq!(ground.away(Vec2::new(90.0, 0.0)), (0.0, Vec2::zeros()));
    }

    #[test]
    fn without_a_drivable_area_nothing_is_off_it() {
        let ground = Ground::of(&shapes(Vec::new()), 20.0).with_distances();
        assert_eq!(ground.away(Vec2::new(9.0, 1.0)), (0.0, Vec2::zeros()));
    }

    #[test]
    fn squared_distances_are_those_of_all_pairs() {
        let size = 17;
        let cells: Vec<u8> = (0..size * size).map(|i| u8::from((i * 7919) % 41 == 3)).collect();
        let found = distances(&cells, size);
        for (i, found) in found.iter().enumerate() {
            let to = |j: &usize| {
                let (x, y) = ((i % size) as f64 - (j % size) as f64, (i / size) as f64 - (j / size) as f64);
                x * x + y * y
            };
            let drivable = (0..cells.len()).filter(|j| cells[*j] == DRIVABLE);
            let nearest = drivable.map(|j| to(&j)).fold(f64::INFINITY, f64::min);
            assert_eq!(f64::from(*found), nearest);
        }
    }
}
