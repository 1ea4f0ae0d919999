//! The ground: lanes and road edges with their heights, and how it joins places.

use reactsim_geometry::{Bounds, Grid, Vec2, point_segment};

use super::{LEVEL_GAP, MAX_SLOPE, apart};
use crate::{Road, RoadMap};

/// Distance in metres up to which lanes and edges give the height of the ground at a point.
pub(super) const GROUND_DISTANCE: f64 = 10.0;
/// Size of the cells of the index, metres: a few segments of each line.
const CELL_SIZE: f64 = 3.0;
/// Shortest part of a line, metres, whose slope counts: recorded heights are noisy from point to point.
const SLOPE_LENGTH: f64 = 10.0;
/// Maximum number of levels at one point.
const MAX_LEVELS: usize = 20;
/// Distance in metres between the points at which the ground between two places is looked up.
const FOLLOW_STEP: f64 = 4.0;
/// Largest distance in metres along which the ground is followed: agents do not perceive others farther away.
const FOLLOW_DISTANCE: f64 = 400.0;

/// Segments of lanes and edges with known heights, and their spatial index. Empty if the map has one level.
#[derive(Clone, Debug)]
pub(crate) struct Ground {
    segments: Vec<Segment>,
    grid: Grid,
    /// Largest slope of the ground, metres per metre.
    steepest: f64,
}

/// A segment of a lane or an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    /// Number of the line, as in [`lines`].
    pub(super) line: u32,
    pub(super) ends: [Vec2; 2],
    heights: [f64; 2],
}

impl Segment {
    /// Returns the squared distance to a point, m², and the height at the point of the segment nearest to it.
    pub(super) fn at(&self, p: Vec2) -> (f64, f64) {
        let ([a, b], [low, high]) = (self.ends, self.heights);
        let (distance2, t) = point_segment(p, a, b);
        (distance2, low + (high - low) * t)
    }
}

/// Returns the lines of the ground with their heights: lanes, then edges. Lines without heights are left out.
pub(super) fn lines(map: &RoadMap) -> impl Iterator<Item = (&[Vec2], &[f64])> {
    let lanes = map.lanes.iter().map(|l| l.baseline.points()).zip(&map.heights.lanes);
    let edges = map.road_edges.iter().map(|e| e.points.as_slice()).zip(&map.heights.road_edges);
    let known = |(points, heights): &(&[Vec2], &[f64])| points.len() == heights.len();
    lanes.chain(edges).map(|(points, heights)| (points, heights.as_slice())).filter(known)
}

impl Ground {
    pub(crate) fn new(map: &RoadMap) -> Self {
        let mut segments = Vec::new();
        let mut steepest = 0.0_f64;
        for (line, (points, heights)) in lines(map).enumerate() {
            let (mut from, mut length) = (0, 0.0);
            for i in 1..points.len() {
                let ends = [points[i - 1], points[i]];
                segments.push(Segment { line: line as u32, ends, heights: [heights[i - 1], heights[i]] });
                length += (ends[1] - ends[0]).norm();
                if length >= SLOPE_LENGTH {
                    steepest = steepest.max((heights[i] - heights[from]).abs() / length);
                    (from, length) = (i, 0.0);
                }
            }
        }
        let bounds: Vec<Bounds> = segments.iter().map(|s| Bounds::of(s.ends)).collect();
        Self { grid: Grid::new(&bounds, CELL_SIZE), segments, steepest }
    }

    /// Returns the height at the point nearest to `p` of the segments within 10 m for which `keep` is true,
    /// metres. It receives the segment and its height there.
    pub(super) fn find(&self, p: Vec2, keep: impl Fn(&Segment, f64) -> bool) -> Option<f64> {
        let distance2 = |i: u32| {
            let segment = &self.segments[i as usize];
            let (distance2, height) = segment.at(p);
            if keep(segment, height) { distance2 } else { f64::INFINITY }
        };
        let found = self.grid.nearest_within(p, GROUND_DISTANCE, distance2)?;
        Some(self.segments[found as usize].at(p).1)
    }

    /// Returns the height of the ground nearest to a point, within 10 m, on the level of the height `last`,
    /// metres; `last` without any.
    pub(super) fn nearest(&self, p: Vec2, last: f64) -> f64 {
        self.find(p, |_, height| !apart(height, last, 0.0)).unwrap_or(last)
    }

    /// Returns the height of the ground nearest to a point, within 10 m, on each level there, metres.
    pub(super) fn levels_at(&self, p: Vec2) -> Vec<f64> {
        let mut levels: Vec<f64> = Vec::new();
        let next = |levels: &[f64]| self.find(p, |_, z| levels.iter().all(|level| apart(z, *level, 0.0)));
        while let Some(level) = next(&levels).filter(|_| levels.len() < MAX_LEVELS) {
            levels.push(level);
        }
        levels
    }

    /// Returns the height of the ground at a point, metres, as [`Road::ground_height`].
    pub(super) fn height(&self, p: Vec2, last: f64) -> f64 {
        if !last.is_nan() {
            return self.nearest(p, last);
        }
        match self.levels_at(p)[..] {
            [height] => height,
            _ => f64::NAN,
        }
    }

    /// Returns whether the ground leads in a straight line from one point with its height to another, so that
    /// both are on one level: the height at the end differs by less than two levels at `tolerance` metres.
    fn leads(&self, from: (Vec2, f64), to: (Vec2, f64), tolerance: f64) -> bool {
        let way = to.0 - from.0;
        let distance = way.norm();
        let within_reach = LEVEL_GAP + MAX_SLOPE * tolerance + self.steepest * distance;
        if (to.1 - from.1).abs() > within_reach || distance > FOLLOW_DISTANCE {
            return false;
        }
        let steps = (distance / FOLLOW_STEP).ceil().max(1.0);
        let along = (1..=steps as u32).map(|k| from.0 + way * (f64::from(k) / steps));
        !apart(along.fold(from.1, |height, p| self.nearest(p, height)), to.1, tolerance)
    }
}

impl Road<'_> {
    /// Returns the height of the road at a point, metres: of the nearest lane or edge within 10 m that is on
    /// the level of the height `last`. Without any it is `last`. If `last` is NaN, the road must have one
    /// level there; else the result is NaN.
    pub fn ground_height(&self, p: Vec2, last: f64) -> f64 {
        if self.map.heights.is_empty() { last } else { self.ground().height(p, last) }
    }

    /// Returns whether two things, each a point with its height in metres, are on different levels: their
    /// heights differ by more than two heights on one level ([`apart`]), and the ground between them does not
    /// lead from each to the other, as it does on a steep hill. A NaN (unknown) height is on every level.
    #[inline]
    pub fn is_apart(&self, a: (Vec2, f64), b: (Vec2, f64)) -> bool {
        // Nearly all scenarios have one level, and no heights.
        !(a.1.is_nan() || b.1.is_nan())
            && apart(a.1, b.1, (a.0 - b.0).norm())
            && !(self.ground().leads(a, b, 0.0) && self.ground().leads(b, a, 0.0))
    }

    /// Returns whether something at a height, `distance` metres from `p`, is on another level than this road
    /// ([`Road::on_level`]): another level than the ground that leads to `p` from the point of the road's
    /// level.
    pub fn is_off_level(&self, p: Vec2, height: f64, distance: f64) -> bool {
        let (_, own) = self.level;
        !own.is_nan()
            && apart(height, own, distance)
            && !self.ground().leads(self.level, (p, height), distance)
    }
}
