//! A uniform grid over axis-aligned bounds: the spatial index of every map query.

use std::ops::Range;

use super::Vec2;

/// An axis-aligned rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec2,
    /// Upper corner.
    pub max: Vec2,
}

impl Default for Bounds {
    /// Bounds that contain nothing.
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Bounds {
    /// Bounds that contain nothing.
    pub const EMPTY: Self = Self {
        min: Vec2::new(f64::INFINITY, f64::INFINITY),
        max: Vec2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Returns the smallest bounds around `points`.
    pub fn of(points: impl IntoIterator<Item = Vec2>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { min: b.min.inf(&p), max: b.max.sup(&p) })
    }

    /// Returns the square with half side `radius` around `center`.
    #[inline]
    pub fn around(center: Vec2, radius: f64) -> Self {
        let r = Vec2::new(radius, radius);
        Self { min: center - r, max: center + r }
    }

    /// Returns these bounds grown by `margin` on every side.
    #[inline]
    pub fn inflated(&self, margin: f64) -> Self {
        let m = Vec2::new(margin, margin);
        Self { min: self.min - m, max: self.max + m }
    }

    /// Returns the smallest bounds around both.
    #[inline]
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.inf(&other.min), max: self.max.sup(&other.max) }
    }

    /// Returns whether `p` is in the closed rectangle.
    #[inline]
    pub fn contains(&self, p: Vec2) -> bool {
        self.min.x <= p.x && p.x <= self.max.x && self.min.y <= p.y && p.y <= self.max.y
    }

    /// Returns the squared distance to `p`, m²; 0 inside.
    #[inline]
    pub fn distance2(&self, p: Vec2) -> f64 {
        let beyond = |min: f64, max: f64, at: f64| (min - at).max(at - max).max(0.0);
        let x = beyond(self.min.x, self.max.x, p.x);
        let y = beyond(self.min.y, self.max.y, p.y);
        x * x + y * y
    }

    /// Returns whether the closed rectangles intersect.
    #[inline]
    pub fn intersects(&self, other: &Self) -> bool {
        self.min.x <= other.max.x
            && other.min.x <= self.max.x
            && self.min.y <= other.max.y
            && other.min.y <= self.max.y
    }
}

/// Items in square cells, by their bounds. Every cell that the bounds of an item touch lists the item, in
/// insertion order.
#[derive(Clone, Debug)]
pub struct Grid {
    origin: Vec2,
    cell: f64,
    cells_per_metre: f64,
    columns: i64,
    rows: i64,
    starts: Vec<u32>,
    items: Vec<u32>,
}

/// Cells of a grid in some rows and columns.
struct Cells {
    rows: Range<u32>,
    columns: Range<u32>,
    /// Number of columns of the grid.
    width: u32,
}

impl Cells {
    /// Visits each cell by number.
    #[inline]
    fn visit(&self, mut visit: impl FnMut(usize)) {
        for row in self.rows.clone() {
            self.columns.clone().for_each(|column| visit((row * self.width + column) as usize));
        }
    }
}

/// Returns the largest whole number up to `v`. Avoids `f64::floor`, which is a function call on processors
/// without a rounding instruction.
#[inline]
pub fn floor(v: f64) -> i64 {
    let whole = v as i64;
    if (whole as f64) > v { whole.saturating_sub(1) } else { whole }
}

/// Largest number of a column or row: more distant points are taken to lie there, far outside of any grid.
const FARTHEST_CELL: i64 = 1 << 50;

/// Maximum number of cells; larger extents get larger cells.
const MAX_CELLS: f64 = 65_536.0;
/// Maximum number of list entries over all cells, unless sixteen per item are more; beyond it the cells grow.
const MAX_ENTRIES: f64 = 4e6;

/// Squared distance of a start, in squared cell sizes, up to which all cells within that distance are visited
/// row by row.
const NEAR_CELLS: f64 = 16.0;

/// Distance of a point from the grid, in cells, up to which nearest items are searched in rings around it.
const FAR_RINGS: i64 = 4;

