//! Streets between junctions and the border of the map: lanes, turn pockets, parking, pavements.

use reactsim_geometry::Vec2;
use reactsim_rollout::Stream;
use reactsim_scene::LaneClass;

use crate::Draw;
use crate::maps::build::{Direction, LaneRef, MARGIN, MapBuilder, Pose, Profile, Road, Side, Spec};

/// An end of a street.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum End {
    /// The border of the map.
    Border,
    /// A junction, with the lengths in metres of the pockets for left and right turns.
    Junction { left: Option<f64>, right: Option<f64> },
}

impl End {
    /// A junction without pockets.
    pub(super) const PLAIN: Self = Self::Junction { left: None, right: None };

    fn pockets(self) -> (Option<f64>, Option<f64>) {
        match self {
            Self::Border => (None, None),
            Self::Junction { left, right } => (left, right),
        }
    }
}

/// A two-way street along a road, straight near junctions.
#[derive(Clone, Debug)]
pub(super) struct Street {
    pub(super) name: String,
    pub(super) road: Road,
    /// Arc length at which its lanes begin, metres.
    pub(super) from: f64,
    /// Arc length at which its lanes end, metres.
    pub(super) to: f64,
    pub(super) ends: [End; 2],
    /// Vehicles per hour on each lane that enters from the border.
    pub(super) flow: f64,
}

/// An end of a street at a junction. Seen outwards from the junction, vehicles arrive on the left and leave
/// on the right.
#[derive(Clone, Debug)]
pub(super) struct Port {
    /// End of the lanes on the centre line of the street, facing outwards.
    pub(super) pose: Pose,
    /// Arriving lanes, from the middle outwards, including pockets.
    pub(super) approach: Vec<LaneRef>,
    pub(super) left_pocket: bool,
    pub(super) right_pocket: bool,
    /// Leaving lanes, from the middle outwards.
    pub(super) exits: Vec<LaneRef>,
    pub(super) bike_in: Option<LaneRef>,
    pub(super) bike_out: Option<LaneRef>,
    /// Ends of the pavements next to the arriving and the leaving lanes.
    pub(super) pavements: Option<[Vec2; 2]>,
    /// Distance of the pavements from the kerb, metres.
    pub(super) verge: f64,
    /// Width of the pavements, metres.
    pub(super) pavement_width: f64,
    pub(super) speed: f64,
    pub(super) shape: ArmShape,
}

/// Distances from the centre line of a street at a junction, metres, all positive.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArmShape {
    /// Outward direction, radians.
    pub(super) heading: f64,
    /// Kerb next to arriving vehicles.
    pub(super) kerb_in: f64,
    /// Kerb next to leaving vehicles.
    pub(super) kerb_out: f64,
    /// Centre of the outermost arriving lane.
    pub(super) lane_in: f64,
    /// Centre of the outermost leaving lane.
    pub(super) lane_out: f64,
}

/// Length over which a pocket opens, metres.
pub(super) const POCKET_TAPER: f64 = 22.0;
/// Difference in width between ordinary lanes and pockets, metres.
const POCKET_NARROWING: f64 = 0.2;
/// Distance from a junction without parking, metres (daylighting: 20 to 30 feet before a crosswalk).
const PARKING_SETBACK: f64 = 16.0;
/// Distance between the end of a street's pavements and the end of its lanes, metres: there the corner
/// begins.
const PAVEMENT_GAP: f64 = 2.0;

/// Returns the direction in which vehicles arrive at an end.
fn arriving(end: usize) -> Direction {
    if end == 0 { Direction::Backward } else { Direction::Forward }
}

/// Returns the direction in which vehicles leave an end.
fn leaving(end: usize) -> Direction {
    arriving(1 - end)
}

impl Street {
    pub(super) fn side(&self, direction: Direction) -> &Side {
        self.road.side(direction).unwrap_or(&self.road.section.forward)
    }

    pub(super) fn pocket_width(&self, direction: Direction) -> f64 {
        (self.side(direction).lane_width - POCKET_NARROWING).max(2.9)
    }

    /// Returns the distance of the kerb from the centre line, at an end where vehicles arrive.
    fn kerb_in(&self, end: usize) -> f64 {
        let direction = arriving(end);
        let plain = self.road.kerb(direction).abs();
        match self.ends[end].pockets().1 {
            Some(_) => plain.max(self.road.lanes_edge(direction).abs() + self.pocket_width(direction) + 0.6),
            None => plain,
        }
    }

