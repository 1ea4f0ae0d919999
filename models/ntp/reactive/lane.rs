//! Where an agent is going: its own course, and where its lane leads.

use reactsim::geometry::{Bounds, Vec2, into_frame, math};

use super::super::tokens::Class;
use super::place::Role;
use super::places::Places;

/// Numbers that describe the lane of an agent and where it leads.
pub(crate) const LANE: usize = OWN + WAYS * POINTS * 3;
/// Of these, numbers of the lane beside the agent.
const OWN: usize = 6;
/// Ways on: the leftmost, the straightest, the rightmost.
pub(crate) const WAYS: usize = 3;
/// Points of a way.
const POINTS: usize = 3;
/// A lane piece whose middle is farther away is not looked at, metres.
const REACH: f64 = 6.0;
/// Nobody follows a lane farther aside, metres.
const ASIDE: f64 = 4.0;
/// What a radian between heading and lane counts against metres aside.
const TURN_COST: f64 = 3.0;
/// Pieces that a way is followed over at most.
const MOST_PIECES: usize = 60;

/// Which pieces of lanes follow which.
#[derive(Clone, Debug, Default)]
pub(crate) struct LaneGraph {
    /// Per place the places that follow, and the direction in which the lane of each ends.
    next: Vec<Vec<(usize, Vec2)>>,
}

impl LaneGraph {
    /// `lanes` are the lanes of the places, `None` where they are none; `successors` those of each lane.
    pub(crate) fn of(lanes: &[Option<usize>], aheads: &[Vec2], successors: &[Vec<usize>]) -> Self {
        let mut first = vec![None; successors.len()];
        let mut last = vec![None; successors.len()];
        for (place, lane) in lanes.iter().enumerate() {
            if let Some(lane) = *lane {
                first[lane].get_or_insert(place);
                last[lane] = Some(place);
            }
        }
        let end = |lane: usize| last[lane].map_or(Vec2::x(), |p: usize| aheads[p]);
        let follow = |(place, lane): (usize, &Option<usize>)| match *lane {
            // Pieces of a lane that lie within reach are neighbours in the list.
            Some(lane) if lanes.get(place + 1) == Some(&Some(lane)) => vec![(place + 1, end(lane))],
            Some(lane) => successors[lane].iter().filter_map(|&s| first[s].map(|p| (p, end(s)))).collect(),
            None => Vec::new(),
        };
        Self { next: lanes.iter().enumerate().map(follow).collect() }
    }
}

/// An agent, as its ways are looked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Driver {
    /// Box centre.
    pub position: Vec2,
    /// Unit vector of the heading.
    pub ahead: Vec2,
    /// m/s.
    pub speed: f64,
    /// Class.
    pub class: Class,
    /// Unit vector of the motion; of the heading where it stands.
    pub course: Vec2,
    /// Curvature of the motion of late, 1/m; left is positive.
    pub curvature: f64,
}

/// A way on: points every [`SPACING`] metres and the direction there.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Way {
    /// Where, and the direction there.
    pub points: Vec<(Vec2, Vec2)>,
    /// Around all of them.
    pub bounds: Bounds,
}

impl Way {
    fn new(points: Vec<(Vec2, Vec2)>) -> Self {
        let bounds = Bounds::of(points.iter().map(|p| p.0));
        Self { points, bounds }
    }
}

/// Distance of the points of a way, metres.
pub(crate) const SPACING: f64 = 2.5;
/// Ways are this long at least and at most, metres.
const LENGTHS: (f64, f64) = (12.0, 70.0);
/// They grow with so many seconds of speed.
const FORESIGHT: f64 = 4.0;
/// Nobody is taken to turn further than this on its course, radians.
const MOST_TURN: f64 = 1.6;

/// How far ahead the ways of an agent are looked at, in points.
fn points_ahead(speed: f64) -> usize {
    ((LENGTHS.0 + FORESIGHT * speed).min(LENGTHS.1) / SPACING) as usize
}

/// The way that an agent takes if it goes on as it does: what is there counts wherever lanes lead.
pub(crate) fn course(me: &Driver) -> Way {
    let turn = |s: f64| (me.curvature * s).clamp(-MOST_TURN, MOST_TURN);
    let mut at = me.position;
    let mut points = Vec::new();
    for i in 0..=points_ahead(me.speed) {
        let s = i as f64 * SPACING;
        points.push((at, rotated(me.course, turn(s))));
        at += rotated(me.course, turn(s + 0.5 * SPACING)) * SPACING;
    }
    Way::new(points)
}

/// `v` turned to the left by `angle` radians.
fn rotated(v: Vec2, angle: f64) -> Vec2 {
    let (sin, cos) = math::sin_cos(angle);
    Vec2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos)
}

