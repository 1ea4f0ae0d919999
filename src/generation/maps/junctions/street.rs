//! Streets between junctions and the border of the map: lanes, turn pockets, parking, pavements.

use crate::generation::Draw;
use crate::generation::maps::build::{LaneRef, MARGIN, MapBuilder, Pose, Profile, Road, Side, Spec, Way};
use crate::geometry::Vec2;
use crate::rollout::Stream;
use crate::scene::LaneClass;

/// What is at an end of a street.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum End {
    /// The border of the map.
    Border,
    /// A junction, with pockets (their lengths, metres) for those who turn left or right there.
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

/// A two-way street along a road, from end to end; straight near junctions.
#[derive(Clone, Debug)]
pub(super) struct Street {
    pub(super) name: String,
    pub(super) road: Road,
    /// Where its lanes begin and end along the path, metres.
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) ends: [End; 2],
    /// Vehicles per hour on each lane that comes from the border.
    pub(super) flow: f64,
}

/// A street as a junction sees it. Looking outwards from the junction, vehicles arrive on the left and leave on the right.
#[derive(Clone, Debug)]
pub(super) struct Port {
    /// Where the lanes end and begin on the middle of the street, looking outwards.
    pub(super) pose: Pose,
    /// Lanes that arrive, from the middle outwards, pockets among them.
    pub(super) approach: Vec<LaneRef>,
    pub(super) left_pocket: bool,
    pub(super) right_pocket: bool,
    /// Lanes that leave, from the middle outwards.
    pub(super) exits: Vec<LaneRef>,
    pub(super) bike_in: Option<LaneRef>,
    pub(super) bike_out: Option<LaneRef>,
    /// Ends of the pavements beside the arriving and the leaving lanes, and their distance from the kerb and width.
    pub(super) pavements: Option<[Vec2; 2]>,
    pub(super) verge: f64,
    pub(super) pavement_width: f64,
    pub(super) speed: f64,
    pub(super) shape: ArmShape,
}

/// Distances from the middle of a street at a junction, metres, all positive.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArmShape {
    /// Direction outwards, radians.
    pub(super) heading: f64,
    /// The kerb beside arriving vehicles, and beside leaving ones.
    pub(super) kerb_in: f64,
    pub(super) kerb_out: f64,
    /// Middle of the outermost lane that arrives, and of the one that leaves.
    pub(super) lane_in: f64,
    pub(super) lane_out: f64,
}

/// Length over which a pocket opens, metres.
pub(super) const TAPER: f64 = 22.0;
/// Lanes of pockets are so much narrower than others, metres.
const NARROWER: f64 = 0.2;
/// No parking so near to a junction, metres (daylighting: 20 to 30 feet before a crosswalk).
const NO_PARKING: f64 = 16.0;
/// Pavements of a street end so far from where its lanes end, metres: there the corner begins.
const PAVEMENT_GAP: f64 = 2.0;

/// The sign of offsets of the lanes of a direction.
pub(super) fn sign(way: Way) -> f64 {
    if way == Way::Forward { -1.0 } else { 1.0 }
}

/// The direction of those who arrive at an end.
fn arriving(end: usize) -> Way {
    if end == 0 { Way::Backward } else { Way::Forward }
}

fn leaving(end: usize) -> Way {
    arriving(1 - end)
}

impl Street {
    pub(super) fn side(&self, way: Way) -> &Side {
        match way {
            Way::Forward => &self.road.section.forward,
            Way::Backward => self.road.section.backward.as_ref().unwrap_or(&self.road.section.forward),
        }
    }

    pub(super) fn pocket_width(&self, way: Way) -> f64 {
        (self.side(way).lane_width - NARROWER).max(2.9)
    }

    /// Distance of the kerb from the middle, at an end where vehicles arrive.
    fn kerb_in(&self, end: usize) -> f64 {
        let way = arriving(end);
        let plain = self.road.kerb(way).abs();
        match self.ends[end].pockets().1 {
            Some(_) => plain.max(self.road.lanes_edge(way).abs() + self.pocket_width(way) + 0.6),
            None => plain,
        }
    }

    pub(super) fn shape(&self, end: usize) -> ArmShape {
        let (way, out) = (arriving(end), leaving(end));
        let at = self.road.path.at(if end == 0 { 0.0 } else { self.road.path.length() });
        let outermost = |way: Way| self.road.lane_offset(way, self.side(way).lanes - 1).abs();
        let right = self.ends[end].pockets().1.is_some();
        let pocket = self.road.lanes_edge(way).abs() + 0.5 * self.pocket_width(way);
        ArmShape {
            heading: if end == 0 { at.heading } else { Pose::from(at).reversed().heading },
            kerb_in: self.kerb_in(end),
            kerb_out: self.road.kerb(out).abs(),
            lane_in: if right { pocket } else { outermost(way) },
            lane_out: outermost(out),
        }
    }

