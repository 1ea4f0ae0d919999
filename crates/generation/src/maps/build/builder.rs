//! The map under construction, and its conversion to a layout.

use reactsim_geometry::{Polyline, Vec2};
use reactsim_scene::{
    Crosswalk, LaneArea, LaneParts, LightState, MapParts, NeighborParts, RoadLine, StopKind, StopLineParts,
    Surface,
};

use super::connector::{Pose, connector};
use super::ground::{edges, on_grid, union};
use super::lanes::{Draft, LaneRef, Spec};
use super::ring::{cross, ribbon};
use super::{Direction, MARGIN, Profile, Station};
use crate::{Entry, Footway, Layout, ParkingSpot, Priority, RightOfWay, SignalPlan};

/// Builder that collects the parts of a map.
#[derive(Clone, Debug, Default)]
pub struct MapBuilder {
    lanes: Vec<Draft>,
    surfaces: Vec<Vec<Vec2>>,
    islands: Vec<Vec<Vec2>>,
    gates: Vec<(Vec2, Vec2)>,
    lines: Vec<RoadLine>,
    crosswalks: Vec<Crosswalk>,
    driveways: Vec<Surface>,
    intersections: Vec<Vec<Vec2>>,
    stops: Vec<(StopKind, usize, Vec2)>,
    signals: Vec<(usize, Vec<(LightState, f64)>)>,
    priorities: Vec<(usize, Vec<usize>, RightOfWay)>,
    entries: Vec<(usize, f64)>,
    parking: Vec<ParkingSpot>,
    footways: Vec<Walk>,
}

/// A footway under construction.
#[derive(Clone, Debug)]
struct Walk {
    points: Vec<Vec2>,
    width: f64,
    crossing: bool,
    crosses: Vec<usize>,
    waits_for: Vec<usize>,
}

impl MapBuilder {
    /// Creates an empty map.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a lane along stations of a path, with its centre and half its width given over the arc length.
    /// Lanes on the same stations have corresponding points.
    pub fn strip(
        &mut self,
        spec: Spec,
        stations: &[Station],
        centre: &Profile,
        half: &Profile,
        direction: Direction,
    ) -> LaneRef {
        self.push(Draft::along(spec, stations, centre, half, direction))
    }

    /// Adds a lane along arbitrary points (at least two, none repeated) with given directions at the ends.
    pub fn lane(&mut self, spec: Spec, points: Vec<Vec2>, half: f64, start: f64, end: f64) -> LaneRef {
        let (first, last) = (points[0], points[points.len() - 1]);
        self.push(Draft::free(spec, points, half, Pose::new(first, start), Pose::new(last, end)))
    }

    /// Adds a connector from the end of one lane to the start of another, linked with both, with ground
    /// under it. Also returns its smallest radius. Its half width is that of the narrower lane.
    pub fn connect(&mut self, spec: Spec, from: LaneRef, to: LaneRef) -> (LaneRef, f64) {
        let (start, end) = (self.lanes[from.0].end, self.lanes[to.0].start);
        let half = self.lanes[from.0].half.min(self.lanes[to.0].half);
        let (points, radius) = connector(start, end);
        self.surfaces.push(ribbon(&extended(&points), half + MARGIN + 0.1));
        let lane = self.push(Draft::free(spec, points, half, start, end));
        self.link(from, lane);
        self.link(lane, to);
        (lane, radius)
    }

    fn push(&mut self, draft: Draft) -> LaneRef {
        self.lanes.push(draft);
        LaneRef(self.lanes.len() - 1)
    }

    /// Declares that `to` begins where `from` ends.
    pub fn link(&mut self, from: LaneRef, to: LaneRef) {
        if !self.lanes[from.0].successors.contains(&to.0) {
            self.lanes[from.0].successors.push(to.0);
            self.lanes[to.0].predecessors.push(from.0);
        }
    }

    /// Declares that vehicles may change between two lanes of the same direction along their whole length;
    /// both have the same number of points.
    pub fn beside(&mut self, left: LaneRef, right: LaneRef) {
        let last = |l: LaneRef| self.lanes[l.0].points.len() as u32 - 1;
        let (a, b) = (last(left), last(right));
        self.beside_between(left, (0, a), right, (0, b));
    }

    /// Declares that vehicles may change between two lanes of the same direction between these points
    /// (first and last) of each.
    pub fn beside_between(&mut self, left: LaneRef, l: (u32, u32), right: LaneRef, r: (u32, u32)) {
        let parts = |me: (u32, u32), other: (u32, u32)| NeighborParts {
            lane: String::new(),
            self_start: me.0,
            self_end: me.1,
            other_start: other.0,
            other_end: other.1,
        };
        self.lanes[left.0].right.push((right.0, parts(l, r)));
        self.lanes[right.0].left.push((left.0, parts(r, l)));
    }

