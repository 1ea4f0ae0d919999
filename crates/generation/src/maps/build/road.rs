//! Roads: a reference line with a cross-section.

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;
use reactsim_scene::LaneClass;

use super::lanes::{LaneRef, Spec};
use super::path::{Path, Station};
use super::{MapBuilder, OVERHANG, Profile};
use crate::{Draw, ParkingSpot};

/// A direction of travel along a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// With the path, on the right of its middle.
    Forward,
    /// Against the path, on the left of its middle.
    Backward,
}

impl Direction {
    /// Returns the sign of offsets on this side: negative to the right.
    pub(in crate::maps) fn sign(self) -> f64 {
        match self {
            Self::Forward => -1.0,
            Self::Backward => 1.0,
        }
    }
}

/// A pavement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pavement {
    /// Distance from the kerb, metres.
    pub verge: f64,
    /// Width, metres.
    pub width: f64,
}

/// One direction of a road, from the middle outwards: lanes, bicycle lane, parking strip, shoulder,
/// pavement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// Number of lanes.
    pub lanes: usize,
    /// Width of each lane, metres.
    pub lane_width: f64,
    /// Width of a bicycle lane, metres.
    pub bike: Option<f64>,
    /// Width of a parking strip, metres.
    pub parking: Option<f64>,
    /// Distance from the outermost of these to the edge of the ground, metres; at least [`super::MARGIN`].
    pub shoulder: f64,
    /// A pavement.
    pub pavement: Option<Pavement>,
}

impl Side {
    /// Creates a side with lanes and a gutter only.
    pub const fn plain(lanes: usize, lane_width: f64) -> Self {
        Self { lanes, lane_width, bike: None, parking: None, shoulder: 0.6, pavement: None }
    }
}

/// Space between the directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Median {
    /// Distance between the innermost lanes of both directions, metres; for raised medians more than two
    /// shoulders. Ignored for one-way roads.
    pub width: f64,
    /// Width of the ground next to the innermost lanes of roads with a raised median and of one-way roads,
    /// metres, at least [`super::MARGIN`].
    pub shoulder: f64,
    /// Whether the median is an island rather than paint.
    pub raised: bool,
}

/// A cross-section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Class of the lanes (other than bicycle lanes).
    pub class: LaneClass,
    /// Speed limit, m/s.
    pub speed: f64,
    /// Lanes along the path.
    pub forward: Side,
    /// Lanes against the path, on two-way roads.
    pub backward: Option<Side>,
    /// Space between the directions; for one-way roads, on the left of the lanes, which begin at the
    /// reference line.
    pub median: Median,
}

/// The lanes of a stretch of road, from the middle outwards.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoadLanes {
    /// Lanes along the path.
    pub forward: Vec<LaneRef>,
    /// Lanes against the path.
    pub backward: Vec<LaneRef>,
    /// The bicycle lane along the path.
    pub forward_bike: Option<LaneRef>,
    /// The bicycle lane against the path.
    pub backward_bike: Option<LaneRef>,
}

impl RoadLanes {
    /// Links the lanes of successive stretches, by index from the middle outwards, where both exist.
    pub fn link(&self, b: &mut MapBuilder, next: &Self) {
        let forward = self.forward.iter().zip(&next.forward);
        for (&here, &there) in forward.chain(self.forward_bike.iter().zip(&next.forward_bike)) {
            b.link(here, there);
        }
        let backward = self.backward.iter().zip(&next.backward);
        for (&here, &there) in backward.chain(self.backward_bike.iter().zip(&next.backward_bike)) {
            b.link(there, here);
        }
    }

    /// Returns the lanes of a direction, from the middle outwards.
    pub fn of(&self, direction: Direction) -> &[LaneRef] {
        match direction {
            Direction::Forward => &self.forward,
            Direction::Backward => &self.backward,
        }
    }

    /// Returns the bicycle lane of a direction.
    pub fn bike_of(&self, direction: Direction) -> Option<LaneRef> {
        match direction {
            Direction::Forward => self.forward_bike,
            Direction::Backward => self.backward_bike,
        }
    }
}