    /// Lays the street; a port for each end at a junction.
    pub(super) fn lay(&self, b: &mut MapBuilder, rng: &mut Stream) -> [Option<Port>; 2] {
        let border = (self.ends[0] == End::Border, self.ends[1] == End::Border);
        self.road.surface(b, self.from, self.to, border);
        // Per direction: lanes where it arrives (pockets among them), lanes where it sets out.
        let forward = self.direction(b, rng, Way::Forward);
        let backward = self.direction(b, rng, Way::Backward);
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
                    [arriving(end), leaving(end)].map(|way| {
                        let s = if end == 0 { s + PAVEMENT_GAP } else { s - PAVEMENT_GAP };
                        self.road.path.at(s).aside(self.pavement_offset(way))
                    })
                }),
                verge: side.pavement.map_or(0.0, |p| p.verge),
                pavement_width: side.pavement.map_or(0.0, |p| p.width),
                speed: self.road.section.speed,
                shape: self.shape(end),
            })
        })
    }

    /// Offset of the middle of the pavement beside a direction: it keeps clear of a pocket all along.
    fn pavement_offset(&self, way: Way) -> f64 {
        let end = if way == Way::Backward { 0 } else { 1 };
        let pavement = self.side(way).pavement;
        sign(way) * (self.kerb_in(end) + pavement.map_or(0.0, |p| p.verge + 0.5 * p.width))
    }

    /// The lanes of a direction with what lies beside them.
    fn direction(&self, b: &mut MapBuilder, rng: &mut Stream, way: Way) -> Direction {
        let section = &self.road.section;
        let (arrival, side) = (usize::from(way == Way::Forward), *self.side(way));
        let (left, right) = self.ends[arrival].pockets();
        let letter = if way == Way::Forward { "f" } else { "b" };
        let id = |what: &str| format!("{}-{letter}-{what}", self.name);
        let lane = |what: &str| Spec::lane(id(what), section.class, section.speed);
        let half = Profile::flat(0.5 * side.lane_width);
        // The place so many metres before the junction at which this direction arrives.
        let before = |d: f64| if arrival == 0 { self.from + d } else { self.to - d };
        let between = |d: f64, e: f64| {
            let (p, q) = (before(d), before(e));
            self.road.stations(p.min(q), p.max(q))
        };
        let whole = self.to - self.from;
        let split = left.unwrap_or(0.0).max(right.unwrap_or(0.0)) + TAPER;
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
                    let centre = Profile::flat(self.road.lane_offset(way, i));
                    b.strip(lane(&format!("{name}{i}")), &stations, &centre, &half, way)
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
            let width = self.pocket_width(way);
            let (inner, outer) = (self.road.lane_offset(way, 0).abs(), self.road.lanes_edge(way).abs());
            let offset =
                if on_left { inner - 0.5 * side.lane_width - 0.5 * width } else { outer + 0.5 * width };
            let name = if on_left { "left" } else { "right" };
            let stations = between(0.0, length);
            let centre = Profile::flat(sign(way) * offset);
            let lane = b.strip(lane(name), &stations, &centre, &Profile::flat(0.5 * width), way);
            let (p, q) = (before(0.0), before(length));
            let edges =
                [sign(way) * (offset - 0.5 * width - MARGIN), sign(way) * (offset + 0.5 * width + 0.6)];
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
            let centre = Profile::flat(self.road.bike_offset(way));
            b.strip(spec, &between(0.0, whole), &centre, &Profile::flat(0.5 * width), way)
        });
        if self.ends[1 - arrival] == End::Border {
            starts.iter().for_each(|&l| b.entry(l, self.flow * rng.uniform(0.85, 1.15)));
            if let Some(bike) = bike {
                b.entry(bike, rng.uniform(15.0, 60.0));
            }
        }
        self.paint(b, way, split, (left.is_some(), right.is_some()));
        self.beside(b, rng, way, if left.or(right).is_some() { split } else { 0.0 });
        Direction { starts, ends, bike }
    }

    /// Parking and pavement beside a direction.
    fn beside(&self, b: &mut MapBuilder, rng: &mut Stream, way: Way, split: f64) {
        let arrival = usize::from(way == Way::Forward);
        let free = |end: usize| match self.ends[end] {
            End::Border => 4.0,
            End::Junction { .. } => NO_PARKING + if end == arrival { split } else { 0.0 },
        };
        self.road.parking(b, rng, way, self.from + free(0), self.to - free(1));
        let Some(pavement) = self.side(way).pavement else { return };
        let gap = |end: usize| if self.ends[end] == End::Border { 0.0 } else { PAVEMENT_GAP };
        let line = self.road.line(way, self.pavement_offset(way), self.from + gap(0), self.to - gap(1));
        b.footway(line, pavement.width);
    }
}

/// Says where vehicles may change between a pocket and the lane beside it: where both have points side by side.
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

/// The lanes of a direction: where they begin, and where they end.
struct Direction {
    starts: Vec<LaneRef>,
    ends: Vec<LaneRef>,
    bike: Option<LaneRef>,
}
