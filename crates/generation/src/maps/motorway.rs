//! On-ramps, off-ramps and weaving sections of motorways.
//!
//! A parallel lane runs next to the rightmost lane: acceleration lanes end in a taper, deceleration lanes
//! begin with one, and the lane of a weaving section joins an on-ramp to an off-ramp.

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;
use reactsim_scene::LaneClass;

use super::build::{
    Direction, LaneRef, MARGIN, MapBuilder, OVERHANG, Path, Piece, Pose, Profile, Road, RoadLanes, Spec, mph,
    ribbon,
};
use super::lanes::gentle;
use super::plain::enter;
use super::ranges::{centred, flows, motorway, smallest_radius};
use crate::{Draw, Layout, RightOfWay};

pub(super) fn on_ramp(rng: &mut Stream) -> Layout {
    Motorway::draw(rng).layout(rng, true, false)
}

pub(super) fn off_ramp(rng: &mut Stream) -> Layout {
    Motorway::draw(rng).layout(rng, false, true)
}

/// Draws a motorway with an on-ramp and, soon after it, an off-ramp.
pub(super) fn weaving(rng: &mut Stream) -> Layout {
    Motorway::draw(rng).layout(rng, true, true)
}

struct Motorway {
    road: Road,
}

impl Motorway {
    fn draw(rng: &mut Stream) -> Self {
        let (section, speed) = motorway(rng, (2, 4));
        let length = rng.uniform(850.0, 1000.0);
        let path = gentle(rng, length, speed);
        let middle = 0.5 * path.length();
        Self { road: Road::new(centred(path, middle, rng), section) }
    }

    /// Lays the motorway from border to border with a parallel lane in the middle, which begins with an
    /// on-ramp or a taper, and ends with an off-ramp or a taper.
    fn layout(&self, rng: &mut Stream, on: bool, off: bool) -> Layout {
        let road = &self.road;
        let mut b = MapBuilder::new();
        let end = road.path.length();
        let parallel = if on && off { rng.uniform(170.0, 320.0) } else { rng.uniform(130.0, 240.0) };
        let tapers = [
            if on { 0.0 } else { rng.uniform(60.0, 95.0) },
            if off { 0.0 } else { rng.uniform(85.0, 110.0) },
        ];
        // The middle of the map is where vehicles merge or diverge.
        let start = 0.5 * end - parallel * if on { 0.65 } else { 0.35 };
        let cuts = [0.0, start - tapers[0], start, start + parallel, start + parallel + tapers[1], end];
        let offset = road.lanes_edge(Direction::Forward) - road.lane_half(Direction::Forward);
        let right = road.section.forward.lanes - 1;

        // A taper of zero length has no stretch of its own.
        let mut stretches: Vec<RoadLanes> = Vec::new();
        let mut beside = 0;
        for pair in cuts.windows(2).filter(|p| p[1] > p[0]) {
            if pair[0] == start {
                beside = stretches.len();
            }
            stretches.push(road.lanes(&mut b, &format!("s{}", stretches.len()), pair[0], pair[1]));
        }
        for pair in stretches.windows(2) {
            pair[0].link(&mut b, &pair[1]);
        }
        let auxiliary = self.strip(&mut b, "auxiliary", (start, cuts[3]), offset.into(), false);
        b.beside(stretches[beside].forward[right], auxiliary);
        let main = road.lane_offset(Direction::Forward, right);
        if on {
            let ramp = self.ramp(&mut b, rng, start, offset, true);
            b.link(ramp, auxiliary);
            b.entry(ramp, flows::ramp(rng));
        } else {
            let centre = Profile::flat(main).then(cuts[1], start, offset);
            let taper = self.strip(&mut b, "opening", (cuts[1], start), centre, true);
            b.link(stretches[beside - 2].forward[right], taper);
            b.link(taper, auxiliary);
        }
        if off {
            let ramp = self.ramp(&mut b, rng, cuts[3], offset, false);
            b.link(auxiliary, ramp);
        } else {
            let centre = Profile::flat(offset).then(cuts[3], cuts[4], main);
            let taper = self.strip(&mut b, "merge", (cuts[3], cuts[4]), centre, true);
            b.link(auxiliary, taper);
            b.link(taper, stretches[beside + 2].forward[right]);
            b.priority(taper, &[stretches[beside + 1].forward[right]], RightOfWay::Yield);
        }
        self.ground(&mut b, [cuts[1], start, cuts[3], cuts[4]]);
        enter(&mut b, rng, road, &stretches[0], Direction::Forward);
        enter(&mut b, rng, road, &stretches[stretches.len() - 1], Direction::Backward);
        b.finish()
    }

    fn strip(
        &self,
        b: &mut MapBuilder,
        id: &str,
        (from, to): (f64, f64),
        centre: Profile,
        taper: bool,
    ) -> LaneRef {
        let (class, speed) = (LaneClass::Freeway, self.road.section.speed);
        let half = self.road.lane_half(Direction::Forward).into();
        let (spec, stations) = if taper {
            (Spec::connector(id, class, speed), self.road.taper_stations(from, to))
        } else {
            (Spec::lane(id, class, speed), self.road.stations(from, to))
        };
        b.strip(spec, &stations, &centre, &half, Direction::Forward)
    }

