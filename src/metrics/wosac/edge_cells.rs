//! A pyramid of cells that finds the road-edge segments which can be nearest to a point.
//!
//! A cell has the segments that can be nearest to any point in it; they are among those of the cell above.
//! Cells are filled when a point first needs them: rollouts of one scenario visit the same few cells again
//! and again.

use std::collections::HashMap;

use super::edge_segments::{CellBox, EdgeSegments, Scratch};

/// Widths of the cells of every level in metres. They are powers of two, so that cells nest exactly.
const WIDTHS: [f64; 5] = [512.0, 128.0, 32.0, 8.0, 2.0];
/// Heights of the cells relative to their width.
const HEIGHT_PER_WIDTH: f64 = 0.125;
/// Maximum number of stored segments; beyond it all cells are emptied. Only rollouts that leave the map get
/// there.
const MAX_STORED: usize = 1 << 22;

/// Cells filled so far.
pub(super) struct EdgeCells<'a> {
    all: &'a EdgeSegments,
    indices: HashMap<Key, usize>,
    cells: Vec<EdgeSegments>,
    /// Number of segments in all cells.
    stored: usize,
    /// The cell of the most recent query.
    recent: Option<(Key, usize)>,
    scratch: Scratch,
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
        let level = WIDTHS.len() - 1;
        let key = key(level, point);
        let cell = match self.recent {
            Some((recent, cell)) if recent == key => cell,
            _ => self.cell(level, point),
        };
        self.recent = Some((key, cell));
        self.cells[cell].nearest(point, &mut self.scratch)
    }

    /// Returns the cell of a level that contains a point, and fills it if it is new.
    fn cell(&mut self, level: usize, point: [f32; 3]) -> usize {
        let key = key(level, point);
        if let Some(cell) = self.indices.get(&key) {
            return *cell;
        }
        let segments = match level.checked_sub(1) {
            None => self.all.within(&cell_box(key), &mut self.scratch),
            Some(above) => {
                let above = self.cell(above, point);
                self.cells[above].within(&cell_box(key), &mut self.scratch)
            }
        };
        self.stored += segments.len();
        self.cells.push(segments);
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
        reach: (width * std::f64::consts::FRAC_1_SQRT_2) as f32,
        heights: [height(bottom), height(bottom + 1.0)],
    }
}
