//! The road as the policy sees it: straight pieces of lanes, lines and edges, by cells of 5 m.

use reactsim::geometry::{Bounds, Grid, Vec2};
use reactsim::scene::RoadMap;

use super::network::ROAD;
use crate::models::ntp::tokens::edge_rings;

/// Rows for pieces of the road.
pub(super) const ROWS: usize = 200;
/// Side of a cell, metres.
const CELL: f64 = 5.0;
/// Cells that are looked at on each side of the vehicle's own.
const SIDE: i32 = 10;
/// Corners of lines are dropped while the triangle with their neighbours is smaller, m².
const CORNER: f64 = 0.1;
/// Longer pieces are cut, metres: where lines are exactly straight no corner would be left.
const LONGEST: f64 = 20.0;
/// Half of the width that every piece is said to have, in the units of its row.
const WIDTH: f32 = 0.001;
/// First of the entries that tell the type.
const TYPE: usize = 6;

/// Types of pieces, as in the row.
const LANE: usize = 0;
const LINE: usize = 1;
const EDGE: usize = 2;

#[derive(Clone, Copy, Debug)]
struct Piece {
    middle: Vec2,
    direction: Vec2,
    half: f64,
    kind: usize,
}

/// The pieces of a map.
#[derive(Debug)]
pub(super) struct Pieces {
    pieces: Vec<Piece>,
    grid: Grid,
    /// Ways from the own cell to the others, nearest ring first.
    around: Vec<Vec2>,
}

impl Pieces {
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
        // Maps that have no edges have drivable ground.
        if map.road_edges.is_empty() {
            for (ring, _) in edge_rings(map) {
                cut(&ring, EDGE, &mut pieces);
            }
        }
        let bounds: Vec<Bounds> = pieces.iter().map(|p| Bounds::around(p.middle, 0.0)).collect();
        let mut around: Vec<(i32, i32)> =
            (-SIDE..=SIDE).flat_map(|i| (-SIDE..=SIDE).map(move |j| (i, j))).collect();
        around.sort_by_key(|(i, j)| (i.abs().max(j.abs()), *i, *j));
        let way = |(i, j): (i32, i32)| Vec2::new(f64::from(i), f64::from(j)) * CELL;
        Self { grid: Grid::new(&bounds, CELL), pieces, around: around.into_iter().map(way).collect() }
    }

    /// Fills [`ROWS`] rows of [`ROAD`] numbers, which are zero before, with the pieces around a vehicle. Unused rows are of the first type.
    pub(super) fn fill(&self, position: Vec2, ahead: Vec2, rows: &mut [f32]) {
        let found = self.around.iter().flat_map(|way| self.grid.at(position + way)).take(ROWS);
        let mut used = 0;
        for (row, &index) in rows.chunks_exact_mut(ROAD).zip(found) {
            let piece = self.pieces[index as usize];
            let to = piece.middle - position;
            row[0] = (ahead.dot(&to) * 0.02) as f32;
            row[1] = (ahead.perp(&to) * 0.02) as f32;
            row[2] = (piece.half / 100.0) as f32;
            row[3] = WIDTH;
            row[4] = ahead.dot(&piece.direction) as f32;
            row[5] = ahead.perp(&piece.direction) as f32;
            row[TYPE + piece.kind] = 1.0;
            used += 1;
        }
        for row in rows.chunks_exact_mut(ROAD).skip(used) {
            row[TYPE] = 1.0;
        }
    }
}

/// Cuts a line into straight pieces.
fn cut(points: &[Vec2], kind: usize, pieces: &mut Vec<Piece>) {
    let Some((&first, rest)) = points.split_first() else { return };
    let mut from = first;
    for (i, &to) in rest.iter().enumerate() {
        if let Some(&next) = rest.get(i + 1)
            && 0.5 * (to - from).perp(&(next - from)).abs() < CORNER
            && (next - from).norm() < LONGEST
        {
            continue;
        }
        let way = to - from;
        let length = way.norm();
        if length > 0.0 {
            let count = (length / LONGEST).ceil().max(1.0);
            let part = way / count;
            for k in 0..count as usize {
                let middle = from + part * (k as f64 + 0.5);
                pieces.push(Piece { middle, direction: way / length, half: 0.5 * length / count, kind });
            }
        }
        from = to;
    }
}

#[cfg(test)]
mod tests {
    use reactsim::geometry::{Polygon, left};

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
        let pieces = Pieces::of(&RoadMap { drivable_area: area, ..RoadMap::default() }).pieces;
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
