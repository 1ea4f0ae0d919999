//! Places of the map that agents attend to: pieces of lanes, edges and crosswalks, and where to stop.

use reactsim::geometry::{Vec2, direction, into_frame, point_segment};
use reactsim::scene::{LightState, RoadMap, Start, StopKind};

use super::super::tokens::{MapPiece, PieceKind, map_pieces};
use super::body::Body;
use super::config::Config;
use super::lane::LaneGraph;
use super::links::{Links, Nearest, put};
use crate::models::learning::LearningMap;

/// Numbers that describe a place alone.
pub(crate) const PLACE: usize = 20 + KINDS + 4;
/// Numbers that describe how one place stands to another.
pub(crate) const PLACE_PAIR: usize = 7;
/// Numbers that describe how a place stands to an agent.
pub(crate) const TO_PLACE: usize = 27;
/// Kinds of places: those of pieces, and stops at lights, signs and give-way lines.
const KINDS: usize = PieceKind::COUNT + 3;
/// Stops farther ahead than this do not count, metres.
const STOP_REACH: f64 = 70.0;

/// A place of the map.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    /// Where it begins, metres, scenario frame.
    pub start: Vec2,
    /// Unit vector of its first chord; of the lane where it is a stop.
    pub ahead: Vec2,
    /// Its middle.
    pub middle: Vec2,
    /// What it is.
    pub role: Role,
    /// The light that controls its lane.
    pub light: Option<usize>,
    /// Speed limit, m/s, where known.
    pub speed_limit: Option<f64>,
    /// Along the piece; a single point at stops.
    points: Vec<Vec2>,
    /// What describes it alone.
    pub features: [f32; PLACE],
}

/// What agents use a place for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// A piece of a lane's centre line.
    Lane,
    /// A piece of an edge or a crosswalk.
    Border,
    /// Where to stop.
    Stop,
}

/// All places of a map within reach of its AV, and the neighbours of each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    /// Pieces, then stops.
    pub all: Vec<Place>,
    /// To the nearest other places.
    pub links: Links,
    /// Which pieces of lanes follow which.
    pub graph: LaneGraph,
}

impl Places {
    /// The places that are known of a scenario.
    pub(crate) fn known(start: &Start, config: &Config) -> Self {
        Self::of(&KnownMap::of(start, config.map_radius), config)
    }

    /// The places of a map.
    pub(crate) fn of(map: &KnownMap, config: &Config) -> Self {
        let KnownMap { pieces, stops, light_lanes, successors } = map;
        let light_of = |lane: usize| light_lanes.iter().position(|&l| l == lane);
        let mut all: Vec<Place> =
            pieces.iter().map(|p| Place::of_piece(p, p.lane.and_then(light_of))).collect();
        all.extend(stops.iter().map(Place::of_stop));
        let mut links = Links::default();
        let mut nearest = Nearest::new(config.map_neighbours);
        let mut found = Vec::new();
        for (i, place) in all.iter().enumerate() {
            nearest.clear();
            for (j, other) in all.iter().enumerate() {
                if i != j {
                    nearest.offer((other.middle - place.middle).norm_squared(), j);
                }
            }
            found.clear();
            found.extend(nearest.found());
            links.push(config.map_neighbours, PLACE_PAIR, &found, |j, out| place.relate_place(&all[j], out));
        }
        let lanes: Vec<Option<usize>> = pieces.iter().map(|p| p.lane.filter(|_| p.kind.is_lane())).collect();
        let aheads: Vec<Vec2> = all.iter().map(|p| p.end_ahead()).collect();
        let graph = LaneGraph::of(&lanes, &aheads, successors);
        Self { all, links, graph }
    }