    /// Lays a ramp that leads to (or from) the parallel lane at `s`, with its ground.
    fn ramp(&self, b: &mut MapBuilder, rng: &mut Stream, s: f64, offset: f64, on: bool) -> LaneRef {
        let at = self.road.path.at(s);
        let joint = Pose { position: at.aside(offset), heading: at.heading };
        // Away from the motorway: seen from the joint, on-ramps bend to the left backwards, off-ramps to
        // the right.
        let (pose, side) = if on { (joint.reversed(), 1.0) } else { (joint, -1.0) };
        let along = at.curvature / (1.0 - at.curvature * offset) * if on { -1.0 } else { 1.0 };
        let speed = *rng.pick(&[25.0, 30.0, 35.0, 40.0, 45.0]);
        let gore = side / rng.uniform(260.0, 420.0);
        let bent = rng.uniform(0.05, 0.10) * (1.0 / gore).abs();
        let radius = smallest_radius(speed) * rng.uniform(1.1, 1.6);
        // Ramps turn away from the motorway, or back to become parallel to it, but not across it.
        let turn =
            if rng.chance(0.6) { side * rng.uniform(0.3, 1.0) } else { -side * rng.uniform(0.03, 0.08) };
        let mut pieces = vec![
            Piece { length: 40.0, from: along, to: along + gore },
            Piece { length: bent, from: along + gore, to: along + gore },
            Piece { length: 40.0, from: along + gore, to: 0.0 },
            Piece::straight(rng.uniform(20.0, 60.0)),
        ];
        pieces.extend(Piece::bend(turn, radius, 0.5));
        let rest = 230.0 - pieces.iter().map(|p| p.length).sum::<f64>();
        pieces.push(Piece::straight(rest.max(40.0)));
        let path = Path::new(&pieces).placed(0.0, pose.position, pose.heading);
        let length = path.length();

        let half = self.road.lane_half(Direction::Forward);
        let stations = path.stations(0.0, length, 5.0);
        let direction = if on { Direction::Backward } else { Direction::Forward };
        let spec = Spec::lane(if on { "on-ramp" } else { "off-ramp" }, LaneClass::Freeway, mph(speed));
        let lane = b.strip(spec, &stations, &0.0.into(), &half.into(), direction);
        let (right, left) = (self.road.section.forward.shoulder, rng.uniform(0.8, 1.3));
        // The wider shoulder is on the right of the traffic.
        let shift = 0.5 * if on { right - left } else { left - right };
        let end = path.at(length + OVERHANG);
        let line: Vec<Vec2> = stations.iter().chain([&end]).map(|p| p.aside(shift)).collect();
        let reach = half + 0.5 * (right + left).max(2.0 * MARGIN);
        b.ground(ribbon(&line, reach));
        self.gore(b, &path, if on { -reach } else { reach } + shift);
        b.gate(end.aside(shift - reach), end.aside(shift + reach));
        // Edge lines begin where the ramp has diverged from the motorway.
        for (paint, aside) in [(2, half), (6, -half)] {
            let aside = if on { aside } else { -aside };
            let from = if paint == 6 { 45.0 } else { 0.0 };
            b.paint(paint, path.stations(from, length, 5.0).iter().map(|p| p.aside(aside)).collect());
        }
        lane
    }

    /// Paves the wedge between the motorway and a ramp, whose edge has offset `edge`, until it is as wide
    /// as a nose.
    fn gore(&self, b: &mut MapBuilder, ramp: &Path, edge: f64) {
        /// Width of a nose, metres.
        const NOSE_WIDTH: f64 = 1.5;
        let kerb = self.road.kerb(Direction::Forward);
        let (mut outer, mut inner) = (Vec::new(), Vec::new());
        for station in ramp.stations(0.0, 140.0_f64.min(ramp.length()), 2.0) {
            let near = self.road.path.at(self.road.path.nearest(station.position));
            let (out, on) = (station.aside(edge), near.aside(kerb));
            // Positive to the right of the motorway.
            let gap = -reactsim_geometry::direction(near.heading).perp(&(out - on));
            if gap > NOSE_WIDTH {
                break;
            }
            outer.push(station.position);
            // Well within the motorway, so that the ring does not cross itself.
            inner.push(near.aside(self.road.lanes_edge(Direction::Forward)));
        }
        outer.extend(inner.into_iter().rev());
        b.ground(outer);
    }

    fn ground(&self, b: &mut MapBuilder, [opens, start, stop, closes]: [f64; 4]) {
        let road = &self.road;
        let end = road.path.length();
        road.surface(b, 0.0, end, (true, true));
        let width = 2.0 * road.lane_half(Direction::Forward);
        let widened = |edge: f64| {
            let mut profile = Profile::flat(edge);
            if opens < start {
                profile = profile.then(opens, start, edge - width);
            } else {
                profile = Profile::flat(edge - width);
            }
            if stop < closes { profile.then(stop, closes, edge) } else { profile }
        };
        let kerb = widened(road.kerb(Direction::Forward));
        road.band(b, &kerb, &road.lanes_edge(Direction::Forward).into(), opens, closes, (false, false));
        road.inner_lines(b, 0.0, end);
        let edge = road.lanes_edge(Direction::Forward);
        b.paint(2, road.line(Direction::Forward, edge, 0.0, opens));
        b.paint(1, road.line(Direction::Forward, edge, start, stop));
        b.paint(2, road.line(Direction::Forward, widened(edge), opens, closes));
        b.paint(2, road.line(Direction::Forward, edge, closes, end));
    }
}