/// Paint code of a broken white line.
pub const BROKEN_WHITE: u8 = 1;
/// Paint code of a solid white line.
pub const SOLID_WHITE: u8 = 2;
/// Paint code of a solid yellow line.
pub const SOLID_YELLOW: u8 = 6;
/// Paint code of a double yellow line.
pub const DOUBLE_YELLOW: u8 = 7;
/// Maximum distance between points on lanes, metres.
const MAX_POINT_SPACING: f64 = 5.0;
/// Maximum distance between points where offsets change, metres.
const TAPER_POINT_SPACING: f64 = 2.0;
/// Upper bound of the speed limit of bicycle lanes, m/s.
const BIKE_SPEED_LIMIT: f64 = 8.0;
/// Distance of parked vehicles from the lane and from the kerb, metres.
const PARKED_CLEARANCE: f64 = 0.3;

/// A reference line with a cross-section.
#[derive(Clone, Debug)]
pub struct Road {
    /// The reference line: the middle of the median.
    pub path: Path,
    /// The cross-section.
    pub section: Section,
}

impl Road {
    /// Creates a road.
    pub const fn new(path: Path, section: Section) -> Self {
        Self { path, section }
    }

    pub(in crate::maps) fn side(&self, direction: Direction) -> Option<&Side> {
        match direction {
            Direction::Forward => Some(&self.section.forward),
            Direction::Backward => self.section.backward.as_ref(),
        }
    }

    /// Returns the directions that have lanes.
    pub fn directions(&self) -> impl Iterator<Item = Direction> + use<> {
        let two = self.section.backward.is_some();
        [Direction::Forward, Direction::Backward].into_iter().filter(move |&w| two || w == Direction::Forward)
    }

    /// Returns the offset of the inner border of a direction's lanes.
    fn inner(&self, direction: Direction) -> f64 {
        if self.section.backward.is_some() { direction.sign() * 0.5 * self.section.median.width } else { 0.0 }
    }

    /// Returns the offset of the centre of lane `i` (0 is the innermost).
    pub fn lane_offset(&self, direction: Direction, i: usize) -> f64 {
        let width = self.side(direction).map_or(0.0, |s| s.lane_width);
        self.inner(direction) + direction.sign() * width * (i as f64 + 0.5)
    }

    /// Returns the offset of the outer border of the lanes, without bicycle lane and parking strip.
    pub fn lanes_edge(&self, direction: Direction) -> f64 {
        let width = self.side(direction).map_or(0.0, |s| s.lane_width * s.lanes as f64);
        self.inner(direction) + direction.sign() * width
    }

    /// Returns the offset of the centre of the bicycle lane; of a lane without width if there is none.
    pub fn bike_offset(&self, direction: Direction) -> f64 {
        self.lanes_edge(direction)
            + direction.sign() * 0.5 * self.side(direction).and_then(|s| s.bike).unwrap_or(0.0)
    }

    /// Returns the offset of the inner border of the parking strip; of a strip without width if there is
    /// none.
    pub fn parking_edge(&self, direction: Direction) -> f64 {
        self.lanes_edge(direction)
            + direction.sign() * self.side(direction).and_then(|s| s.bike).unwrap_or(0.0)
    }

    /// Returns the offset of the edge of the ground.
    pub fn kerb(&self, direction: Direction) -> f64 {
        match self.side(direction) {
            Some(side) => {
                self.parking_edge(direction)
                    + direction.sign() * (side.parking.unwrap_or(0.0) + side.shoulder)
            }
            None => self.section.median.shoulder,
        }
    }

    /// Returns the offset of the centre of the pavement; that of the kerb if there is none.
    pub fn pavement_offset(&self, direction: Direction) -> f64 {
        let beyond = self.side(direction).and_then(|s| s.pavement).map_or(0.0, |p| p.verge + 0.5 * p.width);
        self.kerb(direction) + direction.sign() * beyond
    }

    /// Returns half the width of the lanes of a direction, metres.
    pub fn lane_half(&self, direction: Direction) -> f64 {
        self.side(direction).map_or(0.0, |s| 0.5 * s.lane_width)
    }

    /// Returns the stations at which the lanes from `from` to `to` have points.
    pub fn stations(&self, from: f64, to: f64) -> Vec<Station> {
        self.path.stations(from, to, MAX_POINT_SPACING)
    }