    pub(super) fn shape(&self, end: usize) -> ArmShape {
        let (direction, out) = (arriving(end), leaving(end));
        let at = self.road.path.at(if end == 0 { 0.0 } else { self.road.path.length() });
        let outermost =
            |direction: Direction| self.road.lane_offset(direction, self.side(direction).lanes - 1).abs();
        let right = self.ends[end].pockets().1.is_some();
        let pocket = self.road.lanes_edge(direction).abs() + 0.5 * self.pocket_width(direction);
        ArmShape {
            heading: if end == 0 { at.heading } else { Pose::from(at).reversed().heading },
            kerb_in: self.kerb_in(end),
            kerb_out: self.road.kerb(out).abs(),
            lane_in: if right { pocket } else { outermost(direction) },
            lane_out: outermost(out),
        }
    }

    /// Lays the street; returns a port for each end at a junction.
    pub(super) fn lay(&self, b: &mut MapBuilder, rng: &mut Stream) -> [Option<Port>; 2] {
        let border = (self.ends[0] == End::Border, self.ends[1] == End::Border);
        self.road.surface(b, self.from, self.to, border);
        // Per direction: the lanes where it begins, and where it arrives (including pockets).
        let forward = self.lay_direction(b, rng, Direction::Forward);
        let backward = self.lay_direction(b, rng, Direction::Backward);
        [0, 1].map(|end| {
            if self.ends[end] == End::Border {
                return None;
            }
            let (arrives, leaves) = if end == 0 { (&backward, &forward) } else { (&forward, &backward) };
            let s = if end == 0 { self.from } else { self.to };
            let at = Pose::from(self.road.path.at(s));
            let (left, right) = self.ends[end].pockets();
            let side = self.side(arriving(end));
            Some(Port {
                pose: if end == 0 { at } else { at.reversed() },
                approach: arrives.ends.clone(),
                left_pocket: left.is_some(),
                right_pocket: right.is_some(),
                exits: leaves.starts.clone(),
                bike_in: arrives.bike,
                bike_out: leaves.bike,
                pavements: side.pavement.map(|_| {
                    [arriving(end), leaving(end)].map(|direction| {
                        let s = if end == 0 { s + PAVEMENT_GAP } else { s - PAVEMENT_GAP };
                        self.road.path.at(s).aside(self.pavement_offset(direction))
                    })
                }),
                verge: side.pavement.map_or(0.0, |p| p.verge),
                pavement_width: side.pavement.map_or(0.0, |p| p.width),
                speed: self.road.section.speed,
                shape: self.shape(end),
            })
        })
    }

    /// Returns the offset of the centre of the pavement along a direction: it keeps clear of a pocket over
    /// its whole length.
    fn pavement_offset(&self, direction: Direction) -> f64 {
        let end = if direction == Direction::Backward { 0 } else { 1 };
        let pavement = self.side(direction).pavement;
        direction.sign() * (self.kerb_in(end) + pavement.map_or(0.0, |p| p.verge + 0.5 * p.width))
    }

