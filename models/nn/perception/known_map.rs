//! The known part of a map, from which places are built.

use reactsim_geometry::{Vec2, direction};
use reactsim_scene::{RoadMap, Start, StopKind};

use super::map_pieces::{MapPiece, PIECE_LENGTH, PieceKind, map_pieces_of_length};

/// The known part of a map, from which places are built.
#[derive(Clone, Debug)]
pub struct KnownMap {
    /// Pieces of lines, without stop lines, which are [`Stop`]s.
    pub pieces: Vec<MapPiece>,
    /// Stops.
    pub stops: Vec<Stop>,
    /// Lane that each light controls.
    pub light_lanes: Vec<usize>,
    /// Successors of each lane.
    pub successors: Vec<Vec<usize>>,
}

impl KnownMap {
    /// Returns the map of a scenario within `radius` metres of the AV's position at the current frame.
    pub fn of(start: &Start, radius: f64) -> Self {
        Self::with_pieces(start, radius, PIECE_LENGTH)
    }

    /// The same in pieces of this length, metres.
    pub fn with_pieces(start: &Start, radius: f64, length: f64) -> Self {
        let mut pieces = map_pieces_of_length(&start.map, start.now(0).position(), radius, length);
        let is_stop = |k| matches!(k, PieceKind::LightLine | PieceKind::SignLine | PieceKind::YieldLine);
        pieces.retain(|p| !is_stop(p.kind));
        Self {
            pieces,
            stops: Stop::all(start, radius),
            light_lanes: start.lights.iter().map(|l| l.lane).collect(),
            successors: start.map.lanes.iter().map(|l| l.successors.clone()).collect(),
        }
    }
}

/// A position at which vehicles stop.
#[derive(Clone, Copy, Debug)]
pub struct Stop {
    /// Position, metres.
    pub at: Vec2,
    /// Unit vector of its lane's direction there.
    pub ahead: Vec2,
    /// Light that controls the stop.
    pub light: Option<usize>,
    /// 0 for lights, 1 for stop signs, 2 for give-way lines.
    pub kind: usize,
}

impl Stop {
    /// Returns the stops of a scenario within `radius` metres of the AV's position at the current frame:
    /// lights, then stop signs and give-way lines.
    fn all(start: &Start, radius: f64) -> Vec<Self> {
        let map: &RoadMap = &start.map;
        let ahead = |lane: usize, p: Vec2| {
            let line = &map.lanes[lane].baseline;
            direction(line.heading_at(line.project(p).s))
        };
        let mut found = Vec::new();
        for (i, light) in start.lights.iter().enumerate() {
            let at = light.stop_point;
            found.push(Self { at, ahead: ahead(light.lane, at), light: Some(i), kind: 0 });
        }
        for line in &map.stop_lines {
            let kind = match line.kind {
                // Already added above, with the index of its light.
                StopKind::Light => continue,
                StopKind::Sign => 1,
                StopKind::Yield => 2,
            };
            let at = map.lanes[line.lane].baseline.at(line.s);
            found.push(Self { at, ahead: ahead(line.lane, at), light: None, kind });
        }
        let center = start.now(0).position();
        found.retain(|s| (s.at - center).norm() < radius);
        found
    }
}
