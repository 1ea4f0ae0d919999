//! The map as drivers see it: ways with their links, bends, lights and conflicts.

mod conflicts;

use std::collections::BTreeMap;

pub(super) use conflicts::{Conflict, Duty};

use super::super::{Layout, RightOfWay};
use crate::geometry::{Polyline, Vec2, direction, ring_distance, signed_angle_between, wrap};
use crate::scene::{LaneArea, LaneClass, LaneKind, LaneParts, NeighborParts};

/// Distance between two samples of a way's curvature, metres.
const SAMPLE: f64 = 2.0;
/// Ways that bend less than this everywhere are straight, 1/m.
const STRAIGHT: f64 = 0.002;
/// Half of what a vehicle and the room around it take across the way, metres: two that begin together share the way as far as that.
const TWIN_DISTANCE: f64 = 2.2;

/// A lane, in terms of traffic. Indices are those of the layout's lanes.
pub(super) struct Way {
    pub(super) line: Polyline,
    pub(super) length: f64,
    pub(super) half_width: f64,
    /// Speed limit, m/s.
    pub(super) limit: f64,
    pub(super) bicycles: bool,
    pub(super) connector: bool,
    pub(super) next: Vec<usize>,
    pub(super) before: Vec<usize>,
    pub(super) left: Vec<Beside>,
    pub(super) right: Vec<Beside>,
    /// Curvature every [`SAMPLE`] metres, 1/m, unsigned; empty for straight ways.
    bends: Vec<f64>,
    tightest: f64,
    /// Unit vector along its end.
    pub(super) end: Vec2,
    /// Index of the signal plan that controls it.
    pub(super) light: Option<usize>,
    /// How vehicles that enter give way.
    pub(super) rule: Option<RightOfWay>,
    /// Crossings of people: index of the footway, and the stretch of this way, metres.
    pub(super) crossings: Vec<(usize, [f64; 2])>,
    pub(super) conflicts: Vec<Conflict>,
    /// Ways that begin where this one does, and how far the two go together, metres.
    pub(super) twins: Vec<(usize, f64)>,
    /// Heading at the end less that at the beginning, radians.
    pub(super) turn: f64,
}

/// A way beside another, and which stretches of the two correspond, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beside {
    pub(super) way: usize,
    mine: [f64; 2],
    theirs: [f64; 2],
}

impl Beside {
    /// The place beside `s`, if the other way is there.
    pub(super) fn across(&self, s: f64) -> Option<f64> {
        let [a, b] = self.mine;
        let share = (s - a) / (b - a);
        (0.0..=1.0).contains(&share).then(|| self.theirs[0] + share * (self.theirs[1] - self.theirs[0]))
    }

    /// How far beyond `s` the other way is beside this one, metres.
    pub(super) fn remaining(&self, s: f64) -> f64 {
        self.mine[1] - s
    }
}

impl Way {
    /// Unsigned curvature near `s`, 1/m.
    pub(super) fn bend_at(&self, s: f64) -> f64 {
        if self.bends.is_empty() {
            return 0.0;
        }
        let i = (s / SAMPLE) as usize;
        self.bends[i.min(self.bends.len() - 1)]
    }

    /// Whether it has no bend worth slowing down for.
    pub(super) fn is_straight(&self) -> bool {
        self.bends.is_empty()
    }

    /// Largest unsigned curvature, 1/m.
    pub(super) fn tightest(&self) -> f64 {
        self.tightest
    }
}

/// All ways of a layout.
pub(super) struct Network {
    pub(super) ways: Vec<Way>,
    index: BTreeMap<String, usize>,
}

impl Network {
    /// Reads a layout. Lanes of fewer than two points do not occur in layouts that were validated.
    pub(super) fn new(layout: &Layout) -> Self {
        let index: BTreeMap<String, usize> =
            layout.map.lanes.iter().enumerate().map(|(i, l)| (l.id.clone(), i)).collect();
        let all = |ids: &[String]| ids.iter().filter_map(|id| index.get(id).copied()).collect::<Vec<_>>();
        let mut ways = Vec::with_capacity(layout.map.lanes.len());
        for lane in &layout.map.lanes {
            let line = Polyline::new(&lane.points).expect("a generated lane has two points");
            let bends = bends(&line);
            ways.push(Way {
                length: line.length(),
                half_width: half_width(lane, &line),
                limit: lane.speed_limit.unwrap_or(13.4),
                bicycles: lane.class == LaneClass::Bike,
                connector: lane.kind == LaneKind::Connector,
                next: all(&lane.successors),
                before: all(&lane.predecessors),
                left: Vec::new(),
                right: Vec::new(),
                tightest: bends.iter().copied().fold(0.0, f64::max),
                bends,
                end: direction(line.heading(line.segments() - 1)),
                light: layout.signals.iter().position(|s| s.lane == lane.id),
                rule: layout.priorities.iter().find(|p| p.lane == lane.id).map(|p| p.rule),
                crossings: Vec::new(),
                conflicts: Vec::new(),
                twins: Vec::new(),
                turn: wrap(line.heading(line.segments() - 1) - line.heading(0)),
                line,
            });
        }
        for (i, lane) in layout.map.lanes.iter().enumerate() {
            let beside = |list: &[NeighborParts]| -> Vec<Beside> {
                let same_use = |b: &Beside| ways[b.way].bicycles == ways[i].bicycles;
                list.iter()
                    .filter_map(|n| corresponding(&ways, i, *index.get(&n.lane)?, n))
                    .filter(same_use)
                    .collect()
            };
            let (left, right) = (beside(&lane.left), beside(&lane.right));
            (ways[i].left, ways[i].right) = (left, right);
        }
        let mut network = Self { ways, index };
        network.find_twins();
        network.find_crossings(layout);
        conflicts::find(&mut network, layout);
        network
    }

