//! Junctions of driveways with a street.

use std::f64::consts::FRAC_PI_2;

use reactsim_geometry::{Vec2, direction};
use reactsim_rollout::Stream;
use reactsim_scene::{LaneClass, StopKind};

use super::build::{
    Direction, LaneRef, MARGIN, MIN_TURN_RADIUS, MapBuilder, Median, Path, Pose, Road, RoadLanes, Section,
    Side, Spec, connector, mph, ribbon,
};
use crate::{Draw, RightOfWay};

/// Speed limit on driveways, mph.
const DRIVEWAY_SPEED: f64 = 10.0;

/// A two-lane driveway and its junction with the street.
pub(super) struct Access {
    /// Position of the junction, metres along the street.
    pub(super) s: f64,
    /// The side of the street, as the direction of its traffic.
    pub(super) direction: Direction,
    /// Distance along the street at which turning vehicles leave and reach its lanes, metres.
    pub(super) reach: f64,
    /// Distance from the edge of the street to the waiting line, metres.
    pub(super) setback: f64,
    /// Half of the stretch of pavement that vehicles cross, metres.
    pub(super) gap: f64,
    /// The driveway, leading away from the street.
    pub(super) road: Road,
}

impl Access {
    /// Draws a driveway along `path` (from the waiting line outwards), at about a right angle, whose middle
    /// is `reach` metres after `s`. `None` if no turn into it is wide enough.
    pub(super) fn draw(
        rng: &mut Stream,
        street: &Road,
        s: f64,
        direction: Direction,
        path: Path,
    ) -> Option<Self> {
        let side = Side { shoulder: 0.6, ..Side::plain(1, rng.uniform(2.9, 3.2)) };
        let section = Section {
            class: LaneClass::SurfaceStreet,
            speed: mph(DRIVEWAY_SPEED),
            forward: side,
            backward: Some(side),
            median: Median { width: 0.2, shoulder: 0.5, raised: false },
        };
        let skew = rng.uniform(-0.15, 0.15);
        let sign = direction.sign();
        let walk = street.pavement_offset(direction) - street.kerb(direction);
        // Vehicles wait behind the pavement.
        let mut setback = walk.abs() * 2.0 + 1.5;
        for n in 0..14 {
            let reach = 11.0 + f64::from(n);
            let middle = s + reach;
            let at = street.path.at(middle);
            let start = at.aside(street.kerb(direction) + sign * setback);
            let road =
                Road::new(path.clone().placed(0.0, start, at.heading + sign * FRAC_PI_2 + skew), section);
            let mut access = Self { s: middle, direction, reach, setback, gap: 0.0, road };
            let turns = access.right_turns(street);
            if turns.iter().all(|t| t.1 >= MIN_TURN_RADIUS + 0.2) {
                access.gap = access.pavement_gap(street, &turns);
                return Some(access);
            }
            setback = (setback + 0.6).max(5.0);
        }
        None
    }

    /// Returns the points and the smallest radius of the right turns in and out, which are the tighter
    /// ones.
    fn right_turns(&self, street: &Road) -> [(Vec<Vec2>, f64); 2] {
        let pose = |road: &Road, s: f64, direction: Direction, i: usize| {
            let at = road.path.at(s);
            let pose = Pose { position: at.aside(road.lane_offset(direction, i)), heading: at.heading };
            if direction == Direction::Forward { pose } else { pose.reversed() }
        };
        let lanes = street.side(self.direction).map_or(1, |s| s.lanes);
        let ahead = if self.direction == Direction::Forward { self.reach } else { -self.reach };
        let from = pose(street, self.s - ahead, self.direction, lanes - 1);
        let to = pose(street, self.s + ahead, self.direction, lanes - 1);
        let (inwards, outwards) =
            (pose(&self.road, 0.0, Direction::Forward, 0), pose(&self.road, 0.0, Direction::Backward, 0));
        [connector(from, inwards), connector(outwards, to)]
    }

    /// Returns half of the stretch of pavement that turning vehicles sweep.
    fn pavement_gap(&self, street: &Road, turns: &[(Vec<Vec2>, f64); 2]) -> f64 {
        let at = street.path.at(self.s);
        let axis = direction(at.heading);
        let sign = self.direction.sign();
        let kerb = street.kerb(self.direction).abs();
        let width =
            self.road.lane_half(Direction::Forward).max(street.lane_half(self.direction)) + MARGIN + 0.2;
        let mut gap: f64 = 4.0;
        for p in turns.iter().flat_map(|t| ribbon(&t.0, width)) {
            let d = p - at.position;
            if axis.perp(&d) * sign > kerb - 0.2 {
                gap = gap.max(axis.dot(&d).abs() + 0.5);
            }
        }
        gap
    }

    /// Lays the driveway and its turns. `stretches` are those of the street before, at and after it (along
    /// the street).
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
        let (near, far) = if self.direction == Direction::Forward {
            (Direction::Forward, Direction::Backward)
        } else {
            (Direction::Backward, Direction::Forward)
        };
        let upstream = |direction: Direction| if direction == Direction::Forward { before } else { after };
        let downstream = |direction: Direction| if direction == Direction::Forward { after } else { before };
        let turn = |b: &mut MapBuilder, name: &str, from: LaneRef, to: LaneRef| {
            let spec =
                Spec::connector(format!("d{number}-{name}"), LaneClass::SurfaceStreet, mph(DRIVEWAY_SPEED));
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
        // No turns across a raised median.
        if !street.section.median.raised {
            let left_in = turn(b, "left-in", upstream(far).of(far)[0], door.forward[0]);
            let left_out = turn(b, "left-out", door.backward[0], downstream(far).of(far)[0]);
            let passing = [at.of(near), &bikes[..]].concat();
            b.priority(left_in, &[&passing[..], &[right_in]].concat(), RightOfWay::Yield);
            b.priority(left_out, &[&passing[..], &[at.of(far)[0], left_in]].concat(), rule);
            b.stop(kind, left_out);
        }
        self.walk(b, street);
        let (width, depth) = (self.road.kerb(Direction::Backward), 3.0);
        let corner = |s: f64, offset: f64| self.road.path.at(s).aside(offset);
        b.driveway(vec![
            corner(-depth, -width),
            corner(depth, -width),
            corner(depth, width),
            corner(-depth, width),
        ]);
        door
    }

    /// Continues the pavement across the driveway; people on it have priority.
    fn walk(&self, b: &mut MapBuilder, street: &Road) {
        let Some(pavement) = street.side(self.direction).and_then(|s| s.pavement) else { return };
        let offset = street.pavement_offset(self.direction);
        let line: Vec<Vec2> = street.line(self.direction, offset, self.s - self.gap, self.s + self.gap);
        let crossed = b.lanes_across(&line);
        b.crossing(line, pavement.width, &crossed, &[]);
    }
}