    /// Adds drivable ground: a ring of any orientation that does not cross itself.
    pub fn ground(&mut self, ring: Vec<Vec2>) {
        if ring.len() > 2 {
            self.surfaces.push(ring);
        }
    }

    /// Removes an island from the ground.
    pub fn island(&mut self, ring: Vec<Vec2>) {
        self.islands.push(ring);
    }

    /// Marks the end of a road at the border of the map, where there is no edge.
    pub fn gate(&mut self, a: Vec2, b: Vec2) {
        self.gates.push((a, b));
    }

    /// Adds a painted line (codes of [`RoadLine`]).
    pub fn paint(&mut self, paint: u8, points: Vec<Vec2>) {
        self.lines.push(RoadLine { paint, points });
    }

    /// Adds the outline of a junction.
    pub fn intersection(&mut self, ring: Vec<Vec2>) {
        self.intersections.push(ring);
    }

    /// Adds the outline of a driveway.
    pub fn driveway(&mut self, ring: Vec<Vec2>) {
        self.driveways.push(Surface { outline: ring });
    }

    /// Adds a stop line at the beginning of a lane.
    pub fn stop(&mut self, kind: StopKind, lane: LaneRef) {
        self.stops.push((kind, lane.0, self.lanes[lane.0].points[0]));
    }

    /// Adds the light of a lane, which begins at the stop line.
    pub fn signal(&mut self, lane: LaneRef, phases: Vec<(LightState, f64)>) {
        self.signals.push((lane.0, phases));
    }

    /// Declares that vehicles on `lane` yield to those on the other lanes.
    pub fn priority(&mut self, lane: LaneRef, to: &[LaneRef], rule: RightOfWay) {
        self.priorities.push((lane.0, to.iter().map(|l| l.0).collect(), rule));
    }

    /// Adds an entry on this lane, with `flow` vehicles per hour at density 1.
    pub fn entry(&mut self, lane: LaneRef, flow: f64) {
        self.entries.push((lane.0, flow));
    }

    /// Adds a place for a parked vehicle.
    pub fn park(&mut self, spot: ParkingSpot) {
        self.parking.push(spot);
    }

    /// Adds a pavement.
    pub fn footway(&mut self, points: Vec<Vec2>, width: f64) {
        self.walk(points, width, false, &[], &[]);
    }

    /// Adds a crossing of these lanes, with the controlled lanes for which people wait; its outline becomes
    /// a crosswalk of the map.
    pub fn crossing(&mut self, points: Vec<Vec2>, width: f64, crosses: &[LaneRef], waits_for: &[LaneRef]) {
        self.crosswalks.push(Crosswalk { outline: ribbon(&points, 0.5 * width) });
        self.walk(points, width, true, crosses, waits_for);
    }

    fn walk(
        &mut self,
        points: Vec<Vec2>,
        width: f64,
        crossing: bool,
        crosses: &[LaneRef],
        waits: &[LaneRef],
    ) {
        let ids = |l: &[LaneRef]| l.iter().map(|l| l.0).collect();
        self.footways.push(Walk { points, width, crossing, crosses: ids(crosses), waits_for: ids(waits) });
    }

    /// Returns the start pose of a lane.
    pub fn start(&self, lane: LaneRef) -> Pose {
        self.lanes[lane.0].start
    }

    /// Returns the end pose of a lane.
    pub fn end(&self, lane: LaneRef) -> Pose {
        self.lanes[lane.0].end
    }

    /// Returns the points of a lane.
    pub fn points(&self, lane: LaneRef) -> &[Vec2] {
        &self.lanes[lane.0].points
    }

    /// Returns half the width of a lane at its narrower end, metres.
    pub fn half_width(&self, lane: LaneRef) -> f64 {
        self.lanes[lane.0].half
    }

    /// Returns all lanes.
    pub fn lanes(&self) -> impl Iterator<Item = LaneRef> + use<> {
        (0..self.lanes.len()).map(LaneRef)
    }

    /// Returns the lanes whose centre lines cross a line.
    pub fn lanes_across(&self, line: &[Vec2]) -> Vec<LaneRef> {
        let meets = |a: Vec2, b: Vec2| line.windows(2).any(|w| cross(a, b, w[0], w[1]).is_some());
        let hit = |d: &Draft| d.points.windows(2).any(|w| meets(w[0], w[1]));
        self.lanes().filter(|l| hit(&self.lanes[l.0])).collect()
    }