    /// The way of a lane's id.
    pub(super) fn find(&self, id: &str) -> Option<usize> {
        self.index.get(id).copied()
    }

    fn find_twins(&mut self) {
        for i in 0..self.ways.len() {
            let siblings: Vec<usize> =
                self.ways[i].before.iter().flat_map(|&b| &self.ways[b].next).copied().collect();
            let mut twins: Vec<(usize, f64)> = Vec::new();
            for j in siblings {
                if j == i || twins.iter().any(|t| t.0 == j) {
                    continue;
                }
                let (mine, theirs) = (&self.ways[i].line, &self.ways[j].line);
                let mut shared = 0.0;
                while shared < mine.length() && theirs.project(mine.at(shared)).distance < TWIN_DISTANCE {
                    shared += 1.0;
                }
                twins.push((j, shared));
            }
            self.ways[i].twins = twins;
        }
    }

    fn find_crossings(&mut self, layout: &Layout) {
        for (f, footway) in layout.footways.iter().enumerate().filter(|(_, f)| f.crossing) {
            for &i in footway.crosses.iter().filter_map(|id| self.index.get(id)) {
                let line = &self.ways[i].line;
                let reach = 0.5 * footway.width;
                let steps = (line.length() / 0.5) as usize;
                let on = |k: &usize| footway.line.project(line.at(*k as f64 * 0.5)).distance <= reach;
                let (first, last) = ((0..=steps).find(on), (0..=steps).rev().find(on));
                if let (Some(first), Some(last)) = (first, last) {
                    self.ways[i].crossings.push((f, [first as f64 * 0.5, last as f64 * 0.5]));
                }
            }
        }
        for way in &mut self.ways {
            way.crossings.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        }
    }

    /// The point at `s` of the first way of a path, or beyond it on the next ones.
    pub(super) fn ahead(&self, path: &[usize], s: f64) -> Vec2 {
        let mut left = s;
        for (k, &w) in path.iter().enumerate() {
            let way = &self.ways[w];
            if left <= way.length || k + 1 == path.len() {
                return way.line.at(left);
            }
            left -= way.length;
        }
        Vec2::zeros()
    }
}

/// Half of the lane's width: the distance of its outline from the middle of its centre line.
fn half_width(lane: &LaneParts, line: &Polyline) -> f64 {
    match &lane.area {
        LaneArea::Corridor { half_width } => *half_width,
        LaneArea::Polygon(ring) => ring_distance(line.at(0.5 * line.length()), ring).clamp(0.5, 3.0),
    }
}

fn bends(line: &Polyline) -> Vec<f64> {
    let n = (line.length() / SAMPLE) as usize + 1;
    let along = |s: f64| {
        let (a, b) = (line.at((s - 1.0).max(0.0)), line.at((s + 1.0).min(line.length())));
        b - a
    };
    let bends: Vec<f64> = (0..n)
        .map(|k| {
            let s = k as f64 * SAMPLE;
            let (a, b) = ((s - 2.0).max(0.0), (s + 2.0).min(line.length()));
            signed_angle_between(along(a), along(b)).abs() / (b - a).max(1.0)
        })
        .collect();
    if bends.iter().all(|b| *b < STRAIGHT) { Vec::new() } else { bends }
}

fn corresponding(ways: &[Way], mine: usize, theirs: usize, n: &NeighborParts) -> Option<Beside> {
    let at = |way: &Way, point: u32| way.line.arc().get(point as usize).copied().unwrap_or(way.length);
    let (a, b) = (&ways[mine], &ways[theirs]);
    let mine = [at(a, n.self_start), at(a, n.self_end)];
    (mine[1] - mine[0] > 1.0).then(|| Beside {
        way: theirs,
        mine,
        theirs: [at(b, n.other_start), at(b, n.other_end)],
    })
}