    /// Lays the lanes of a direction, with parking and pavement next to them.
    fn lay_direction(&self, b: &mut MapBuilder, rng: &mut Stream, direction: Direction) -> DirectionLanes {
        let section = &self.road.section;
        let (arrival, side) = (usize::from(direction == Direction::Forward), *self.side(direction));
        let (left, right) = self.ends[arrival].pockets();
        let letter = if direction == Direction::Forward { "f" } else { "b" };
        let id = |what: &str| format!("{}-{letter}-{what}", self.name);
        let lane = |what: &str| Spec::lane(id(what), section.class, section.speed);
        let half = Profile::flat(0.5 * side.lane_width);
        // Arc length at a distance before the junction at which this direction arrives.
        let before = |d: f64| if arrival == 0 { self.from + d } else { self.to - d };
        let between = |d: f64, e: f64| {
            let (p, q) = (before(d), before(e));
            self.road.stations(p.min(q), p.max(q))
        };
        let whole = self.to - self.from;
        let split = left.unwrap_or(0.0).max(right.unwrap_or(0.0)) + POCKET_TAPER;
        let stretches: &[(f64, f64, &str)] = if left.or(right).is_some() {
            &[(split, whole, "far"), (0.0, split, "near")]
        } else {
            &[(0.0, whole, "lane")]
        };
        let mut rows: Vec<Vec<LaneRef>> = Vec::new();
        for &(d, e, name) in stretches {
            let stations = between(d, e);
            let row: Vec<LaneRef> = (0..side.lanes)
                .map(|i| {
                    let centre = Profile::flat(self.road.lane_offset(direction, i));
                    b.strip(lane(&format!("{name}{i}")), &stations, &centre, &half, direction)
                })
                .collect();
            row.windows(2).for_each(|w| b.beside(w[0], w[1]));
            if let Some(last) = rows.last() {
                last.iter().zip(&row).for_each(|(&from, &to)| b.link(from, to));
            }
            rows.push(row);
        }
        let (starts, near) = (rows[0].clone(), rows[rows.len() - 1].clone());
        let mut ends = near.clone();
        for (pocket, on_left) in [(left, true), (right, false)] {
            let Some(length) = pocket else { continue };
            let width = self.pocket_width(direction);
            let (inner, outer) =
                (self.road.lane_offset(direction, 0).abs(), self.road.lanes_edge(direction).abs());
            let offset =
                if on_left { inner - 0.5 * side.lane_width - 0.5 * width } else { outer + 0.5 * width };
            let name = if on_left { "left" } else { "right" };
            let stations = between(0.0, length);
            let centre = Profile::flat(direction.sign() * offset);
            let lane = b.strip(lane(name), &stations, &centre, &Profile::flat(0.5 * width), direction);
            let (p, q) = (before(0.0), before(length));
            let edges = [
                direction.sign() * (offset - 0.5 * width - MARGIN),
                direction.sign() * (offset + 0.5 * width + 0.6),
            ];
            let slab = (edges[0].min(edges[1]), edges[0].max(edges[1]));
            self.road.slab(b, slab, p.min(q), p.max(q), (false, false));
            let from = if on_left { starts[0] } else { starts[side.lanes - 1] };
            let opening = Spec::connector(id(&format!("{name}-taper")), section.class, section.speed);
            b.connect(opening, from, lane);
            let next = if on_left { near[0] } else { near[side.lanes - 1] };
            pocket_beside(b, lane, next, on_left);
            if on_left {
                ends.insert(0, lane);
            } else {
                ends.push(lane);
            }
        }
        let bike = side.bike.map(|width| {
            let spec = Spec::lane(id("bike"), LaneClass::Bike, 7.0);
            let centre = Profile::flat(self.road.bike_offset(direction));
            b.strip(spec, &between(0.0, whole), &centre, &Profile::flat(0.5 * width), direction)
        });
        if self.ends[1 - arrival] == End::Border {
            starts.iter().for_each(|&l| b.entry(l, self.flow * rng.uniform(0.85, 1.15)));
            if let Some(bike) = bike {
                b.entry(bike, rng.uniform(15.0, 60.0));
            }
        }
        self.paint(b, direction, split, (left.is_some(), right.is_some()));
        self.beside(b, rng, direction, if left.or(right).is_some() { split } else { 0.0 });
        DirectionLanes { starts, ends, bike }
    }

    /// Adds parking and pavement along a direction.
    fn beside(&self, b: &mut MapBuilder, rng: &mut Stream, direction: Direction, split: f64) {
        let arrival = usize::from(direction == Direction::Forward);
        let free = |end: usize| match self.ends[end] {
            End::Border => 4.0,
            End::Junction { .. } => PARKING_SETBACK + if end == arrival { split } else { 0.0 },
        };
        self.road.parking(b, rng, direction, self.from + free(0), self.to - free(1));
        let Some(pavement) = self.side(direction).pavement else { return };
        let gap = |end: usize| if self.ends[end] == End::Border { 0.0 } else { PAVEMENT_GAP };
        let line =
            self.road.line(direction, self.pavement_offset(direction), self.from + gap(0), self.to - gap(1));
        b.footway(line, pavement.width);
    }
}

/// Declares where vehicles may change between a pocket and the adjacent lane: where both have points side
/// by side.
fn pocket_beside(b: &mut MapBuilder, pocket: LaneRef, next: LaneRef, on_left: bool) {
    let (own, its) = (b.points(pocket).len() as u32, b.points(next).len() as u32);
    let first = b.points(pocket)[0];
    let nearest = (0..its).min_by(|&i, &j| {
        let d = |k: u32| (b.points(next)[k as usize] - first).norm_squared();
        d(i).total_cmp(&d(j))
    });
    let from = nearest.unwrap_or(0).min(its - 2);
    let (mine, other) = ((0, own - 1), (from, its - 1));
    if on_left {
        b.beside_between(pocket, mine, next, other);
    } else {
        b.beside_between(next, other, pocket, mine);
    }
}

/// The lanes of a direction, at its beginning and at its end.
struct DirectionLanes {
    starts: Vec<LaneRef>,
    ends: Vec<LaneRef>,
    bike: Option<LaneRef>,
}