impl Grid {
    /// Indexes `bounds` (item `i` is `bounds[i]`) in cells of about `cell` metres. Empty bounds are left out.
    pub fn new(bounds: &[Bounds], cell: f64) -> Self {
        let whole = bounds.iter().fold(Bounds::EMPTY, |a, b| a.union(b));
        if !(whole.min.x <= whole.max.x) {
            return Self {
                origin: Vec2::zeros(),
                cell,
                cells_per_metre: 1.0 / cell,
                columns: 0,
                rows: 0,
                starts: vec![0],
                items: Vec::new(),
            };
        }
        let extent = whole.max - whole.min;
        let mut cell = cell;
        while (extent.x / cell + 1.0).floor() * (extent.y / cell + 1.0).floor() > MAX_CELLS {
            cell *= 1.5;
        }
        // Large items in small cells would be listed in very many cells.
        let max_entries = MAX_ENTRIES.max(16.0 * bounds.len() as f64);
        let entries = |cell: f64| -> f64 {
            let sides = bounds.iter().map(|b| b.max - b.min).filter(|side| side.x >= 0.0);
            sides.map(|side| (side.x / cell + 2.0) * (side.y / cell + 2.0)).sum()
        };
        while cell < extent.x.max(extent.y) && entries(cell) > max_entries {
            cell *= 1.5;
        }
        // Computed as in `column`, so that the last bounds end in the last cell.
        let cells_per_metre = 1.0 / cell;
        let columns = floor(extent.x * cells_per_metre) + 1;
        let rows = floor(extent.y * cells_per_metre) + 1;
        let mut grid = Self {
            origin: whole.min,
            cell,
            cells_per_metre,
            columns,
            rows,
            starts: Vec::new(),
            items: Vec::new(),
        };
        let areas: Vec<Cells> = bounds.iter().map(|b| grid.cells(b)).collect();
        let mut starts = vec![0_u32; (columns * rows) as usize + 1];
        areas.iter().for_each(|area| area.visit(|c| starts[c] += 1));
        // The ends of the cells, which become their starts when they are filled, the last item first.
        let mut entries = 0;
        for start in &mut starts {
            entries += *start;
            *start = entries;
        }
        let mut items = vec![0_u32; entries as usize];
        for (i, area) in areas.iter().enumerate().rev() {
            area.visit(|c| {
                starts[c] -= 1;
                items[starts[c] as usize] = i as u32;
            });
        }
        grid.starts = starts;
        grid.items = items;
        grid
    }

    fn column(&self, x: f64) -> i64 {
        floor((x - self.origin.x) * self.cells_per_metre).clamp(-FARTHEST_CELL, FARTHEST_CELL)
    }

    fn row(&self, y: f64) -> i64 {
        floor((y - self.origin.y) * self.cells_per_metre).clamp(-FARTHEST_CELL, FARTHEST_CELL)
    }

    /// Returns the cells that bounds touch.
    #[inline]
    fn cells(&self, b: &Bounds) -> Cells {
        let range =
            |low: i64, high: i64, count: i64| low.clamp(0, count) as u32..(high + 1).clamp(0, count) as u32;
        let rows = range(self.row(b.min.y), self.row(b.max.y), self.rows);
        let columns = range(self.column(b.min.x), self.column(b.max.x), self.columns);
        let is_empty = !(b.min.x <= b.max.x);
        Cells { rows: if is_empty { 0..0 } else { rows }, columns, width: self.columns as u32 }
    }