    /// The places that are used, and those that their encoding depends on (`hops` layers away); per old index the new one.
    pub(crate) fn reduced(&self, used: impl IntoIterator<Item = usize>, hops: usize) -> (Self, Vec<u32>) {
        let n = self.all.len();
        let k = self.links.index.len().checked_div(n).unwrap_or(0);
        let neighbours = |i: usize| (i * k..(i + 1) * k).filter(|&at| self.links.open[at]);
        let mut kept = vec![false; n];
        let mut border: Vec<usize> =
            used.into_iter().filter(|&i| !std::mem::replace(&mut kept[i], true)).collect();
        for _ in 0..hops {
            let reached = border.iter().flat_map(|&i| neighbours(i)).map(|at| self.links.index[at] as usize);
            border = reached.filter(|&j| !std::mem::replace(&mut kept[j], true)).collect();
        }
        let mut moved = vec![u32::MAX; n];
        let mut reduced = Self::default();
        for i in (0..n).filter(|&i| kept[i]) {
            moved[i] = reduced.all.len() as u32;
            reduced.all.push(self.all[i].clone());
        }
        for i in (0..n).filter(|&i| kept[i]) {
            // Neighbours of the outermost places may be missing: nothing that is used depends on those.
            let there: Vec<usize> = neighbours(i).filter(|&at| kept[self.links.index[at] as usize]).collect();
            reduced.links.push(k, PLACE_PAIR, &there, |at, out| {
                out.copy_from_slice(&self.links.relation[at * PLACE_PAIR..(at + 1) * PLACE_PAIR]);
            });
            let row = reduced.links.index.len() - k;
            for slot in 0..there.len() {
                let at = reduced.links.index[row + slot] as usize;
                reduced.links.index[row + slot] = moved[self.links.index[at] as usize];
            }
        }
        (reduced, moved)
    }
}

/// What is known of a map: what places are made of.
#[derive(Clone, Debug)]
pub(crate) struct KnownMap {
    /// Pieces of lines, without stop lines: those are [`Stop`]s.
    pub pieces: Vec<MapPiece>,
    /// Where to stop.
    pub stops: Vec<Stop>,
    /// Per light the lane that it controls.
    light_lanes: Vec<usize>,
    /// Per lane those that follow.
    successors: Vec<Vec<usize>>,
}

impl KnownMap {
    /// The map of a scenario within `radius` of where the AV is at the current frame.
    pub(crate) fn of(start: &Start, radius: f64) -> Self {
        let mut pieces = map_pieces(&start.map, start.now(0).position(), radius);
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

impl LearningMap for KnownMap {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        for piece in &mut self.pieces {
            piece.points = piece.points.map(flip);
            // Edges have the road on their left.
            if matches!(piece.kind, PieceKind::EdgeBoundary | PieceKind::EdgeMedian) {
                piece.points.reverse();
            }
        }
        for stop in &mut self.stops {
            (stop.at, stop.ahead) = (flip(stop.at), flip(stop.ahead));
        }
    }

    fn stretch(&mut self, factor: f64) {
        for piece in &mut self.pieces {
            piece.points = piece.points.map(|p| p * factor);
            piece.length *= factor;
            piece.speed_limit = piece.speed_limit.map(|v| v * factor);
        }
        for stop in &mut self.stops {
            stop.at *= factor;
        }
    }
}

/// Where vehicles stop.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stop {
    /// Where, metres.
    pub at: Vec2,
    /// Direction of its lane there.
    pub ahead: Vec2,
    /// The light that says when.
    pub light: Option<usize>,
    /// 0 at lights, 1 at signs, 2 at give-way lines.
    kind: usize,
}

impl Stop {
    /// The stops of a scenario within `radius` of where the AV is at the current frame: lights, then signs and give-way lines.
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
                // Lights are above, with their states.
                StopKind::Light => continue,
                StopKind::Sign => 1,
                StopKind::Yield => 2,
            };
            let at = map.lanes[line.lane].baseline.at(line.s);
            found.push(Self { at, ahead: ahead(line.lane, at), light: None, kind });
        }
        let about = start.now(0).position();
        found.retain(|s| (s.at - about).norm() < radius);
        found
    }
}

