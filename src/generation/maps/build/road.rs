//! Roads: a reference line with a cross-section.

use super::lanes::{LaneRef, Spec};
use super::path::{Path, Station};
use super::{MapBuilder, OVERHANG, Profile};
use crate::generation::{Draw, ParkingSpot};
use crate::geometry::Vec2;
use crate::rollout::Stream;
use crate::scene::LaneClass;

/// A direction along a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// With it: on the right of its middle.
    Forward,
    /// Against it: on the left.
    Backward,
}

impl Way {
    /// The sign of offsets on this side: negative to the right.
    fn sign(self) -> f64 {
        match self {
            Self::Forward => -1.0,
            Self::Backward => 1.0,
        }
    }
}

/// A pavement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pavement {
    /// From the kerb to it, metres.
    pub verge: f64,
    /// Its width, metres.
    pub width: f64,
}

/// One direction of a road, from the middle outwards: lanes, bicycle lane, parking strip, shoulder, pavement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// Number of lanes.
    pub lanes: usize,
    /// Width of each, metres.
    pub lane_width: f64,
    /// Width of a bicycle lane, metres.
    pub bike: Option<f64>,
    /// Width of a parking strip, metres.
    pub parking: Option<f64>,
    /// From the outermost of these to the edge of the ground, metres; at least [`super::MARGIN`].
    pub shoulder: f64,
    /// A pavement.
    pub pavement: Option<Pavement>,
}

impl Side {
    /// Lanes and a gutter, nothing else.
    pub const fn plain(lanes: usize, lane_width: f64) -> Self {
        Self { lanes, lane_width, bike: None, parking: None, shoulder: 0.6, pavement: None }
    }
}

/// What lies between the directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Median {
    /// From lane to lane, metres: of raised medians more than two shoulders. Of no meaning for one-way roads.
    pub width: f64,
    /// Ground beside the innermost lanes of roads with a raised median and of one-way roads, metres, at least [`super::MARGIN`].
    pub shoulder: f64,
    /// Whether it is an island, not paint.
    pub raised: bool,
}

/// A cross-section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// What its lanes are for (bicycle lanes apart).
    pub class: LaneClass,
    /// Speed limit, m/s.
    pub speed: f64,
    /// Lanes along the path.
    pub forward: Side,
    /// Lanes against it, of two-way roads.
    pub backward: Option<Side>,
    /// Between the directions; of one-way roads on the left of the lanes, which begin at the reference line.
    pub median: Median,
}

/// The lanes of a stretch of road, from the middle outwards.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoadLanes {
    /// Along the path.
    pub forward: Vec<LaneRef>,
    /// Against it.
    pub backward: Vec<LaneRef>,
    /// The bicycle lane along the path.
    pub forward_bike: Option<LaneRef>,
    /// The bicycle lane against it.
    pub backward_bike: Option<LaneRef>,
}

impl RoadLanes {
    /// Links the lanes of successive stretches, by number from the middle outwards, where both have them.
    pub fn link(&self, b: &mut MapBuilder, next: &Self) {
        for (&here, &there) in self.forward.iter().zip(&next.forward) {
            b.link(here, there);
        }
        for (&here, &there) in self.backward.iter().zip(&next.backward) {
            b.link(there, here);
        }
        if let (Some(here), Some(there)) = (self.forward_bike, next.forward_bike) {
            b.link(here, there);
        }
        if let (Some(here), Some(there)) = (self.backward_bike, next.backward_bike) {
            b.link(there, here);
        }
    }

    /// The lanes of a direction, from the middle outwards.
    pub fn of(&self, way: Way) -> &[LaneRef] {
        match way {
            Way::Forward => &self.forward,
            Way::Backward => &self.backward,
        }
    }

    /// The bicycle lane of a direction.
    pub fn bike_of(&self, way: Way) -> Option<LaneRef> {
        match way {
            Way::Forward => self.forward_bike,
            Way::Backward => self.backward_bike,
        }
    }
}

/// Codes of paint.
const BROKEN_WHITE: u8 = 1;
const SOLID_WHITE: u8 = 2;
const SOLID_YELLOW: u8 = 6;
const DOUBLE_YELLOW: u8 = 7;
/// Longest distance of points on lanes, metres, and where offsets change.
const LONGEST: f64 = 5.0;
const TAPER: f64 = 2.0;
/// Cyclists are not held to more than this, m/s.
const BIKE_SPEED: f64 = 8.0;
/// How far parked vehicles stand from the lane and from the kerb, metres.
const PARKED_CLEAR: f64 = 0.3;

/// A reference line with a cross-section.
#[derive(Clone, Debug)]
pub struct Road {
    /// The reference line: the middle of the median.
    pub path: Path,
    /// The cross-section.
    pub section: Section,
}

impl Road {
    /// A road.
    pub const fn new(path: Path, section: Section) -> Self {
        Self { path, section }
    }