    /// Converts the map to a layout: unites surfaces, cuts edges at the border, moves points to the grid,
    /// and links lanes by name.
    pub fn finish(mut self) -> Layout {
        let grid = |points: &[Vec2]| -> Vec<Vec2> { points.iter().copied().map(on_grid).collect() };
        let ground = union(&self.surfaces, &self.islands);
        let road_edges = edges(&ground, &self.gates);
        for lane in &mut self.lanes {
            lane.points = grid(&lane.points);
            lane.ring = grid(&lane.ring);
        }
        self.join_ends();
        let id = |l: usize| self.lanes[l].spec.id.clone();
        let ids = |l: &[usize]| -> Vec<String> { l.iter().map(|&l| id(l)).collect() };
        let named = |list: &[(usize, NeighborParts)]| -> Vec<NeighborParts> {
            list.iter().map(|(l, n)| NeighborParts { lane: id(*l), ..n.clone() }).collect()
        };
        let lanes = self.lanes.iter().map(|d| LaneParts {
            id: d.spec.id.clone(),
            kind: d.spec.kind,
            class: d.spec.class,
            speed_limit: Some(d.spec.speed),
            points: d.points.clone(),
            area: LaneArea::Polygon(d.ring.clone()),
            successors: ids(&d.successors),
            predecessors: ids(&d.predecessors),
            left: named(&d.left),
            right: named(&d.right),
        });
        let surface = |s: &Surface| Surface { outline: grid(&s.outline) };
        let map = MapParts {
            lanes: lanes.collect(),
            road_edges,
            road_lines: self
                .lines
                .iter()
                .map(|l| RoadLine { paint: l.paint, points: grid(&l.points) })
                .collect(),
            stop_lines: self
                .stops
                .iter()
                .map(|&(kind, lane, at)| StopLineParts { kind, lane: id(lane), at: on_grid(at) })
                .collect(),
            crosswalks: self.crosswalks.iter().map(|c| Crosswalk { outline: grid(&c.outline) }).collect(),
            driveways: self.driveways.iter().map(surface).collect(),
            intersections: self.intersections.iter().map(|r| grid(r)).collect(),
            drivable_area: Some(ground),
            ..MapParts::default()
        };
        let plan = |(lane, phases): &(usize, Vec<(LightState, f64)>)| SignalPlan {
            lane: id(*lane),
            stop_point: self.lanes[*lane].points[0],
            phases: phases.clone(),
        };
        let footway = |w: &Walk| {
            Some(Footway {
                line: Polyline::new(&grid(&w.points)).ok()?,
                heights: Vec::new(),
                width: w.width,
                crossing: w.crossing,
                crosses: ids(&w.crosses),
                waits_for: ids(&w.waits_for),
            })
        };
        Layout {
            map,
            signals: self.signals.iter().map(plan).collect(),
            priorities: self
                .priorities
                .iter()
                .map(|(lane, to, rule)| Priority { lane: id(*lane), to: ids(to), rule: *rule })
                .collect(),
            entries: self.entries.iter().map(|&(lane, flow)| Entry { lane: id(lane), flow }).collect(),
            yards: Vec::new(),
            parking: self
                .parking
                .iter()
                .map(|p| ParkingSpot { position: on_grid(p.position), ..*p })
                .collect(),
            footways: self.footways.iter().filter_map(footway).collect(),
        }
    }

    /// Makes linked lanes share their end points to the bit: values that differ in the last digits may have
    /// been rounded apart.
    fn join_ends(&mut self) {
        loop {
            let mut changed = false;
            for a in 0..self.lanes.len() {
                for k in 0..self.lanes[a].successors.len() {
                    let b = self.lanes[a].successors[k];
                    let last = self.lanes[a].points.len() - 1;
                    let (p, q) = (self.lanes[a].points[last], self.lanes[b].points[0]);
                    let near = (p - q).norm() < 0.01;
                    if p == q || !near {
                        continue;
                    }
                    // Take the smaller of the two in a fixed order, so that joints of several lanes agree
                    // in the end.
                    let low = if (p.x, p.y) < (q.x, q.y) { p } else { q };
                    self.lanes[a].points[last] = low;
                    self.lanes[b].points[0] = low;
                    changed = true;
                }
            }
            if !changed {
                return;
            }
        }
    }
}

/// Returns the line extended by 0.3 m at both ends, so that the surfaces of successive lanes overlap.
fn extended(points: &[Vec2]) -> Vec<Vec2> {
    let n = points.len();
    let mut out = points.to_vec();
    let (first, last) = (points[1] - points[0], points[n - 1] - points[n - 2]);
    out[0] -= first / first.norm() * 0.3;
    out[n - 1] += last / last.norm() * 0.3;
    out
}
