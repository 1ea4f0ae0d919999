//! How a driveway joins a street.

use std::f64::consts::FRAC_PI_2;

use super::build::{
    LaneRef, MARGIN, MapBuilder, Median, Path, Pose, Road, RoadLanes, Section, Side, Spec, TIGHTEST, Way,
    connector, mph, ribbon,
};
use crate::generation::{Draw, RightOfWay};
use crate::geometry::{Vec2, direction};
use crate::rollout::Stream;
use crate::scene::{LaneClass, StopKind};

/// Speed on driveways, mph.
const SPEED: f64 = 10.0;

/// A driveway of two lanes, and where it joins the street.
pub(super) struct Access {
    /// Where, metres along the street.
    pub(super) s: f64,
    /// On which side of the street.
    pub(super) way: Way,
    /// Turning vehicles leave and reach the lanes of the street so far before and after, metres.
    pub(super) reach: f64,
    /// From the edge of the street to where vehicles wait, metres.
    pub(super) setback: f64,
    /// Half of the stretch of pavement that vehicles cross, metres.
    pub(super) gap: f64,
    /// The driveway, away from the street.
    pub(super) road: Road,
}

impl Access {
    /// A driveway along `path` (from where vehicles wait outwards), at about a right angle; its middle lies at least as far after `s` as it reaches.
    /// `None` where no turn into it is wide enough.
    pub(super) fn draw(rng: &mut Stream, street: &Road, s: f64, way: Way, path: Path) -> Option<Self> {
        let side = Side { shoulder: 0.6, ..Side::plain(1, rng.uniform(2.9, 3.2)) };
        let section = Section {
            class: LaneClass::SurfaceStreet,
            speed: mph(SPEED),
            forward: side,
            backward: Some(side),
            median: Median { width: 0.2, shoulder: 0.5, raised: false },
        };
        let skew = rng.uniform(-0.15, 0.15);
        let sign = if way == Way::Forward { -1.0 } else { 1.0 };
        let walk = street.pavement_offset(way) - street.kerb(way);
        // Vehicles wait behind the pavement.
        let mut setback = walk.abs() * 2.0 + 1.5;
        for n in 0..14 {
            let reach = 11.0 + f64::from(n);
            let middle = s + reach;
            let at = street.path.at(middle);
            let start = at.aside(street.kerb(way) + sign * setback);
            let road =
                Road::new(path.clone().placed(0.0, start, at.heading + sign * FRAC_PI_2 + skew), section);
            let mut access = Self { s: middle, way, reach, setback, gap: 0.0, road };
            let turns = access.right_turns(street);
            if turns.iter().all(|t| t.1 >= TIGHTEST + 0.2) {
                access.gap = access.pavement_gap(street, &turns);
                return Some(access);
            }
            setback = (setback + 0.6).max(5.0);
        }
        None
    }

    /// The right turns, the tighter ones, in and out: points and smallest radius.
    fn right_turns(&self, street: &Road) -> [(Vec<Vec2>, f64); 2] {
        let pose = |road: &Road, s: f64, way: Way, i: usize| {
            let at = road.path.at(s);
            let pose = Pose { position: at.aside(road.lane_offset(way, i)), heading: at.heading };
            if way == Way::Forward { pose } else { pose.reversed() }
        };
        let lanes = match self.way {
            Way::Forward => street.section.forward.lanes,
            Way::Backward => street.section.backward.map_or(1, |s| s.lanes),
        };
        let ahead = if self.way == Way::Forward { self.reach } else { -self.reach };
        let from = pose(street, self.s - ahead, self.way, lanes - 1);
        let to = pose(street, self.s + ahead, self.way, lanes - 1);
        let (inwards, outwards) =
            (pose(&self.road, 0.0, Way::Forward, 0), pose(&self.road, 0.0, Way::Backward, 0));
        [connector(from, inwards), connector(outwards, to)]
    }