    fn side(&self, way: Way) -> Option<&Side> {
        match way {
            Way::Forward => Some(&self.section.forward),
            Way::Backward => self.section.backward.as_ref(),
        }
    }

    /// The two directions, where there are lanes.
    pub fn ways(&self) -> impl Iterator<Item = Way> + use<> {
        let two = self.section.backward.is_some();
        [Way::Forward, Way::Backward].into_iter().filter(move |&w| two || w == Way::Forward)
    }

    /// Offset of the inner border of a direction's lanes.
    fn inner(&self, way: Way) -> f64 {
        if self.section.backward.is_some() { way.sign() * 0.5 * self.section.median.width } else { 0.0 }
    }

    /// Offset of the middle of lane `i` (0 is the innermost).
    pub fn lane_offset(&self, way: Way, i: usize) -> f64 {
        let width = self.side(way).map_or(0.0, |s| s.lane_width);
        self.inner(way) + way.sign() * width * (i as f64 + 0.5)
    }

    /// Offset of the outer border of the lanes, without bicycle lane and parking strip.
    pub fn lanes_edge(&self, way: Way) -> f64 {
        let width = self.side(way).map_or(0.0, |s| s.lane_width * s.lanes as f64);
        self.inner(way) + way.sign() * width
    }

    /// Offset of the middle of the bicycle lane, as if there were one.
    pub fn bike_offset(&self, way: Way) -> f64 {
        self.lanes_edge(way) + way.sign() * 0.5 * self.side(way).and_then(|s| s.bike).unwrap_or(0.0)
    }

    /// Offset of the inner border of the parking strip, as if there were one.
    pub fn parking_edge(&self, way: Way) -> f64 {
        self.lanes_edge(way) + way.sign() * self.side(way).and_then(|s| s.bike).unwrap_or(0.0)
    }

    /// Offset of the edge of the ground.
    pub fn kerb(&self, way: Way) -> f64 {
        match self.side(way) {
            Some(side) => self.parking_edge(way) + way.sign() * (side.parking.unwrap_or(0.0) + side.shoulder),
            None => self.section.median.shoulder,
        }
    }

    /// Offset of the middle of the pavement, as if there were one.
    pub fn pavement_offset(&self, way: Way) -> f64 {
        let beyond = self.side(way).and_then(|s| s.pavement).map_or(0.0, |p| p.verge + 0.5 * p.width);
        self.kerb(way) + way.sign() * beyond
    }

    /// Half the width of the lanes of a direction, metres.
    pub fn lane_half(&self, way: Way) -> f64 {
        self.side(way).map_or(0.0, |s| 0.5 * s.lane_width)
    }

    /// The places of the path that the lanes from `from` to `to` have points at.
    pub fn stations(&self, from: f64, to: f64) -> Vec<Station> {
        self.path.stations(from, to, LONGEST)
    }

    /// The same, dense enough for offsets that change.
    pub fn taper_stations(&self, from: f64, to: f64) -> Vec<Station> {
        self.path.stations(from, to, TAPER)
    }

    /// A line beside the path, in driving direction of `way`.
    pub fn line(&self, way: Way, offset: impl Into<Profile>, from: f64, to: f64) -> Vec<Vec2> {
        let offset = offset.into();
        let longest = if offset.changes_within(from, to) { TAPER } else { LONGEST };
        let stations = self.path.stations(from, to, longest);
        let mut points: Vec<Vec2> = stations.iter().map(|p| p.aside(offset.at(p.s))).collect();
        if way == Way::Backward {
            points.reverse();
        }
        points
    }

    /// Lanes, ground, paint and pavements from `from` to `to` metres along the path, where the road is open to the border of the map at
    /// its start or end. Lane ids begin with `name`.
    pub fn lay(&self, b: &mut MapBuilder, name: &str, from: f64, to: f64, border: (bool, bool)) -> RoadLanes {
        let lanes = self.lanes(b, name, from, to);
        self.surface(b, from, to, border);
        self.lines(b, from, to);
        for way in self.ways() {
            self.pavement(b, way, from, to);
        }
        lanes
    }

    /// The lanes from `from` to `to`, neighbours of one another in each direction. Their ids are `name`, `-f` or `-b` for the
    /// direction, and a number from the middle outwards or `bike`.
    pub fn lanes(&self, b: &mut MapBuilder, name: &str, from: f64, to: f64) -> RoadLanes {
        let stations = self.stations(from, to);
        let mut out = RoadLanes::default();
        for way in self.ways() {
            let Some(side) = self.side(way) else { continue };
            let letter = if way == Way::Forward { "f" } else { "b" };
            let half = Profile::flat(0.5 * side.lane_width);
            let lanes: Vec<LaneRef> = (0..side.lanes)
                .map(|i| {
                    let spec =
                        Spec::lane(format!("{name}-{letter}{i}"), self.section.class, self.section.speed);
                    b.strip(spec, &stations, &Profile::flat(self.lane_offset(way, i)), &half, way)
                })
                .collect();
            for pair in lanes.windows(2) {
                b.beside(pair[0], pair[1]);
            }
            let bike = side.bike.map(|width| {
                let speed = BIKE_SPEED.min(self.section.speed);
                let spec = Spec::lane(format!("{name}-{letter}bike"), LaneClass::Bike, speed);
                b.strip(
                    spec,
                    &stations,
                    &Profile::flat(self.bike_offset(way)),
                    &Profile::flat(0.5 * width),
                    way,
                )
            });
            match way {
                Way::Forward => (out.forward, out.forward_bike) = (lanes, bike),
                Way::Backward => (out.backward, out.backward_bike) = (lanes, bike),
            }
        }
        out
    }

