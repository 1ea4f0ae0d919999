//! Roads on which a lane ends or begins.

use reactsim_rollout::Stream;
use reactsim_scene::LaneClass;

use super::build::{Direction, LaneRef, MapBuilder, Path, Profile, Road, RoadLanes, Section, Side, Spec};
use super::plain::enter;
use super::ranges::{centred, merging_taper, motorway, smallest_radius, street};
use crate::{Draw, Layout, RightOfWay};

/// Draws a road on which the rightmost lane ends.
pub(super) fn dropped(rng: &mut Stream) -> Layout {
    LaneCountChange::draw(rng).layout(rng, true)
}

/// Draws a road on which a lane begins on the right.
pub(super) fn added(rng: &mut Stream) -> Layout {
    LaneCountChange::draw(rng).layout(rng, false)
}

/// A road whose forward side has one additional lane before (or after) a taper.
struct LaneCountChange {
    wide: Road,
    narrow: Road,
    speed: f64,
}

impl LaneCountChange {
    fn draw(rng: &mut Stream) -> Self {
        let (mut section, speed) = if rng.chance(0.5) { motorway(rng, (2, 3)) } else { street(rng, (1, 2)) };
        // No bicycle lane or parked cars at the taper.
        section.forward = Side {
            bike: None,
            parking: None,
            shoulder: section.forward.shoulder.max(0.6),
            ..section.forward
        };
        section.forward.lanes += 1;
        let freeway = section.class == LaneClass::Freeway;
        let length = if freeway { rng.uniform(850.0, 1000.0) } else { rng.uniform(500.0, 600.0) };
        let path = gentle(rng, length, speed);
        let middle = 0.5 * path.length();
        let path = centred(path, middle, rng);
        let narrow =
            Section { forward: Side { lanes: section.forward.lanes - 1, ..section.forward }, ..section };
        Self { wide: Road::new(path.clone(), section), narrow: Road::new(path, narrow), speed }
    }

    fn layout(&self, rng: &mut Stream, drop: bool) -> Layout {
        let mut b = MapBuilder::new();
        let end = self.wide.path.length();
        let width = self.wide.section.forward.lane_width;
        let merging = merging_taper(width, self.speed);
        // Lanes open over about half of the length over which they end.
        let taper = if drop { merging } else { (merging * rng.uniform(0.4, 0.6)).max(25.0) };
        let start = 0.5 * end - taper * rng.uniform(0.4, 1.0);
        let (first, last) = if drop { (&self.wide, &self.narrow) } else { (&self.narrow, &self.wide) };
        let cuts = [0.0, start, start + taper, end];
        let before = first.lanes(&mut b, "a", cuts[0], cuts[1]);
        let middle = self.narrow.lanes(&mut b, "b", cuts[1], cuts[2]);
        let after = last.lanes(&mut b, "c", cuts[2], cuts[3]);
        before.link(&mut b, &middle);
        middle.link(&mut b, &after);

        let outer = self.wide.section.forward.lanes - 1;
        let offsets = [first, last].map(|r| r.lane_offset(Direction::Forward, r.section.forward.lanes - 1));
        let side = self.side_lane(&mut b, (cuts[1], cuts[2]), offsets);
        if drop {
            b.link(before.forward[outer], side);
            b.link(side, after.forward[outer - 1]);
            b.priority(side, &[middle.forward[outer - 1]], RightOfWay::Yield);
        } else {
            b.link(before.forward[outer - 1], side);
            b.link(side, after.forward[outer]);
        }
        self.ground(&mut b, first, last, cuts);
        self.enter(&mut b, rng, &before, &after);
        b.finish()
    }

    /// Lays the lane that merges into its neighbour, or emerges from it.
    fn side_lane(&self, b: &mut MapBuilder, (from, to): (f64, f64), offsets: [f64; 2]) -> LaneRef {
        let centre = Profile::flat(offsets[0]).then(from, to, offsets[1]);
        let spec = Spec::connector("taper", self.wide.section.class, self.wide.section.speed);
        let half = self.wide.lane_half(Direction::Forward).into();
        b.strip(spec, &self.wide.taper_stations(from, to), &centre, &half, Direction::Forward)
    }

    fn ground(&self, b: &mut MapBuilder, first: &Road, last: &Road, cuts: [f64; 4]) {
        let [from, start, stop, to] = cuts;
        let road = &self.wide;
        let edge =
            |offset: &dyn Fn(&Road) -> f64| Profile::flat(offset(first)).then(start, stop, offset(last));
        let kerb = edge(&|r| r.kerb(Direction::Forward));
        let two_way = road.section.backward.is_some();
        let inner = 0.5 * road.section.median.width - road.section.median.shoulder;
        let left = road.kerb(Direction::Backward);
        if two_way && road.section.median.raised {
            road.band(b, &kerb, &Profile::flat(-inner), from, to, (true, true));
            road.slab(b, (inner, left), from, to, (true, true));
        } else {
            road.band(b, &kerb, &left.into(), from, to, (true, true));
        }
        let border = edge(&|r| r.lanes_edge(Direction::Forward));
        b.paint(2, road.line(Direction::Forward, border, from, to));
        // Lines of all lanes that continue; the line of the lane that ends stops at the taper.
        self.narrow.inner_lines(b, from, to);
        let extra = if std::ptr::eq(first, road) { (from, start) } else { (stop, to) };
        b.paint(
            1,
            road.line(Direction::Forward, self.narrow.lanes_edge(Direction::Forward), extra.0, extra.1),
        );
        if let Some(pavement) = road.section.forward.pavement {
            let middle = edge(&|r| r.pavement_offset(Direction::Forward));
            b.footway(road.line(Direction::Forward, middle, from, to), pavement.width);
        }
        if two_way {
            road.pavement(b, Direction::Backward, from, to);
        }
    }

    fn enter(&self, b: &mut MapBuilder, rng: &mut Stream, before: &RoadLanes, after: &RoadLanes) {
        enter(b, rng, &self.wide, before, Direction::Forward);
        enter(b, rng, &self.wide, after, Direction::Backward);
        self.wide.parking(b, rng, Direction::Backward, 3.0, self.wide.path.length() - 3.0);
    }
}

/// Draws a straight path, or a single large arc.
pub(super) fn gentle(rng: &mut Stream, length: f64, speed: f64) -> Path {
    if rng.chance(0.4) {
        return Path::straight(length);
    }
    let radius = smallest_radius(speed) * rng.uniform(2.0, 4.0);
    let angle = (0.7 * length / radius).min(0.7) * if rng.chance(0.5) { 1.0 } else { -1.0 };
    let bend = super::build::Piece::bend(angle, radius, 0.4);
    let rest = 0.5 * (length - bend.iter().map(|p| p.length).sum::<f64>()).max(40.0);
    let straight = [super::build::Piece::straight(rest)];
    Path::new(&[&straight[..], &bend[..], &straight[..]].concat())
}