impl Place {
    fn of_piece(piece: &MapPiece, light: Option<usize>) -> Self {
        let points = piece.points.to_vec();
        let start = points[0];
        let chord = points.iter().map(|p| p - start).find(|d| d.norm() > 1e-6).unwrap_or(Vec2::x());
        let ahead = chord.normalize();
        let mut features = [0.0; PLACE];
        for (i, p) in points.iter().skip(1).enumerate() {
            let local = into_frame(ahead, p - start);
            features[2 * i] = (local.x / 5.0) as f32;
            features[2 * i + 1] = (local.y / 2.0) as f32;
        }
        features[20 + piece.kind.code()] = 1.0;
        features[20 + KINDS] = (piece.length / 5.0) as f32;
        features[21 + KINDS] = piece.speed_limit.map_or(0.0, |v| (v / 15.0) as f32);
        features[22 + KINDS] = f32::from(u8::from(piece.speed_limit.is_some()));
        features[23 + KINDS] = f32::from(u8::from(light.is_some()));
        let role = if piece.kind.is_lane() { Role::Lane } else { Role::Border };
        let (middle, speed_limit) = (points[5], piece.speed_limit);
        Self { start, ahead, middle, role, light, speed_limit, points, features }
    }

    fn of_stop(stop: &Stop) -> Self {
        let &Stop { at, ahead, light, kind } = stop;
        let mut features = [0.0; PLACE];
        features[20 + PieceKind::COUNT + kind] = 1.0;
        features[23 + KINDS] = f32::from(u8::from(light.is_some()));
        let points = vec![at];
        Self { start: at, ahead, middle: at, role: Role::Stop, light, speed_limit: None, points, features }
    }

    /// How another place stands to this one, in the frame of this one.
    fn relate_place(&self, other: &Self, out: &mut [f32]) {
        let apart = into_frame(self.ahead, other.start - self.start);
        let toward = into_frame(self.ahead, other.ahead);
        let distance = apart.norm();
        put(
            out,
            [
                apart.x / 10.0,
                apart.y / 10.0,
                distance / 10.0,
                toward.x,
                toward.y,
                1.0 / (1.0 + distance),
                1.0,
            ],
        );
    }

    /// Where it ends.
    pub(crate) fn end(&self) -> Vec2 {
        self.points[self.points.len() - 1]
    }

    /// Its direction at the end.
    fn end_ahead(&self) -> Vec2 {
        match self.points.as_slice() {
            [.., a, b] if (b - a).norm() > 1e-6 => (b - a).normalize(),
            _ => self.ahead,
        }
    }

    /// The nearest point, and the direction of the piece there.
    pub(crate) fn nearest(&self, p: Vec2) -> (Vec2, Vec2) {
        let mut best = (f64::INFINITY, self.start, self.ahead);
        for pair in self.points.windows(2) {
            let (d2, t) = point_segment(p, pair[0], pair[1]);
            if d2 < best.0 {
                let along = pair[1] - pair[0];
                let length = along.norm();
                let ahead = if length > 1e-6 { along / length } else { self.ahead };
                best = (d2, pair[0] + along * t, ahead);
            }
        }
        (best.1, best.2)
    }

