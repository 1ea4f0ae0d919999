//! The road as the policy observes it: straight pieces of lanes, lines and edges, in cells of 5 m.

use reactsim_geometry::{Bounds, Grid, Vec2};
use reactsim_nn::perception::edge_rings;
use reactsim_scene::RoadMap;

use super::network::ROAD;

/// Number of rows for pieces of the road.
pub(super) const ROWS: usize = 200;
/// Side of a cell, metres.
const CELL: f64 = 5.0;
/// Number of observed cells on each side of the vehicle's own cell.
const SIDE: i32 = 10;
/// Area in m² of the triangle of a corner and its neighbours below which the corner is dropped.
const MIN_CORNER_AREA: f64 = 0.1;
/// Length in metres above which pieces are cut: exactly straight lines would lose all their corners.
const MAX_PIECE_LENGTH: f64 = 20.0;
/// Half width of every piece, in the units of its row.
const HALF_WIDTH: f32 = 0.001;
/// First entry of the one-hot type.
const FIRST_TYPE: usize = 6;

/// Type of lane pieces.
const LANE: usize = 0;
/// Type of painted lines.
const LINE: usize = 1;
/// Type of road edges.
const EDGE: usize = 2;

/// A straight piece of the road.
#[derive(Clone, Copy, Debug)]
struct Piece {
    middle: Vec2,
    /// Unit vector along the piece.
    direction: Vec2,
    /// Half length, metres.
    half: f64,
    /// Type: [`LANE`], [`LINE`] or [`EDGE`].
    kind: usize,
}

/// The pieces of a map.
#[derive(Debug)]
pub(super) struct RoadPieces {
    pieces: Vec<Piece>,
    grid: Grid,
    /// Offsets from the vehicle's own cell to the others, nearest ring first, metres.
    around: Vec<Vec2>,
}

impl RoadPieces {
    pub(super) fn of(map: &RoadMap) -> Self {
        let mut pieces = Vec::new();
        for lane in &map.lanes {
            cut(lane.baseline.points(), LANE, &mut pieces);
        }
        for line in &map.road_lines {
            cut(&line.points, LINE, &mut pieces);
        }
        for edge in &map.road_edges {
            cut(&edge.points, EDGE, &mut pieces);
        }
        // Maps without edges have drivable areas.
        if map.road_edges.is_empty() {
            for (ring, _) in edge_rings(map) {
                cut(&ring, EDGE, &mut pieces);
            }
        }
        let bounds: Vec<Bounds> = pieces.iter().map(|p| Bounds::around(p.middle, 0.0)).collect();
        let mut around: Vec<(i32, i32)> =
            (-SIDE..=SIDE).flat_map(|i| (-SIDE..=SIDE).map(move |j| (i, j))).collect();
        around.sort_by_key(|(i, j)| (i.abs().max(j.abs()), *i, *j));
        let offset = |(i, j): (i32, i32)| Vec2::new(f64::from(i), f64::from(j)) * CELL;
        Self { grid: Grid::new(&bounds, CELL), pieces, around: around.into_iter().map(offset).collect() }
    }

    /// Fills [`ROWS`] rows of [`ROAD`] numbers with the pieces around a vehicle. The rows must be zero
    /// before; unused ones get the first type.
    pub(super) fn fill(&self, position: Vec2, ahead: Vec2, rows: &mut [f32]) {
        let found = self.around.iter().flat_map(|offset| self.grid.at(position + offset)).take(ROWS);
        let mut used = 0;
        for (row, &index) in rows.chunks_exact_mut(ROAD).zip(found) {
            let piece = self.pieces[index as usize];
            let to = piece.middle - position;
            row[0] = (ahead.dot(&to) * 0.02) as f32;
            row[1] = (ahead.perp(&to) * 0.02) as f32;
            row[2] = (piece.half / 100.0) as f32;
            row[3] = HALF_WIDTH;
            row[4] = ahead.dot(&piece.direction) as f32;
            row[5] = ahead.perp(&piece.direction) as f32;
            row[FIRST_TYPE + piece.kind] = 1.0;
            used += 1;
        }
        for row in rows.chunks_exact_mut(ROAD).skip(used) {
            row[FIRST_TYPE] = 1.0;
        }
    }
}

/// Cuts a line into straight pieces.
fn cut(points: &[Vec2], kind: usize, pieces: &mut Vec<Piece>) {
    let Some((&first, rest)) = points.split_first() else { return };
    let mut from = first;
    for (i, &to) in rest.iter().enumerate() {
        if let Some(&next) = rest.get(i + 1)
            && 0.5 * (to - from).perp(&(next - from)).abs() < MIN_CORNER_AREA
            && (next - from).norm() < MAX_PIECE_LENGTH
        {
            continue;
        }
        let chord = to - from;
        let length = chord.norm();
        if length > 0.0 {
            let count = (length / MAX_PIECE_LENGTH).ceil().max(1.0);
            let part = chord / count;
            for k in 0..count as usize {
                let middle = from + part * (k as f64 + 0.5);
                pieces.push(Piece { middle, direction: chord / length, half: 0.5 * length / count, kind });
            }
        }
        from = to;
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::{Polygon, left};

    use super::*;

    #[test]
    fn lines_become_few_straight_pieces() {
        let mut pieces = Vec::new();
        let line: Vec<Vec2> = (0..=100).map(|i| Vec2::new(0.5 * f64::from(i), 0.0)).collect();
        cut(&line, LANE, &mut pieces);
        assert!(pieces.len() == 3, "{pieces:?}");
        assert!((2.0 * pieces.iter().map(|p| p.half).sum::<f64>() - 50.0).abs() < 1e-9);
        pieces.clear();
        cut(&[Vec2::zeros(), Vec2::new(10.0, 0.0), Vec2::new(10.0, 5.0)], EDGE, &mut pieces);
        assert_eq!(
            pieces.iter().map(|p| p.middle).collect::<Vec<_>>(),
            [Vec2::new(5.0, 0.0), Vec2::new(10.0, 2.5)]
        );
    }

    #[test]
    fn drivable_areas_have_edges_around_all_of_them_only() {
        // Two surfaces of one road that overlap, both drawn clockwise.
        let surface = |from: f64, to: f64| Polygon {
            exterior: vec![
                Vec2::new(from, 0.0),
                Vec2::new(from, 8.0),
                Vec2::new(to, 8.0),
                Vec2::new(to, 0.0),
            ],
            holes: Vec::new(),
        };
        let area = Some(vec![surface(0.0, 30.0), surface(20.0, 50.0)]);
        let pieces = RoadPieces::of(&RoadMap { drivable_area: area, ..RoadMap::default() }).pieces;
        assert!(!pieces.is_empty());
        for piece in &pieces {
            let inward = piece.middle + left(piece.direction);
            assert!(
                piece.kind == EDGE && (0.0..=8.0).contains(&inward.y) && (0.0..=50.0).contains(&inward.x)
            );
            let across = piece.direction.y.abs() > 0.5;
            assert!(!across || piece.middle.x == 0.0 || piece.middle.x == 50.0, "a wall at {}", piece.middle);
        }
        let length: f64 = pieces.iter().map(|p| 2.0 * p.half).sum();
        assert!((length - 116.0).abs() < 1e-9, "{length}");
    }
}
