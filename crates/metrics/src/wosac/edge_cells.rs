//! A pyramid of cells that finds the road-edge segments which can be nearest to a point.
//!
//! A cell has the segments that can be nearest to any point in it; they are among those of the cell above.
//! Cells are filled when a point first needs them: rollouts of one scenario visit the same few cells again
//! and again.

use std::collections::HashMap;

use super::edge_segments::{CellBox, EdgeSegments, Scratch};

/// Widths of the cells of every level in metres. They are powers of two, so that cells nest exactly.
const WIDTHS: [f64; 5] = [1024.0, 256.0, 64.0, 16.0, 4.0];
/// Heights of the cells relative to their width.
const HEIGHT_PER_WIDTH: f64 = 0.125;
/// Maximum number of stored segments; beyond it all cells are emptied. Only rollouts that leave the map get
/// there.
const MAX_STORED: usize = 1 << 22;

/// Number of queries after which a cell is divided. Before, its own segments are compared: points far from
/// the map, which are all in different cells, would otherwise fill a cell of every level each.
const QUERIES_BEFORE_DIVISION: u32 = 4;

/// Cells filled so far.
pub(super) struct EdgeCells<'a> {
    all: &'a EdgeSegments,
    indices: HashMap<Key, usize>,
    cells: Vec<Cell>,
    /// Number of segments in all cells.
    stored: usize,
    /// The cell of the most recent query, if it is of the lowest level.
    recent: Option<(Key, usize)>,
    scratch: Scratch,
}

struct Cell {
    segments: EdgeSegments,
    /// Number of queries that this cell answered or passed on to a new cell below.
    queries: u32,
}

/// Level and position of a cell.
type Key = (u8, [i32; 3]);

impl<'a> EdgeCells<'a> {
    /// Begins with no cells.
    pub(super) fn new(all: &'a EdgeSegments) -> Self {
        Self {
            all,
            indices: HashMap::new(),
            cells: Vec::new(),
            stored: 0,
            recent: None,
            scratch: Scratch::default(),
        }
    }

    /// Returns the index in map order of the segment that is nearest to a point, the first one on ties.
    pub(super) fn nearest(&mut self, point: [f32; 3]) -> Option<usize> {
        if self.stored > MAX_STORED {
            (self.stored, self.recent) = (0, None);
            self.indices.clear();
            self.cells.clear();
        }
        let lowest = key(WIDTHS.len() - 1, point);
        let cell = match self.recent {
            Some((recent, cell)) if recent == lowest => cell,
            _ => match self.indices.get(&lowest).copied() {
                Some(cell) => {
                    self.recent = Some((lowest, cell));
                    cell
                }
                None => self.divided_cell(point),
            },
        };
        self.cells[cell].segments.nearest(point, &mut self.scratch)
    }

    /// Returns the lowest cell that contains a point, after the division of cells that were queried often.
    fn divided_cell(&mut self, point: [f32; 3]) -> usize {
        let mut cell = self.cell(0, None, point);
        for level in 1..WIDTHS.len() {
            self.cells[cell].queries += 1;
            if self.cells[cell].queries <= QUERIES_BEFORE_DIVISION {
                break;
            }
            cell = self.cell(level, Some(cell), point);
        }
        cell
    }

    /// Returns the cell of a level that contains a point, and fills it from the cell above if it is new.
    fn cell(&mut self, level: usize, above: Option<usize>, point: [f32; 3]) -> usize {
        let key = key(level, point);
        if let Some(cell) = self.indices.get(&key) {
            return *cell;
        }
        let above = above.map_or(self.all, |above| &self.cells[above].segments);
        let segments = above.within(&cell_box(key), &mut self.scratch);
        self.stored += segments.len();
        self.cells.push(Cell { segments, queries: 0 });
        self.indices.insert(key, self.cells.len() - 1);
        self.cells.len() - 1
    }
}

fn key(level: usize, point: [f32; 3]) -> Key {
    let width = WIDTHS[level];
    let index = |value: f32, width: f64| (f64::from(value) / width).floor() as i32;
    let height = width * HEIGHT_PER_WIDTH;
    (level as u8, [index(point[0], width), index(point[1], width), index(point[2], height)])
}

fn cell_box((level, position): Key) -> CellBox {
    let width = WIDTHS[usize::from(level)];
    let center = |index: i32| ((f64::from(index) + 0.5) * width) as f32;
    let height = |index: f64| (index * width * HEIGHT_PER_WIDTH) as f32;
    let bottom = f64::from(position[2]);
    CellBox {
        center: [center(position[0]), center(position[1])],
        width: width as f32,
        heights: [height(bottom), height(bottom + 1.0)],
    }
}
