//! Signed distance of evaluated objects to the nearest road edge. The nearest segment is found in three
//! dimensions, with stretched heights, so that roads on bridges do not interfere; the distance to it is that
//! in the plane.
//!
//! Everything is in single precision, operation by operation as in the official code: of two segments that
//! are equally far up to rounding, the choice changes the result by up to a millimetre.

use reactsim_scene::FUTURE;

use super::edge_cells::EdgeCells;
use super::edge_segments::EdgeSegments;
use super::footprint::corners;
use super::objects::Motion;

/// Distance in metres where an object is invalid.
pub(super) const INVALID_DISTANCE: f32 = -1e10;
/// Distance in metres below which the ends of a polyline make it a closed one.
const CLOSED_DISTANCE: f32 = 1.0;

/// The segments of all road edges, in map order.
pub(super) struct RoadEdges {
    segments: Vec<Segment>,
    /// The same segments as arrays.
    pub(super) arrays: EdgeSegments,
}

#[derive(Clone, Copy, Debug)]
struct Segment {
    /// Start in the plane, metres.
    start: [f32; 2],
    /// Vector from start to end in the plane, metres.
    edge: [f32; 2],
    /// Index of the segment that ends where this one starts, if any.
    previous: Option<usize>,
    /// Index of the segment that starts where this one ends, if any.
    next: Option<usize>,
}

impl Segment {
    /// Returns 1 if a point is on the right (off the road), -1 if it is on the left, 0 if it is on the line.
    fn side(&self, point: [f32; 2]) -> f32 {
        let d = [point[0] - self.start[0], point[1] - self.start[1]];
        let right = d[0] * self.edge[1] - d[1] * self.edge[0];
        if right > 0.0 {
            1.0
        } else if right < 0.0 {
            -1.0
        } else {
            0.0
        }
    }

    /// Returns the position of a point along the segment: 0 at its start, 1 at its end; 0 without a length.
    fn along(&self, point: [f32; 2]) -> f32 {
        let d = [point[0] - self.start[0], point[1] - self.start[1]];
        let length_squared = self.edge[0] * self.edge[0] + self.edge[1] * self.edge[1];
        let along = d[0] * self.edge[0] + d[1] * self.edge[1];
        if length_squared > 0.0 { along / length_squared } else { 0.0 }
    }

    fn turns_left_into(&self, next: &Self) -> bool {
        self.edge[0] * next.edge[1] - self.edge[1] * next.edge[0] > 0.0
    }
}

impl RoadEdges {
    /// Prepares the road edges with at least two points. The ring of a closed one is recognised only if no
    /// other road edge has more points, as in the official code.
    pub(super) fn new(lines: &[Vec<[f32; 3]>]) -> Self {
        let most_points = lines.iter().map(Vec::len).max().unwrap_or(0);
        let (mut segments, mut vectors) = (Vec::new(), Vec::new());
        for line in lines.iter().filter(|line| line.len() >= 2) {
            let (first, count) = (segments.len(), line.len() - 1);
            let gap = difference(line[count], line[0]);
            let gap_squared = gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2];
            let is_ring = line.len() == most_points && gap_squared < CLOSED_DISTANCE * CLOSED_DISTANCE;
            for (i, ends) in line.windows(2).enumerate() {
                let edge = difference(ends[1], ends[0]);
                vectors.push([ends[0], edge]);
                let cyclic = |neighbor: Option<usize>, around: usize| {
                    neighbor.or(is_ring.then_some(around)).map(|neighbor| first + neighbor)
                };
                segments.push(Segment {
                    start: [ends[0][0], ends[0][1]],
                    edge: [edge[0], edge[1]],
                    previous: cyclic(i.checked_sub(1), count - 1),
                    next: cyclic(Some(i + 1).filter(|&next| next < count), 0),
                });
            }
        }
        Self { segments, arrays: EdgeSegments::new(&vectors) }
    }

    /// Returns the signed distance of a point to the segment that is the nearest one, in metres.
    fn signed_distance(&self, point: [f32; 2], nearest: usize) -> f32 {
        let segment = &self.segments[nearest];
        let (side, t) = (segment.side(point), segment.along(point));
        let joint = if t < 0.0 {
            segment.previous.map(|i| (&self.segments[i], self.segments[i].turns_left_into(segment)))
        } else if t > 1.0 {
            segment.next.map(|i| (&self.segments[i], segment.turns_left_into(&self.segments[i])))
        } else {
            None
        };
        let side = match joint {
            Some((neighbor, true)) => side.max(neighbor.side(point)),
            Some((neighbor, false)) => side.min(neighbor.side(point)),
            None => side,
        };
        let t = t.clamp(0.0, 1.0);
        let mx = point[0] - segment.start[0] - t * segment.edge[0];
        let my = point[1] - segment.start[1] - t * segment.edge[1];
        side * (mx * mx + my * my).sqrt()
    }
}

fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Computes the signed distances of an evaluated object at the steps 1 to 80, in metres: the largest one of
/// its four bottom corners, positive off the road.
pub(super) fn distances(
    motion: &Motion,
    edges: &RoadEdges,
    cells: &mut EdgeCells,
    object: usize,
) -> [f32; FUTURE] {
    distances_by(motion, edges, object, |point| cells.nearest(point))
}

/// Returns the signed distances as [`distances`] does, comparing all segments.
#[cfg(test)]
pub(super) fn distances_to_all(motion: &Motion, edges: &RoadEdges, object: usize) -> [f32; FUTURE] {
    let mut scratch = super::edge_segments::Scratch::default();
    distances_by(motion, edges, object, |point| edges.arrays.nearest(point, &mut scratch))
}

fn distances_by(
    motion: &Motion,
    edges: &RoadEdges,
    object: usize,
    mut nearest: impl FnMut([f32; 3]) -> Option<usize>,
) -> [f32; FUTURE] {
    let (track, future) = (motion.tracks[object], &motion.futures[object]);
    let mut distances = [INVALID_DISTANCE; FUTURE];
    for (k, distance) in distances.iter_mut().enumerate() {
        if !motion.is_valid(object, k) {
            continue;
        }
        let bottom = future.z[k] - track.height / 2.0;
        let corners = corners([future.x[k], future.y[k]], future.heading[k], track.length, track.width);
        for [x, y] in corners {
            if let Some(nearest) = nearest([x, y, bottom]) {
                *distance = distance.max(edges.signed_distance([x, y], nearest));
            }
        }
    }
    distances
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(lines: &[&[[f32; 3]]], point: [f32; 3]) -> f32 {
        let edges = RoadEdges::new(&lines.iter().map(|line| line.to_vec()).collect::<Vec<_>>());
        let nearest = edges.arrays.nearest(point, &mut Default::default()).unwrap();
        edges.signed_distance([point[0], point[1]], nearest)
    }

    #[test]
    fn the_left_side_is_the_road() {
        let line: &[[f32; 3]] = &[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]];
        assert_eq!(distance(&[line], [5.0, 2.0, 7.0]), -2.0);
        assert_eq!(distance(&[line], [5.0, -2.0, 7.0]), 2.0);
        assert_eq!(distance(&[line], [13.0, -4.0, 0.0]), 5.0);
        assert_eq!(distance(&[line], [13.0, 0.0, 0.0]), 0.0, "on the extended line");
    }

    #[test]
    fn corners_combine_the_sides_of_both_segments() {
        // The point is left of the first segment and right of the second.
        let right_turn: &[[f32; 3]] = &[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, -10.0, 0.0]];
        assert!(distance(&[right_turn], [11.0, 1.0, 0.0]) < 0.0);
        let left_turn: &[[f32; 3]] = &[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0]];
        assert!(distance(&[left_turn], [11.0, -1.0, 0.0]) > 0.0);
    }

    #[test]
    fn heights_decide_between_edges() {
        let ground: &[[f32; 3]] = &[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]];
        let bridge: &[[f32; 3]] = &[[0.0, -4.0, 5.0], [10.0, -4.0, 5.0]];
        assert_eq!(distance(&[ground, bridge], [5.0, -3.0, 5.0]), -1.0);
        assert_eq!(distance(&[ground, bridge], [5.0, -3.0, 0.0]), 3.0);
    }

    #[test]
    fn rings_are_recognised_only_as_the_longest_road_edge() {
        // Without the ring, the side next to its start is that of the first segment alone.
        let ring: &[[f32; 3]] =
            &[[0.0, 0.0, 0.0], [9.0, 1.0, 0.0], [9.0, 9.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, 0.0]];
        let longer: Vec<[f32; 3]> = (0..6).map(|i| [i as f32, 900.0, 0.0]).collect();
        // Behind the start and left of the first segment, right of the last one.
        let point = [-1.0, 0.0, 0.0];
        assert!(distance(&[ring], point) > 0.0);
        assert!(distance(&[ring, &longer], point) < 0.0);
    }

    #[test]
    fn a_nearest_segment_of_zero_length_has_distance_zero() {
        let line: &[[f32; 3]] = &[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [10.0, 0.0, 0.0]];
        assert_eq!(distance(&[line], [-3.0, 1.0, 0.0]), 0.0);
    }
}