    /// How this place stands to an agent, in the agent's frame, with what its light shows now.
    pub(crate) fn relate(&self, me: &Body, light: Option<LightState>, out: &mut [f32]) {
        let local = |p: Vec2| into_frame(me.ahead, p - me.position);
        let (nearest, along) = self.nearest(me.position);
        let toward = into_frame(me.ahead, along);
        let at = local(nearest);
        let first = local(self.start);
        let last = local(self.end());
        let end_ahead = if self.points.len() > 1 { into_frame(me.ahead, self.end_ahead()) } else { toward };
        // Left of the piece is positive.
        let aside = into_frame(along, me.position - nearest).y;
        let distance = at.norm();
        let speed = me.velocity.dot(&me.ahead).max(0.0);
        let shown = |f: fn(LightState) -> bool| f64::from(u8::from(light.is_some_and(f)));
        let (mut brake, mut arrival) = (0.0, 0.0);
        if self.role == Role::Stop && at.x > 0.0 {
            let room = (at.x - me.half.x).max(0.1);
            brake = (speed * speed / (2.0 * room) / 4.0).min(3.0);
            arrival = (room / speed.max(0.5) / 5.0).min(2.0);
        }
        put(
            out,
            [
                at.x / 10.0,
                at.y / 5.0,
                1.0 / (1.0 + distance),
                distance / 30.0,
                aside.clamp(-2.0, 2.0),
                (aside / 3.0).clamp(-3.0, 3.0),
                toward.x,
                (toward.y * 3.0).clamp(-3.0, 3.0),
                first.x / 30.0,
                first.y / 30.0,
                last.x / 30.0,
                last.y / 30.0,
                end_ahead.x,
                (end_ahead.y * 3.0).clamp(-3.0, 3.0),
                shown(LightState::is_red),
                shown(LightState::is_yellow),
                shown(|l| matches!(l, LightState::Go | LightState::ArrowGo)),
                shown(|l| matches!(l, LightState::Unknown)),
                shown(|l| matches!(l, LightState::FlashingStop | LightState::FlashingCaution)),
                brake,
                arrival,
                f64::from(u8::from(self.role == Role::Lane)),
                f64::from(u8::from(self.role == Role::Border)),
                f64::from(u8::from(self.role == Role::Stop)),
                // Off which side of an edge the box comes.
                ((aside.abs() - me.half.y) / 2.0).clamp(-1.0, 3.0),
                f64::from(u8::from(at.x > 0.0)),
                1.0,
            ],
        );
    }
}

/// Chooses the places that agents attend to.
#[derive(Debug)]
pub(crate) struct Chooser {
    near: Nearest,
    ahead: Nearest,
    stops: Nearest,
}

impl Chooser {
    /// As many of each role as the settings say.
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            near: Nearest::new(config.near_pieces),
            ahead: Nearest::new(config.ahead_pieces),
            stops: Nearest::new(config.stops),
        }
    }

    /// The places for one agent: the pieces nearest to it; the lane pieces, not against its heading and not among these, nearest to
    /// the point where it will be in 2 s (8 to 35 m ahead); the nearest stops ahead.
    pub(crate) fn choose(&mut self, me: &Body, places: &[Place], chosen: &mut Vec<usize>) {
        self.near.clear();
        self.ahead.clear();
        self.stops.clear();
        chosen.clear();
        let pieces = places.partition_point(|p| p.role != Role::Stop);
        for (i, place) in places[..pieces].iter().enumerate() {
            self.near.offer((place.middle - me.position).norm_squared(), i);
        }
        chosen.extend(self.near.found());
        let lead = (2.0 * me.velocity.norm()).clamp(8.0, 35.0);
        let target = me.position + me.ahead * lead;
        for (i, place) in places[..pieces].iter().enumerate() {
            if place.role == Role::Lane && place.ahead.dot(&me.ahead) > 0.0 {
                let d2 = (place.middle - target).norm_squared();
                if !chosen.contains(&i) {
                    self.ahead.offer(d2, i);
                }
            }
        }
        chosen.extend(self.ahead.found());
        for (i, place) in places.iter().enumerate().skip(pieces) {
            let at = into_frame(me.ahead, place.start - me.position);
            let facing = place.ahead.dot(&me.ahead) > 0.3;
            if facing && at.x > -2.0 && at.x < STOP_REACH && at.y.abs() < 6.0 + 0.3 * at.x.abs() {
                self.stops.offer(at.norm_squared(), i);
            }
        }
        chosen.extend(self.stops.found());
    }
}
