//! Segments of road edges as arrays, so that distances to many of them are computed at once.

/// Factor by which heights are stretched in the search for the nearest segment.
const HEIGHT_STRETCH: f32 = 3.0;
/// Bounds are widened by this much, in metres, since distances are computed in single precision.
const BOUND_SLACK: f32 = 1e-4;
/// Bounds are also widened by this share of the distance, of the length of the segment and of the
/// coordinates.
const RELATIVE_SLACK: f32 = 1e-6;
/// Differences of squared distances must exceed this, in m², since distances are computed in single
/// precision.
const SQUARED_SLACK: f64 = 1e-3;
/// They must also exceed this share of the squared distances.
const RELATIVE_SQUARED_SLACK: f64 = 1e-5;
/// Positions along a segment that are this close to an end may be beyond it or not.
const END_SLACK: f64 = 1e-3;

/// Number of columns of a list: start and edge in three dimensions, and the squared length in the plane.
const COLUMNS: usize = 7;

/// A list of segments: starts, and vectors from start to end, in metres.
#[derive(Clone, Debug, Default)]
pub(super) struct EdgeSegments {
    /// The columns, one after another.
    columns: Vec<f32>,
    /// Indices of the segments in map order, ascending.
    index: Vec<u32>,
}

/// The box of a cell.
pub(super) struct CellBox {
    /// Centre in the plane, metres.
    pub(super) center: [f32; 2],
    /// Width in the plane, metres.
    pub(super) width: f32,
    /// Lowest and highest height, metres.
    pub(super) heights: [f32; 2],
}

/// Distances or bounds of distances to all segments of a list; kept between uses.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    least: Vec<f32>,
    most: Vec<f32>,
    kept: Vec<usize>,
}

impl EdgeSegments {
    pub(super) fn len(&self) -> usize {
        self.index.len()
    }

    /// Makes a list of starts and of vectors from start to end, in map order.
    pub(super) fn new(segments: &[[[f32; 3]; 2]]) -> Self {
        let mut columns = Vec::with_capacity(COLUMNS * segments.len());
        for vector in 0..2 {
            for axis in 0..3 {
                columns.extend(segments.iter().map(|segment| segment[vector][axis]));
            }
        }
        columns.extend(segments.iter().map(|[_, edge]| edge[0] * edge[0] + edge[1] * edge[1]));
        Self { columns, index: (0..segments.len() as u32).collect() }
    }

    fn column(&self, column: usize) -> &[f32] {
        &self.columns[column * self.len()..(column + 1) * self.len()]
    }

    /// Returns the index in map order of the segment that is nearest to a point, by stretched distance in
    /// single precision; the first one on ties. `None` without segments.
    pub(super) fn nearest(&self, point: [f32; 3], scratch: &mut Scratch) -> Option<usize> {
        let n = self.len();
        scratch.least.resize(n, 0.0);
        let [sx, sy, sz, ex, ey, ez, length_squared] = self.split();
        let squared = &mut scratch.least[..n];
        for i in 0..n {
            let d = [point[0] - sx[i], point[1] - sy[i], point[2] - sz[i]];
            let t = clipped(d[0] * ex[i] + d[1] * ey[i], length_squared[i]);
            let m = [d[0] - t * ex[i], d[1] - t * ey[i], HEIGHT_STRETCH * (d[2] - t * ez[i])];
            squared[i] = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
        }
        let smallest = smallest(squared);
        // Squares that differ can have the same root, which is what the official code compares.
        let (limit, root) = (smallest * (1.0 + RELATIVE_SLACK), smallest.sqrt());
        let first = squared.iter().position(|&value| value <= limit && value.sqrt() <= root)?;
        Some(self.index[first] as usize)
    }

    /// Returns the segments that can be nearest to a point in a box. The distance in the plane changes by at
    /// most the distance of two points; heights are bounded by their ranges.
    pub(super) fn within(&self, cell: &CellBox, scratch: &mut Scratch) -> Self {
        let n = self.len();
        scratch.least.resize(n, 0.0);
        scratch.most.resize(n, 0.0);
        let [sx, sy, sz, ex, ey, ez, length_squared] = self.split();
        let (least, most) = (&mut scratch.least[..n], &mut scratch.most[..n]);
        let [bottom, top] = cell.heights;
        let coordinates = cell.center[0].abs() + cell.center[1].abs() + bottom.abs();
        let slack = BOUND_SLACK + RELATIVE_SLACK * coordinates;
        let reach = cell.width * std::f32::consts::FRAC_1_SQRT_2;
        for i in 0..n {
            let d = [cell.center[0] - sx[i], cell.center[1] - sy[i]];
            let t = clipped(d[0] * ex[i] + d[1] * ey[i], length_squared[i]);
            let m = [d[0] - t * ex[i], d[1] - t * ey[i]];
            let planar = (m[0] * m[0] + m[1] * m[1]).sqrt();
            let (low, high) = (smaller(sz[i], sz[i] + ez[i]), larger(sz[i], sz[i] + ez[i]));
            let gap = HEIGHT_STRETCH * larger(larger(low - top, bottom - high), 0.0);
            let span = HEIGHT_STRETCH * larger(top - low, high - bottom);
            let (near, far) = (larger(planar - reach, 0.0), planar + reach);
            let extent = length_squared[i] + ez[i] * ez[i];
            let slack = slack + RELATIVE_SLACK * (far + extent.sqrt());
            least[i] = (near * near + gap * gap).sqrt() - slack;
            most[i] = (far * far + span * span).sqrt() + slack;
        }
        let nearest = smallest(most);
        let rival =
            most.iter().position(|&value| value <= nearest).map(|i| Rival::new(self.segment(i), cell));
        scratch.kept.clear();
        for (i, &least) in least.iter().enumerate() {
            // A bound that is no number excludes nothing.
            let is_excluded = least > nearest
                || rival.as_ref().is_some_and(|rival: &Rival| rival.dominates(self.segment(i)));
            if !is_excluded {
                scratch.kept.push(i);
            }
        }
        let mut columns = Vec::with_capacity(COLUMNS * scratch.kept.len());
        for column in 0..COLUMNS {
            let values = self.column(column);
            columns.extend(scratch.kept.iter().map(|&i| values[i]));
        }
        Self { columns, index: scratch.kept.iter().map(|&i| self.index[i]).collect() }
    }

