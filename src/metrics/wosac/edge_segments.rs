//! Segments of road edges as arrays, so that distances to many of them are computed at once.

/// Factor by which heights are stretched in the search for the nearest segment.
const HEIGHT_STRETCH: f32 = 3.0;
/// Bounds are widened by this much, in metres, since distances are computed in single precision.
const BOUND_SLACK: f32 = 1e-4;
/// Bounds are also widened by this share of the distance, of the length of the segment and of the
/// coordinates.
const RELATIVE_SLACK: f32 = 1e-6;

/// A list of segments: starts, and vectors from start to end, in metres.
#[derive(Clone, Debug, Default)]
pub(super) struct EdgeSegments {
    start: [Vec<f32>; 3],
    edge: [Vec<f32>; 3],
    /// Squared lengths in the plane.
    length_squared: Vec<f32>,
    /// Indices of the segments in map order, ascending.
    index: Vec<u32>,
}

/// The box of a cell.
pub(super) struct CellBox {
    /// Centre in the plane, metres.
    pub(super) center: [f32; 2],
    /// Half the diagonal in the plane, metres.
    pub(super) reach: f32,
    /// Lowest and highest height, metres.
    pub(super) heights: [f32; 2],
}

/// Distances or bounds of distances to all segments of a list; kept between uses.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    least: Vec<f32>,
    most: Vec<f32>,
}

impl EdgeSegments {
    /// Returns the number of segments.
    pub(super) fn len(&self) -> usize {
        self.index.len()
    }

    /// Appends a segment.
    pub(super) fn push(&mut self, start: [f32; 3], edge: [f32; 3], index: u32) {
        for axis in 0..3 {
            self.start[axis].push(start[axis]);
            self.edge[axis].push(edge[axis]);
        }
        self.length_squared.push(edge[0] * edge[0] + edge[1] * edge[1]);
        self.index.push(index);
    }

    /// Returns the index in map order of the segment that is nearest to a point, by stretched distance in
    /// single precision; the first one on ties. `None` without segments.
    pub(super) fn nearest(&self, point: [f32; 3], scratch: &mut Scratch) -> Option<usize> {
        let n = self.len();
        scratch.least.resize(n, 0.0);
        let ([sx, sy, sz], [ex, ey, ez]) = self.columns();
        let (length_squared, squared) = (&self.length_squared[..n], &mut scratch.least[..n]);
        for i in 0..n {
            let d = [point[0] - sx[i], point[1] - sy[i], point[2] - sz[i]];
            let t = clipped(d[0] * ex[i] + d[1] * ey[i], length_squared[i]);
            let m = [d[0] - t * ex[i], d[1] - t * ey[i], HEIGHT_STRETCH * (d[2] - t * ez[i])];
            squared[i] = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
        }
        let smallest = squared.iter().copied().fold(f32::INFINITY, smaller);
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
        let ([sx, sy, sz], [ex, ey, ez]) = self.columns();
        let length_squared = &self.length_squared[..n];
        let (least, most) = (&mut scratch.least[..n], &mut scratch.most[..n]);
        let [bottom, top] = cell.heights;
        let coordinates = cell.center[0].abs() + cell.center[1].abs() + bottom.abs();
        let slack = BOUND_SLACK + RELATIVE_SLACK * coordinates;
        for i in 0..n {
            let d = [cell.center[0] - sx[i], cell.center[1] - sy[i]];
            let t = clipped(d[0] * ex[i] + d[1] * ey[i], length_squared[i]);
            let m = [d[0] - t * ex[i], d[1] - t * ey[i]];
            let planar = (m[0] * m[0] + m[1] * m[1]).sqrt();
            let (low, high) = (smaller(sz[i], sz[i] + ez[i]), larger(sz[i], sz[i] + ez[i]));
            let gap = HEIGHT_STRETCH * larger(larger(low - top, bottom - high), 0.0);
            let span = HEIGHT_STRETCH * larger(top - low, high - bottom);
            let (near, far) = (larger(planar - cell.reach, 0.0), planar + cell.reach);
            let extent = length_squared[i] + ez[i] * ez[i];
            let slack = slack + RELATIVE_SLACK * (far + extent.sqrt());
            least[i] = (near * near + gap * gap).sqrt() - slack;
            most[i] = (far * far + span * span).sqrt() + slack;
        }
        let nearest = most.iter().copied().fold(f32::INFINITY, smaller);
        // A bound that is no number excludes nothing.
        let kept: Vec<usize> = (0..n).filter(|&i| !(least[i] > nearest)).collect();
        let pick = |column: &Vec<f32>| kept.iter().map(|&i| column[i]).collect();
        Self {
            start: self.start.each_ref().map(pick),
            edge: self.edge.each_ref().map(pick),
            length_squared: pick(&self.length_squared),
            index: kept.iter().map(|&i| self.index[i]).collect(),
        }
    }

    /// Returns the columns of starts and edges with their lengths known to be equal, so that loops have no
    /// checks.
    fn columns(&self) -> ([&[f32]; 3], [&[f32]; 3]) {
        let (n, [sx, sy, sz], [ex, ey, ez]) = (self.len(), &self.start, &self.edge);
        ([&sx[..n], &sy[..n], &sz[..n]], [&ex[..n], &ey[..n], &ez[..n]])
    }
}

/// Returns the position along a segment, 0 to 1, for a projection and the squared length; 0 without a length.
fn clipped(along: f32, length_squared: f32) -> f32 {
    let t = if length_squared > 0.0 { along / length_squared } else { 0.0 };
    smaller(larger(t, 0.0), 1.0)
}

/// Returns the smaller value, by one comparison.
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the larger value, by one comparison.
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