/// Fills in how far aside of its lane an agent is and how it is turned, its speed as part of the limit, and points of the ways on, in its frame: about 0.5, 1 and 2 s
/// ahead. Returns the ways. Zeros and none for people on foot and where there is no lane.
pub(crate) fn describe(me: &Driver, places: &Places, out: &mut [f32]) -> Vec<Way> {
    if me.class == Class::Pedestrian {
        return Vec::new();
    }
    let Some((piece, point, along)) = own_lane(me.position, me.ahead, places) else { return Vec::new() };
    let local = into_frame(me.ahead, along);
    let aside = into_frame(along, me.position - point).y;
    out[0] = 1.0;
    out[1] = aside.clamp(-3.0, 3.0) as f32;
    out[2] = (aside / 3.0).clamp(-2.0, 2.0) as f32;
    out[3] = (local.y * 5.0).clamp(-3.0, 3.0) as f32;
    if let Some(limit) = places.all[piece].speed_limit.filter(|l| *l > 1.0) {
        out[4] = 1.0;
        out[5] = (me.speed / limit).min(2.0) as f32;
    }
    let v = me.speed;
    let distances = [3.0 + 0.5 * v, 6.0 + v, 10.0 + 2.0 * v];
    let scales = [1.0, 3.0, 10.0];
    for (way, choice) in CHOICES.iter().enumerate() {
        let mut walk = Walk::begin(places, piece, point, along);
        for (k, (d, scale)) in distances.iter().zip(scales).enumerate() {
            let (at, heading) = walk.to(*d, me.ahead, choice);
            let at = into_frame(me.ahead, at - me.position);
            let heading = into_frame(me.ahead, heading);
            let slot = &mut out[OWN + (way * POINTS + k) * 3..][..3];
            slot[0] = ((at.x - d) / scale).clamp(-5.0, 5.0) as f32;
            slot[1] = (at.y / scale).clamp(-5.0, 5.0) as f32;
            slot[2] = (heading.y * 3.0) as f32;
        }
    }
    let walk = Walk::begin(places, piece, point, along);
    walk.ways(me.ahead, points_ahead(v)).into()
}

/// The ways on from the lane of someone at `position` who looks along `ahead`, with so many points after the first; none where there is
/// no lane. Beyond the end of the map they go straight on.
pub(crate) fn ways(position: Vec2, ahead: Vec2, places: &Places, points: usize) -> Vec<Way> {
    let found = own_lane(position, ahead, places);
    found.map_or_else(Vec::new, |(piece, point, along)| {
        Walk::begin(places, piece, point, along).ways(ahead, points).into()
    })
}

/// The piece that an agent follows: near, and not across; with the nearest point on it and its direction there.
fn own_lane(position: Vec2, ahead: Vec2, places: &Places) -> Option<(usize, Vec2, Vec2)> {
    let mut best: Option<(f64, usize, Vec2, Vec2)> = None;
    for (i, place) in places.all.iter().enumerate() {
        if place.role != Role::Lane || (place.middle - position).norm_squared() > REACH * REACH {
            continue;
        }
        let (point, along) = place.nearest(position);
        let aside = (point - position).norm();
        let turned = 1.0 - along.dot(&ahead);
        if aside > ASIDE || turned > 0.6 {
            continue;
        }
        let cost = aside + TURN_COST * (2.0 * turned).sqrt();
        // Pieces meet where one ends: the earlier one of equal costs.
        if best.is_none_or(|b| cost < b.0 - 1e-6) {
            best = Some((cost, i, point, along));
        }
    }
    best.map(|(_, i, point, along)| (i, point, along))
}

/// What the turn of a way costs that leads most to the left, straight on, most to the right: the least is taken.
const CHOICES: [fn(f64) -> f64; WAYS] = [|turn| -turn, f64::abs, |turn| turn];

/// Following pieces from a point on.
#[derive(Clone)]
struct Walk<'a> {
    places: &'a Places,
    piece: usize,
    from: Vec2,
    heading: Vec2,
    /// Metres so far.
    gone: f64,
    left: usize,
}

impl<'a> Walk<'a> {
    fn begin(places: &'a Places, piece: usize, from: Vec2, heading: Vec2) -> Self {
        Self { places, piece, from, heading, gone: 0.0, left: MOST_PIECES }
    }

    /// The three ways on, with so many points after the first.
    fn ways(&self, ahead: Vec2, points: usize) -> [Way; WAYS] {
        CHOICES.map(|choice| {
            let mut walk = self.clone();
            Way::new((0..=points).map(|i| walk.to(i as f64 * SPACING, ahead, &choice)).collect())
        })
    }

    /// The point after `distance` metres in all and the direction there; beyond the end of the map it goes straight on. Among what follows,
    /// the one whose lane ends with the least `cost` of its turn against `ahead` is taken.
    fn to(&mut self, distance: f64, ahead: Vec2, cost: &fn(f64) -> f64) -> (Vec2, Vec2) {
        loop {
            let end = self.places.all[self.piece].end();
            let way = end - self.from;
            let length = way.norm();
            if self.gone + length >= distance {
                let heading = if length > 1e-6 { way / length } else { self.heading };
                return (self.from + heading * (distance - self.gone), heading);
            }
            if length > 1e-6 {
                self.heading = way / length;
            }
            let turn = |to: Vec2| {
                let local = into_frame(ahead, to);
                math::atan2(local.y, local.x)
            };
            let next = &self.places.graph.next[self.piece];
            let chosen = next.iter().min_by(|a, b| cost(turn(a.1)).total_cmp(&cost(turn(b.1))));
            let Some(&(piece, _)) = chosen.filter(|_| self.left > 0) else {
                return (end + self.heading * (distance - self.gone - length), self.heading);
            };
            self.left -= 1;
            self.gone += length;
            self.from = end;
            self.piece = piece;
        }
    }
}