    fn items_of(&self, cell: usize) -> &[u32] {
        &self.items[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    /// Returns the items of the cell that contains `p`, each once, ascending.
    #[inline]
    pub fn at(&self, p: Vec2) -> &[u32] {
        let (column, row) = (self.column(p.x), self.row(p.y));
        if (0..self.columns).contains(&column) && (0..self.rows).contains(&row) {
            self.items_of((row * self.columns + column) as usize)
        } else {
            &[]
        }
    }

    /// Visits the items of every cell that `within` touches. An item may be visited more than once.
    pub fn visit(&self, within: &Bounds, mut visit: impl FnMut(u32)) {
        self.cells(within).visit(|c| self.items_of(c).iter().for_each(|&i| visit(i)));
    }

    /// Finds the item nearest to `p` and its squared distance; the smallest index on ties.
    ///
    /// `distance2` returns the squared distance of an item. `start` is any item to begin with, such as the
    /// answer for a nearby point; it shortens the search and never changes the answer.
    pub fn nearest(
        &self,
        p: Vec2,
        start: Option<u32>,
        mut distance2: impl FnMut(u32) -> f64,
    ) -> Option<(u32, f64)> {
        if self.items.is_empty() {
            return None;
        }
        if let Some(start) = start {
            let found = distance2(start);
            if found < NEAR_CELLS * self.cell * self.cell {
                return Some(self.nearest_by_rows(p, (start, found), distance2));
            }
        }
        let best = start.map_or((u32::MAX, f64::INFINITY), |i| (i, distance2(i)));
        Some(self.nearest_by_rings(p, best, distance2))
    }

    /// Finds the item nearest to `p` within `radius` metres; the smallest index on ties. `distance2` returns
    /// the squared distance of an item.
    pub fn nearest_within(&self, p: Vec2, radius: f64, distance2: impl FnMut(u32) -> f64) -> Option<u32> {
        let none = (u32::MAX, radius * radius);
        let found = if self.items.is_empty() { none } else { self.nearest_by_rings(p, none, distance2) };
        (found.0 != none.0).then_some(found.0)
    }

    /// Finds an item nearer than `best`, an item and its squared distance, in rings of cells around `p`.
    fn nearest_by_rings(
        &self,
        p: Vec2,
        mut best: (u32, f64),
        mut distance2: impl FnMut(u32) -> f64,
    ) -> (u32, f64) {
        let (column, row) = (self.column(p.x), self.row(p.y));
        let (inside_column, inside_row) = (column.clamp(0, self.columns - 1), row.clamp(0, self.rows - 1));
        if (column - inside_column).abs().max((row - inside_row).abs()) > FAR_RINGS {
            // Rings around a distant point cross most cells of the grid before they reach the nearest item.
            let start = self.any_near(inside_column, inside_row);
            let found = (start, distance2(start));
            let best = if found.1 < best.1 { found } else { best };
            return self.nearest_by_rows(p, best, distance2);
        }
        let local = (p - self.origin) / self.cell - Vec2::new(column as f64, row as f64);
        let inner = local.x.min(1.0 - local.x).min(local.y).min(1.0 - local.y);
        for ring in 0..=self.last_ring(column, row) {
            // Every cell of this ring is at least this far away.
            let reach = ((ring - 1) as f64 + inner) * self.cell;
            if ring > 0 && reach > 0.0 && reach * reach > best.1 {
                break;
            }
            self.for_ring(column, row, ring, |c, r| {
                let low = self.origin + Vec2::new(c as f64, r as f64) * self.cell;
                let dx = (low.x - p.x).max(p.x - low.x - self.cell).max(0.0);
                let dy = (low.y - p.y).max(p.y - low.y - self.cell).max(0.0);
                // The slack covers ties exactly on the border of a cell.
                if dx * dx + dy * dy <= best.1 + 1e-9 {
                    for &i in self.items_of((r * self.columns + c) as usize) {
                        let d2 = distance2(i);
                        if d2 < best.1 || (d2 == best.1 && i < best.0) {
                            best = (i, d2);
                        }
                    }
                }
            });
        }
        best
    }

    /// Returns an item of a cell that is among the nearest ones with items to a cell. The grid has items.
    fn any_near(&self, column: i64, row: i64) -> u32 {
        let mut found = None;
        for ring in 0..=self.last_ring(column, row) {
            self.for_ring(column, row, ring, |c, r| {
                found = found.or(self.items_of((r * self.columns + c) as usize).first().copied());
            });
            if found.is_some() {
                break;
            }
        }
        found.unwrap_or(self.items[0])
    }

    /// Returns the index of the last ring of cells around a cell that has cells of the grid.
    fn last_ring(&self, column: i64, row: i64) -> i64 {
        column.max(self.columns - 1 - column).max(row).max(self.rows - 1 - row)
    }

    /// Visits the cells of the grid at `ring` columns or rows from a cell, row by row.
    fn for_ring(&self, column: i64, row: i64, ring: i64, mut visit: impl FnMut(i64, i64)) {
        for r in (row - ring).max(0)..=(row + ring).min(self.rows - 1) {
            if (r - row).abs() == ring {
                ((column - ring).max(0)..=(column + ring).min(self.columns - 1)).for_each(|c| visit(c, r));
            } else {
                let sides = [column - ring, column + ring];
                sides.into_iter().filter(|c| (0..self.columns).contains(c)).for_each(|c| visit(c, r));
            }
        }
    }

    /// Finds the nearest item as [`Self::nearest`] does, in the cells that are no farther than `best`, an
    /// item and its squared distance.
    fn nearest_by_rows(
        &self,
        p: Vec2,
        mut best: (u32, f64),
        mut distance2: impl FnMut(u32) -> f64,
    ) -> (u32, f64) {
        // The slack covers ties exactly on the border of a cell.
        let reach = (best.1 + 1e-9).sqrt() + 1e-9;
        for row in self.row(p.y - reach).max(0)..=self.row(p.y + reach).min(self.rows - 1) {
            let low = self.origin.y + row as f64 * self.cell;
            let dy = (low - p.y).max(p.y - low - self.cell).max(0.0);
            let rest = best.1 + 1e-9 - dy * dy;
            if rest < 0.0 {
                continue;
            }
            let reach = rest.sqrt() + 1e-9;
            let columns = self.column(p.x - reach).max(0)..=self.column(p.x + reach).min(self.columns - 1);
            for column in columns {
                for &i in self.items_of((row * self.columns + column) as usize) {
                    let d2 = distance2(i);
                    if d2 < best.1 || (d2 == best.1 && i < best.0) {
                        best = (i, d2);
                    }
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn nearest_is_the_linear_scan(
            points in prop::collection::vec((-50.0..50.0_f64, -20.0..20.0_f64), 1..60),
            q in (-300.0..300.0_f64, -90.0..90.0_f64),
            start in any::<prop::sample::Index>(),
        ) {
            let points: Vec<Vec2> =
                points.into_iter().map(|(x, y)| Vec2::new(x.round(), y.round())).collect();
            let grid = Grid::new(&points.iter().map(|&p| Bounds::around(p, 0.0)).collect::<Vec<_>>(), 3.0);
            let q = Vec2::new(q.0.round(), q.1.round());
            let d2 = |i: u32| (points[i as usize] - q).norm_squared();
            let scan = (0..points.len() as u32)
                .map(|i| (i, d2(i)))
                .fold((u32::MAX, f64::INFINITY), |b, c| if c.1 < b.1 { c } else { b });
            prop_assert_eq!(grid.nearest(q, None, d2), Some(scan));
            let start = start.index(points.len()) as u32;
            prop_assert_eq!(grid.nearest(q, Some(start), d2), Some(scan));
            let near = (scan.1 <= 49.0).then_some(scan.0);
            prop_assert_eq!(grid.nearest_within(q, 7.0, d2), near);
        }
    }

    #[test]
    fn large_items_are_not_listed_in_too_many_cells() {
        let whole = Bounds { min: Vec2::new(-1e5, -1e5), max: Vec2::new(1e5, 1e5) };
        let grid = Grid::new(&[whole; 3000], 6.0);
        assert!(grid.items.len() <= 4_000_000, "{}", grid.items.len());
        assert_eq!(grid.at(Vec2::new(99_999.0, 0.0)).len(), 3000);
    }

    #[test]
    fn distant_points_find_the_nearest_at_once() {
        let points: Vec<Vec2> = (0..400).map(|i| Vec2::new(f64::from(i % 20), f64::from(i / 20))).collect();
        let grid = Grid::new(&points.iter().map(|&p| Bounds::around(p, 0.0)).collect::<Vec<_>>(), 1.0);
        let nearest = |p: Vec2| grid.nearest(p, None, |i| (points[i as usize] - p).norm_squared());
        for (far, found) in [((5.0, 1e4), 385), ((5.0, -1e4), 5), ((1e4, 7.0), 159), ((-1e4, 7.0), 140)] {
            assert_eq!(nearest(Vec2::new(far.0, far.1)).map(|n| n.0), Some(found), "{far:?}");
        }
        // Rings around these have up to 10^18 cells.
        for far in [1e10, 1e18, 1e300] {
            for p in [Vec2::new(5.0, far), Vec2::new(-far, 7.0), Vec2::new(far, -far)] {
                assert!(nearest(p).is_some(), "{p}");
            }
        }
    }

    #[test]
    fn an_empty_grid_finds_nothing() {
        let grid = Grid::new(&[], 4.0);
        assert!(grid.at(Vec2::zeros()).is_empty());
        assert_eq!(grid.nearest(Vec2::zeros(), None, |_| 0.0), None);
    }
}