    /// Half of the stretch of pavement that turning vehicles take up.
    fn pavement_gap(&self, street: &Road, turns: &[(Vec<Vec2>, f64); 2]) -> f64 {
        let at = street.path.at(self.s);
        let axis = direction(at.heading);
        let sign = if self.way == Way::Forward { -1.0 } else { 1.0 };
        let kerb = street.kerb(self.way).abs();
        let width = self.road.lane_half(Way::Forward).max(street.lane_half(self.way)) + MARGIN + 0.2;
        let mut gap: f64 = 4.0;
        for p in turns.iter().flat_map(|t| ribbon(&t.0, width)) {
            let d = p - at.position;
            if axis.perp(&d) * sign > kerb - 0.2 {
                gap = gap.max(axis.dot(&d).abs() + 0.5);
            }
        }
        gap
    }

    /// Lays the driveway and its turns. `stretches` of the street: before it, at it, after it (along the street).
    pub(super) fn join(
        &self,
        b: &mut MapBuilder,
        rng: &mut Stream,
        street: &Road,
        number: usize,
        stretches: [&RoadLanes; 3],
    ) -> RoadLanes {
        let door = self.road.lanes(b, &format!("d{number}"), 0.0, self.road.path.length());
        let [before, at, after] = stretches;
        let (near, far) = if self.way == Way::Forward {
            (Way::Forward, Way::Backward)
        } else {
            (Way::Backward, Way::Forward)
        };
        let upstream = |way: Way| if way == Way::Forward { before } else { after };
        let downstream = |way: Way| if way == Way::Forward { after } else { before };
        let turn = |b: &mut MapBuilder, name: &str, from: LaneRef, to: LaneRef| {
            let spec = Spec::connector(format!("d{number}-{name}"), LaneClass::SurfaceStreet, mph(SPEED));
            b.connect(spec, from, to).0
        };
        let last = at.of(near).len() - 1;
        let right_in = turn(b, "right-in", upstream(near).of(near)[last], door.forward[0]);
        let right_out = turn(b, "right-out", door.backward[0], downstream(near).of(near)[last]);
        let bikes: Vec<LaneRef> = at.bike_of(near).into_iter().collect();
        if !bikes.is_empty() {
            b.priority(right_in, &bikes, RightOfWay::Yield);
        }
        let (rule, kind) = if rng.chance(0.5) {
            (RightOfWay::Stop, StopKind::Sign)
        } else {
            (RightOfWay::Yield, StopKind::Yield)
        };
        b.priority(right_out, &[&[at.of(near)[last]], &bikes[..]].concat(), rule);
        b.stop(kind, right_out);
        // Nobody crosses a raised median.
        if !street.section.median.raised {
            let left_in = turn(b, "left-in", upstream(far).of(far)[0], door.forward[0]);
            let left_out = turn(b, "left-out", door.backward[0], downstream(far).of(far)[0]);
            let passing = [at.of(near), &bikes[..]].concat();
            b.priority(left_in, &[&passing[..], &[right_in]].concat(), RightOfWay::Yield);
            b.priority(left_out, &[&passing[..], &[at.of(far)[0], left_in]].concat(), rule);
            b.stop(kind, left_out);
        }
        self.walk(b, street);
        let (width, depth) = (self.road.kerb(Way::Backward), 3.0);
        let corner = |s: f64, offset: f64| self.road.path.at(s).aside(offset);
        b.driveway(vec![
            corner(-depth, -width),
            corner(depth, -width),
            corner(depth, width),
            corner(-depth, width),
        ]);
        door
    }

    /// The pavement goes on across the driveway, and people on it go first.
    fn walk(&self, b: &mut MapBuilder, street: &Road) {
        let side = match self.way {
            Way::Forward => Some(street.section.forward),
            Way::Backward => street.section.backward,
        };
        let Some(pavement) = side.and_then(|s| s.pavement) else { return };
        let offset = street.pavement_offset(self.way);
        let line: Vec<Vec2> = street.line(self.way, offset, self.s - self.gap, self.s + self.gap);
        let crossed = b.lanes_across(&line, 0.0);
        b.crossing(line, pavement.width, &crossed, &[]);
    }
}