    /// Returns the same stations, dense enough for changing offsets.
    pub fn taper_stations(&self, from: f64, to: f64) -> Vec<Station> {
        self.path.stations(from, to, TAPER_POINT_SPACING)
    }

    /// Returns a line at an offset from the path, in the driving direction.
    pub fn line(&self, direction: Direction, offset: impl Into<Profile>, from: f64, to: f64) -> Vec<Vec2> {
        let offset = offset.into();
        let longest = if offset.changes_within(from, to) { TAPER_POINT_SPACING } else { MAX_POINT_SPACING };
        let stations = self.path.stations(from, to, longest);
        let mut points: Vec<Vec2> = stations.iter().map(|p| p.aside(offset.at(p.s))).collect();
        if direction == Direction::Backward {
            points.reverse();
        }
        points
    }

    /// Lays lanes, ground, paint and pavements from `from` to `to` metres along the path. `border` tells
    /// whether the start and the end are at the border of the map. Lane ids begin with `name`.
    pub fn lay(&self, b: &mut MapBuilder, name: &str, from: f64, to: f64, border: (bool, bool)) -> RoadLanes {
        let lanes = self.lanes(b, name, from, to);
        self.surface(b, from, to, border);
        self.lines(b, from, to);
        for direction in self.directions() {
            self.pavement(b, direction, from, to);
        }
        lanes
    }

    /// Lays the lanes from `from` to `to`, as neighbours of one another within each direction. Their ids
    /// are `name`, `-f` or `-b` for the direction, and an index from the middle outwards or `bike`.
    pub fn lanes(&self, b: &mut MapBuilder, name: &str, from: f64, to: f64) -> RoadLanes {
        let stations = self.stations(from, to);
        let mut out = RoadLanes::default();
        for direction in self.directions() {
            let Some(side) = self.side(direction) else { continue };
            let letter = if direction == Direction::Forward { "f" } else { "b" };
            let half = Profile::flat(0.5 * side.lane_width);
            let lanes: Vec<LaneRef> = (0..side.lanes)
                .map(|i| {
                    let spec =
                        Spec::lane(format!("{name}-{letter}{i}"), self.section.class, self.section.speed);
                    b.strip(spec, &stations, &Profile::flat(self.lane_offset(direction, i)), &half, direction)
                })
                .collect();
            for pair in lanes.windows(2) {
                b.beside(pair[0], pair[1]);
            }
            let bike = side.bike.map(|width| {
                let speed = BIKE_SPEED_LIMIT.min(self.section.speed);
                let spec = Spec::lane(format!("{name}-{letter}bike"), LaneClass::Bike, speed);
                b.strip(
                    spec,
                    &stations,
                    &Profile::flat(self.bike_offset(direction)),
                    &Profile::flat(0.5 * width),
                    direction,
                )
            });
            match direction {
                Direction::Forward => (out.forward, out.forward_bike) = (lanes, bike),
                Direction::Backward => (out.backward, out.backward_bike) = (lanes, bike),
            }
        }
        out
    }

    /// Lays the ground from `from` to `to`. At the border of the map it continues for [`OVERHANG`] without
    /// an edge at its end; elsewhere it continues for 0.3 m, so that the surfaces of successive stretches
    /// overlap.
    pub fn surface(&self, b: &mut MapBuilder, from: f64, to: f64, border: (bool, bool)) {
        let (right, left) = (self.kerb(Direction::Forward), self.kerb(Direction::Backward));
        let median = self.section.median;
        if self.section.backward.is_some() && median.raised {
            let half = 0.5 * median.width - median.shoulder;
            self.slab(b, (right, -half), from, to, border);
            self.slab(b, (half, left), from, to, border);
        } else {
            self.slab(b, (right, left), from, to, border);
        }
    }

    /// Lays ground between two offsets (right, left), as in [`Self::surface`].
    pub fn slab(&self, b: &mut MapBuilder, offsets: (f64, f64), from: f64, to: f64, border: (bool, bool)) {
        self.band(b, &offsets.0.into(), &offsets.1.into(), from, to, border);
    }

