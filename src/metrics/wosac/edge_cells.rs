//! A pyramid of cells that finds the road-edge segments which can be nearest to a point.
//!
//! A cell has the segments that can be nearest to any point in it; they are among those of the cell above.
//! Cells are filled when a point first needs them: rollouts of one scenario visit the same few cells again
//! and again.

use std::collections::HashMap;

use super::road_edges::{HEIGHT_STRETCH, RoadEdges, Segment};

/// Widths of the cells of every level in metres. They are powers of two, so that cells nest exactly.
const WIDTHS: [f64; 6] = [1024.0, 256.0, 64.0, 16.0, 4.0, 1.0];
/// Heights of the cells relative to their width.
const HEIGHT_PER_WIDTH: f64 = 0.25;
/// Bounds are widened by this much, in metres, since distances are compared in single precision.
const BOUND_SLACK: f64 = 1e-4;
/// Bounds are also widened by this share of the distance and of the length of the segment.
const RELATIVE_SLACK: f64 = 1e-6;
/// Maximum number of stored candidates; beyond it all cells are emptied. Only rollouts that leave the map get
/// there.
const MAX_STORED: usize = 1 << 24;

/// Cells filled so far.
#[derive(Default)]
pub(super) struct EdgeCells {
    cells: HashMap<Key, Stored>,
    /// Candidates of all cells, one after another.
    candidates: Vec<u32>,
    /// The cell of the most recent query.
    recent: Option<(Key, Stored)>,
}

/// Level and position of a cell.
type Key = (u8, [i32; 3]);

/// Range of the candidates of a cell.
#[derive(Clone, Copy)]
struct Stored {
    start: u32,
    end: u32,
}

impl EdgeCells {
    /// Returns the segments that can be nearest to a point, in map order.
    pub(super) fn candidates(
        &mut self,
        edges: &RoadEdges,
        point: [f32; 3],
    ) -> impl Iterator<Item = usize> + use<'_> {
        if self.candidates.len() > MAX_STORED {
            *self = Self::default();
        }
        let key = key(WIDTHS.len() - 1, point);
        let stored = match self.recent {
            Some((recent, stored)) if recent == key => stored,
            _ => self.cell(edges, WIDTHS.len() - 1, point),
        };
        self.recent = Some((key, stored));
        self.candidates[stored.start as usize..stored.end as usize].iter().map(|&i| i as usize)
    }

    /// Returns the cell of a level that contains a point, and fills it if it is new.
    fn cell(&mut self, edges: &RoadEdges, level: usize, point: [f32; 3]) -> Stored {
        let key = key(level, point);
        if let Some(stored) = self.cells.get(&key) {
            return *stored;
        }
        let above = level.checked_sub(1).map(|level| self.cell(edges, level, point));
        let bounds = CellBounds::of(key);
        let start = self.candidates.len();
        // The lower bounds of the candidates, and the smallest upper bound.
        let mut lower = Vec::new();
        let mut nearest = f64::INFINITY;
        let count = above.map_or(edges.segments.len(), |above| (above.end - above.start) as usize);
        for n in 0..count {
            let i = above.map_or(n as u32, |above| self.candidates[above.start as usize + n]);
            let (least, most) = bounds.distances(&edges.segments[i as usize]);
            if least <= nearest {
                nearest = nearest.min(most);
                self.candidates.push(i);
                lower.push(least);
            }
        }
        let mut kept = start;
        for (n, least) in lower.into_iter().enumerate() {
            if least <= nearest {
                self.candidates[kept] = self.candidates[start + n];
                kept += 1;
            }
        }
        self.candidates.truncate(kept);
        let stored = Stored { start: start as u32, end: kept as u32 };
        self.cells.insert(key, stored);
        stored
    }
}

fn key(level: usize, point: [f32; 3]) -> Key {
    let width = WIDTHS[level];
    let index = |value: f32, width: f64| (f64::from(value) / width).floor() as i32;
    let height = width * HEIGHT_PER_WIDTH;
    (level as u8, [index(point[0], width), index(point[1], width), index(point[2], height)])
}

/// The extent of a cell.
struct CellBounds {
    center: [f64; 2],
    /// Half the diagonal in the plane, metres.
    reach: f64,
    bottom: f64,
    top: f64,
}

impl CellBounds {
    fn of((level, position): Key) -> Self {
        let width = WIDTHS[usize::from(level)];
        let height = width * HEIGHT_PER_WIDTH;
        let center = |index: i32| (f64::from(index) + 0.5) * width;
        Self {
            center: [center(position[0]), center(position[1])],
            reach: width * std::f64::consts::FRAC_1_SQRT_2,
            bottom: f64::from(position[2]) * height,
            top: (f64::from(position[2]) + 1.0) * height,
        }
    }

    /// Returns bounds of the stretched distances of all points in the cell to a segment, metres. The distance
    /// in the plane changes by at most the distance of two points; heights are bounded by their ranges.
    fn distances(&self, segment: &Segment) -> (f64, f64) {
        let ([x, y, z], [dx, dy, dz]) = (segment.start.map(f64::from), segment.edge.map(f64::from));
        let (px, py) = (self.center[0] - x, self.center[1] - y);
        let length_squared = dx * dx + dy * dy;
        let t =
            if length_squared > 0.0 { ((px * dx + py * dy) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
        let (mx, my) = (px - t * dx, py - t * dy);
        let planar = (mx * mx + my * my).sqrt();
        let (low, high) = (z.min(z + dz), z.max(z + dz));
        let gap = (low - self.top).max(self.bottom - high).max(0.0);
        let span = (self.top - low).abs().max((high - self.bottom).abs());
        let stretched = |planar: f64, height: f64| {
            let height = f64::from(HEIGHT_STRETCH) * height;
            (planar * planar + height * height).sqrt()
        };
        let (least, most) =
            (stretched((planar - self.reach).max(0.0), gap), stretched(planar + self.reach, span));
        let slack = BOUND_SLACK + RELATIVE_SLACK * (most + (length_squared + dz * dz).sqrt());
        (least - slack, most + slack)
    }
}