    /// The ground from `from` to `to`; at the border it goes on for [`OVERHANG`], and the edge is open there. Elsewhere it goes on for
    /// 0.3 m, so that the surfaces of successive stretches overlap.
    pub fn surface(&self, b: &mut MapBuilder, from: f64, to: f64, border: (bool, bool)) {
        let (right, left) = (self.kerb(Way::Forward), self.kerb(Way::Backward));
        let median = self.section.median;
        if self.section.backward.is_some() && median.raised {
            let half = 0.5 * median.width - median.shoulder;
            self.slab(b, (right, -half), from, to, border);
            self.slab(b, (half, left), from, to, border);
        } else {
            self.slab(b, (right, left), from, to, border);
        }
    }

    /// Ground between two offsets (right, left), as in [`Self::surface`].
    pub fn slab(&self, b: &mut MapBuilder, offsets: (f64, f64), from: f64, to: f64, border: (bool, bool)) {
        self.band(b, &offsets.0.into(), &offsets.1.into(), from, to, border);
    }

    /// Ground between two edges (right, left) whose offsets change along the road, as in [`Self::surface`].
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

    /// Lane lines, the line in the middle, and edge lines where there is a bicycle lane, a parking strip or a motorway.
    pub fn lines(&self, b: &mut MapBuilder, from: f64, to: f64) {
        self.inner_lines(b, from, to);
        if let Some(edge) = self.edge_paint(Way::Forward) {
            b.paint(edge, self.line(Way::Forward, self.lanes_edge(Way::Forward), from, to));
        }
    }

    /// The paint at the outer border of a direction's lanes.
    fn edge_paint(&self, way: Way) -> Option<u8> {
        let side = self.side(way)?;
        let freeway = self.section.class == LaneClass::Freeway;
        (side.bike.is_some() || side.parking.is_some() || freeway).then_some(SOLID_WHITE)
    }

    /// As [`Self::lines`], but without the edge line on the right of the lanes along the path, for roads whose edge changes.
    pub fn inner_lines(&self, b: &mut MapBuilder, from: f64, to: f64) {
        let two_way = self.section.backward.is_some();
        let wide = self.section.median.width > 0.8;
        if two_way && !wide {
            b.paint(DOUBLE_YELLOW, self.line(Way::Forward, 0.0, from, to));
        }
        for way in self.ways() {
            let Some(side) = self.side(way) else { continue };
            if !two_way || wide {
                b.paint(SOLID_YELLOW, self.line(way, self.inner(way), from, to));
            }
            for i in 1..side.lanes {
                let between = 0.5 * (self.lane_offset(way, i - 1) + self.lane_offset(way, i));
                b.paint(BROKEN_WHITE, self.line(way, between, from, to));
            }
            if way == Way::Backward
                && let Some(edge) = self.edge_paint(way)
            {
                b.paint(edge, self.line(way, self.lanes_edge(way), from, to));
            }
            if side.bike.is_some() && side.parking.is_some() {
                b.paint(SOLID_WHITE, self.line(way, self.parking_edge(way), from, to));
            }
        }
    }

    /// The pavement of a side from `from` to `to`, where there is one.
    pub fn pavement(&self, b: &mut MapBuilder, way: Way, from: f64, to: f64) {
        if let Some(pavement) = self.side(way).and_then(|s| s.pavement) {
            b.footway(self.line(way, self.pavement_offset(way), from, to), pavement.width);
        }
    }

    /// Places for parked vehicles on the parking strip of a side from `from` to `to`, one behind the other.
    pub fn parking(&self, b: &mut MapBuilder, rng: &mut Stream, way: Way, from: f64, to: f64) {
        let Some(strip) = self.side(way).and_then(|s| s.parking) else { return };
        let width = strip - 2.0 * PARKED_CLEAR;
        let offset = self.parking_edge(way) + way.sign() * 0.5 * strip;
        let mut s = from;
        loop {
            let length = rng.uniform(6.0, 7.0);
            if s + length > to {
                return;
            }
            let at = self.path.at(s + 0.5 * length);
            let heading = if way == Way::Forward { at.heading } else { at.heading + std::f64::consts::PI };
            b.park(ParkingSpot { position: at.aside(offset), heading, length: length - 0.7, width });
            s += length;
        }
    }
}