    /// Lays ground between two edges (right, left) whose offsets change along the road, as in
    /// [`Self::surface`].
    pub fn band(
        &self,
        b: &mut MapBuilder,
        right: &Profile,
        left: &Profile,
        from: f64,
        to: f64,
        border: (bool, bool),
    ) {
        let reach = |open: bool| if open { OVERHANG } else { 0.3 };
        let (first, last) = (from - reach(border.0), to + reach(border.1));
        let tapers = right.changes_within(first, last) || left.changes_within(first, last);
        let stations = if tapers { self.taper_stations(first, last) } else { self.stations(first, last) };
        let mut ring: Vec<Vec2> = stations.iter().map(|p| p.aside(right.at(p.s))).collect();
        ring.extend(stations.iter().rev().map(|p| p.aside(left.at(p.s))));
        b.ground(ring);
        for (open, s) in [(border.0, first), (border.1, last)] {
            if open {
                let at = self.path.at(s);
                b.gate(at.aside(right.at(s)), at.aside(left.at(s)));
            }
        }
    }

    /// Paints lane lines, the centre line, and edge lines along bicycle lanes, parking strips and on
    /// motorways.
    pub fn lines(&self, b: &mut MapBuilder, from: f64, to: f64) {
        self.inner_lines(b, from, to);
        if let Some(edge) = self.edge_paint(Direction::Forward) {
            b.paint(edge, self.line(Direction::Forward, self.lanes_edge(Direction::Forward), from, to));
        }
    }

    /// Returns the paint at the outer border of a direction's lanes.
    fn edge_paint(&self, direction: Direction) -> Option<u8> {
        let side = self.side(direction)?;
        let freeway = self.section.class == LaneClass::Freeway;
        (side.bike.is_some() || side.parking.is_some() || freeway).then_some(SOLID_WHITE)
    }

    /// As [`Self::lines`], but without the edge line on the right of the lanes along the path, for roads
    /// whose edge changes.
    pub fn inner_lines(&self, b: &mut MapBuilder, from: f64, to: f64) {
        let two_way = self.section.backward.is_some();
        let wide = self.section.median.width > 0.8;
        if two_way && !wide {
            b.paint(DOUBLE_YELLOW, self.line(Direction::Forward, 0.0, from, to));
        }
        for direction in self.directions() {
            let Some(side) = self.side(direction) else { continue };
            if !two_way || wide {
                b.paint(SOLID_YELLOW, self.line(direction, self.inner(direction), from, to));
            }
            for i in 1..side.lanes {
                let between = 0.5 * (self.lane_offset(direction, i - 1) + self.lane_offset(direction, i));
                b.paint(BROKEN_WHITE, self.line(direction, between, from, to));
            }
            if direction == Direction::Backward
                && let Some(edge) = self.edge_paint(direction)
            {
                b.paint(edge, self.line(direction, self.lanes_edge(direction), from, to));
            }
            if side.bike.is_some() && side.parking.is_some() {
                b.paint(SOLID_WHITE, self.line(direction, self.parking_edge(direction), from, to));
            }
        }
    }

    /// Adds the pavement of a side from `from` to `to`, if there is one.
    pub fn pavement(&self, b: &mut MapBuilder, direction: Direction, from: f64, to: f64) {
        if let Some(pavement) = self.side(direction).and_then(|s| s.pavement) {
            b.footway(self.line(direction, self.pavement_offset(direction), from, to), pavement.width);
        }
    }

    /// Adds parking spots on the parking strip of a side from `from` to `to`, one behind the other.
    pub fn parking(&self, b: &mut MapBuilder, rng: &mut Stream, direction: Direction, from: f64, to: f64) {
        let Some(strip) = self.side(direction).and_then(|s| s.parking) else { return };
        let width = strip - 2.0 * PARKED_CLEARANCE;
        let offset = self.parking_edge(direction) + direction.sign() * 0.5 * strip;
        let mut s = from;
        loop {
            let length = rng.uniform(6.0, 7.0);
            if s + length > to {
                return;
            }
            let at = self.path.at(s + 0.5 * length);
            let heading =
                if direction == Direction::Forward { at.heading } else { at.heading + std::f64::consts::PI };
            b.park(ParkingSpot { position: at.aside(offset), heading, length: length - 0.7, width });
            s += length;
        }
    }
}