    /// Returns start and edge of a segment.
    fn segment(&self, i: usize) -> [[f64; 3]; 2] {
        let value = |column: usize| f64::from(self.columns[column * self.len() + i]);
        [[value(0), value(1), value(2)], [value(3), value(4), value(5)]]
    }

    /// Returns the columns with their lengths known to be equal, so that loops have no checks.
    fn split(&self) -> [&[f32]; COLUMNS] {
        let n = self.len();
        let mut columns: [&[f32]; COLUMNS] = [&[]; COLUMNS];
        for (i, column) in columns.iter_mut().enumerate() {
            *column = &self.column(i)[..n];
        }
        columns
    }
}

/// A segment near a cell, which is nearer to all points of the cell than most other segments of the same road
/// edge.
struct Rival {
    center: [f64; 2],
    width: f64,
    heights: [f64; 2],
    /// Point of the rival that is nearest to the centre, in the plane.
    point: [f64; 2],
    /// Heights of its ends.
    ends: [f64; 2],
}

impl Rival {
    fn new([start, edge]: [[f64; 3]; 2], cell: &CellBox) -> Self {
        let center = cell.center.map(f64::from);
        let t = along([start, edge], center).clamp(0.0, 1.0);
        Self {
            center,
            width: f64::from(cell.width),
            heights: cell.heights.map(f64::from),
            point: [start[0] + t * edge[0], start[1] + t * edge[1]],
            ends: [start[2], start[2] + edge[2]],
        }
    }

    /// Returns whether the rival is nearer to every point of the cell than a segment of which one end is
    /// nearest to all these points. The difference of the squared distances to two points is linear, so that
    /// its minimum is at a corner of the cell; the same holds for heights.
    fn dominates(&self, segment: [[f64; 3]; 2]) -> bool {
        let [start, edge] = segment;
        let length_squared = edge[0] * edge[0] + edge[1] * edge[1];
        let t = along(segment, self.center);
        // The rounding of the position in single precision grows with the distance to the start.
        let away = (self.center[0] - start[0]).abs() + (self.center[1] - start[1]).abs();
        let reach = self.width / 2.0 + f64::from(RELATIVE_SLACK) * away;
        let change = reach * (edge[0].abs() + edge[1].abs()) / length_squared + END_SLACK;
        let end = if t + change < 0.0 {
            start
        } else if t - change > 1.0 {
            [start[0] + edge[0], start[1] + edge[1], start[2] + edge[2]]
        } else {
            return false;
        };
        let squared = |point: [f64; 2]| {
            let d = [self.center[0] - point[0], self.center[1] - point[1]];
            d[0] * d[0] + d[1] * d[1]
        };
        let away = squared([end[0], end[1]]);
        let spread = (end[0] - self.point[0]).abs() + (end[1] - self.point[1]).abs();
        let planar = away - squared(self.point) - self.width * spread;
        let (mut height, mut highest) = (f64::INFINITY, 0.0f64);
        for z in self.heights {
            for rival in self.ends {
                let (theirs, ours) = ((z - end[2]) * (z - end[2]), (z - rival) * (z - rival));
                height = height.min(theirs - ours);
                highest = highest.max(theirs + ours);
            }
        }
        let stretch = f64::from(HEIGHT_STRETCH) * f64::from(HEIGHT_STRETCH);
        let slack = SQUARED_SLACK + RELATIVE_SQUARED_SLACK * (away + stretch * highest);
        planar + stretch * height > slack
    }
}

/// Returns the position of a point along a segment, not clipped; 0 without a length.
fn along([start, edge]: [[f64; 3]; 2], point: [f64; 2]) -> f64 {
    let length_squared = edge[0] * edge[0] + edge[1] * edge[1];
    let along = (point[0] - start[0]) * edge[0] + (point[1] - start[1]) * edge[1];
    if length_squared > 0.0 { along / length_squared } else { 0.0 }
}

/// Returns the position along a segment, 0 to 1, for a projection and the squared length; 0 without a length.
fn clipped(along: f32, length_squared: f32) -> f32 {
    let t = if length_squared > 0.0 { along / length_squared } else { 0.0 };
    smaller(larger(t, 0.0), 1.0)
}

/// Returns the smallest value; values that are no numbers may be passed over.
fn smallest(values: &[f32]) -> f32 {
    let mut lanes = [f32::INFINITY; 8];
    let chunks = values.chunks_exact(lanes.len());
    let rest = chunks.remainder().iter().copied().fold(f32::INFINITY, smaller);
    for chunk in chunks {
        for (lane, &value) in lanes.iter_mut().zip(chunk) {
            *lane = smaller(value, *lane);
        }
    }
    lanes.into_iter().fold(rest, smaller)
}

/// Returns the smaller value, by one comparison.
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the larger value, by one comparison.
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
