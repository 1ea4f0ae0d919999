//! The map as drivers see it: lanes with their links, curvatures, lights and conflicts.

mod conflicts;

use std::collections::BTreeMap;

pub(super) use conflicts::{Conflict, Duty};

use super::super::heights::height_at;
use super::super::{Layout, RightOfWay};
use reactsim_geometry::{Polyline, Vec2, direction, ring_distance, signed_angle_between, wrap};
use reactsim_scene::{LaneArea, LaneClass, LaneKind, LaneParts, NeighborParts};

/// Distance between two curvature samples of a lane, metres.
const CURVATURE_STEP: f64 = 2.0;
/// Curvature, 1/m, below which a lane counts as straight.
const STRAIGHT_CURVATURE: f64 = 0.002;
/// Half of the width that a vehicle and its clearance occupy, metres: lanes that begin together share the
/// road as long as they are closer than this.
const TWIN_DISTANCE: f64 = 2.2;

/// A lane with the properties that traffic needs. Indices are those of the layout's lanes.
pub(super) struct TrafficLane {
    pub(super) line: Polyline,
    /// Height at each point of the line, metres; empty on maps without heights.
    heights: Vec<f64>,
    pub(super) length: f64,
    pub(super) half_width: f64,
    /// Speed limit, m/s.
    pub(super) limit: f64,
    pub(super) bicycles: bool,
    pub(super) connector: bool,
    pub(super) next: Vec<usize>,
    pub(super) before: Vec<usize>,
    pub(super) left: Vec<AdjacentLane>,
    pub(super) right: Vec<AdjacentLane>,
    /// Unsigned curvature every [`CURVATURE_STEP`] metres, 1/m; empty for straight lanes.
    curvatures: Vec<f64>,
    /// The largest of them, 0 for straight lanes.
    pub(super) max_curvature: f64,
    /// Unit vector along the end of the lane.
    pub(super) end: Vec2,
    /// Index of the signal plan that controls the lane.
    pub(super) light: Option<usize>,
    /// Manner in which entering vehicles yield.
    pub(super) rule: Option<RightOfWay>,
    /// Pedestrian crossings: index of the footway, and the crossed stretch of this lane, metres.
    pub(super) crossings: Vec<(usize, [f64; 2])>,
    pub(super) conflicts: Vec<Conflict>,
    /// Lanes that begin where this one does, and the length that both share, metres.
    pub(super) twins: Vec<(usize, f64)>,
    /// Heading at the end minus heading at the beginning, radians.
    pub(super) turn: f64,
}

/// A lane next to another, and the corresponding stretches of both, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct AdjacentLane {
    pub(super) lane: usize,
    mine: [f64; 2],
    theirs: [f64; 2],
}

impl AdjacentLane {
    /// Returns the arc length on the other lane next to `s`, if the other lane exists there.
    pub(super) fn across(&self, s: f64) -> Option<f64> {
        let [a, b] = self.mine;
        let share = (s - a) / (b - a);
        (0.0..=1.0).contains(&share).then(|| self.theirs[0] + share * (self.theirs[1] - self.theirs[0]))
    }

    /// Returns how far beyond `s` the other lane continues next to this one, metres.
    pub(super) fn remaining(&self, s: f64) -> f64 {
        self.mine[1] - s
    }
}

impl TrafficLane {
    /// Returns the height at `s`, metres, if known.
    pub(super) fn height_at(&self, s: f64) -> Option<f64> {
        height_at(&self.line, &self.heights, s)
    }

    /// Returns the unsigned curvature near `s`, 1/m.
    pub(super) fn curvature_at(&self, s: f64) -> f64 {
        if self.curvatures.is_empty() {
            return 0.0;
        }
        let i = (s / CURVATURE_STEP) as usize;
        self.curvatures[i.min(self.curvatures.len() - 1)]
    }

    /// Whether the lane has no bend worth slowing down for.
    pub(super) fn is_straight(&self) -> bool {
        self.curvatures.is_empty()
    }
}

/// All lanes of a layout.
pub(super) struct Network {
    pub(super) lanes: Vec<TrafficLane>,
    index: BTreeMap<String, usize>,
}

impl Network {
    /// Builds the network of a layout. Validated layouts have no lanes with fewer than two points.
    pub(super) fn new(layout: &Layout) -> Self {
        let index: BTreeMap<String, usize> =
            layout.map.lanes.iter().enumerate().map(|(i, l)| (l.id.clone(), i)).collect();
        let all = |ids: &[String]| ids.iter().filter_map(|id| index.get(id).copied()).collect::<Vec<_>>();
        let mut lanes = Vec::with_capacity(layout.map.lanes.len());
        for (i, lane) in layout.map.lanes.iter().enumerate() {
            let line = Polyline::new(&lane.points).expect("a generated lane has two points");
            let curvatures = curvatures(&line);
            lanes.push(TrafficLane {
                heights: layout.map.heights.lanes.get(i).cloned().unwrap_or_default(),
                length: line.length(),
                half_width: half_width(lane, &line),
                limit: lane.speed_limit.unwrap_or(13.4),
                bicycles: lane.class == LaneClass::Bike,
                connector: lane.kind == LaneKind::Connector,
                next: all(&lane.successors),
                before: all(&lane.predecessors),
                left: Vec::new(),
                right: Vec::new(),
                max_curvature: curvatures.iter().copied().fold(0.0, f64::max),
                curvatures,
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
            let beside = |list: &[NeighborParts]| -> Vec<AdjacentLane> {
                let same_use = |b: &AdjacentLane| lanes[b.lane].bicycles == lanes[i].bicycles;
                list.iter()
                    .filter_map(|n| corresponding(&lanes, i, *index.get(&n.lane)?, n))
                    .filter(same_use)
                    .collect()
            };
            let (left, right) = (beside(&lane.left), beside(&lane.right));
            (lanes[i].left, lanes[i].right) = (left, right);
        }
        let mut network = Self { lanes, index };
        network.find_twins();
        network.find_crossings(layout);
        conflicts::find(&mut network, layout);
        network
    }

    pub(super) fn find(&self, id: &str) -> Option<usize> {
        self.index.get(id).copied()
    }

    fn find_twins(&mut self) {
        for i in 0..self.lanes.len() {
            let siblings: Vec<usize> =
                self.lanes[i].before.iter().flat_map(|&b| &self.lanes[b].next).copied().collect();
            let mut twins: Vec<(usize, f64)> = Vec::new();
            for j in siblings {
                if j == i || twins.iter().any(|t| t.0 == j) {
                    continue;
                }
                let (mine, theirs) = (&self.lanes[i].line, &self.lanes[j].line);
                let mut shared = 0.0;
                while shared < mine.length() && theirs.project(mine.at(shared)).distance < TWIN_DISTANCE {
                    shared += 1.0;
                }
                twins.push((j, shared));
            }
            self.lanes[i].twins = twins;
        }
    }

    fn find_crossings(&mut self, layout: &Layout) {
        for (f, footway) in layout.footways.iter().enumerate().filter(|(_, f)| f.crossing) {
            for &i in footway.crosses.iter().filter_map(|id| self.index.get(id)) {
                let line = &self.lanes[i].line;
                let reach = 0.5 * footway.width;
                let steps = (line.length() / 0.5) as usize;
                let on = |k: &usize| footway.line.project(line.at(*k as f64 * 0.5)).distance <= reach;
                let (first, last) = ((0..=steps).find(on), (0..=steps).rev().find(on));
                if let (Some(first), Some(last)) = (first, last) {
                    self.lanes[i].crossings.push((f, [first as f64 * 0.5, last as f64 * 0.5]));
                }
            }
        }
        for lane in &mut self.lanes {
            lane.crossings.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        }
    }

    /// Returns the point at `s` of the first lane of a path, or beyond it on the following lanes.
    pub(super) fn ahead(&self, path: &[usize], s: f64) -> Vec2 {
        let mut left = s;
        for (k, &i) in path.iter().enumerate() {
            let lane = &self.lanes[i];
            if left <= lane.length || k + 1 == path.len() {
                return lane.line.at(left);
            }
            left -= lane.length;
        }
        Vec2::zeros()
    }
}

/// Returns half of the lane's width: the distance of its outline from the middle of its centre line.
fn half_width(lane: &LaneParts, line: &Polyline) -> f64 {
    match &lane.area {
        LaneArea::Corridor { half_width } => *half_width,
        LaneArea::Polygon(ring) => ring_distance(line.at(0.5 * line.length()), ring).clamp(0.5, 3.0),
    }
}

fn curvatures(line: &Polyline) -> Vec<f64> {
    let n = (line.length() / CURVATURE_STEP) as usize + 1;
    let along = |s: f64| {
        let (a, b) = (line.at((s - 1.0).max(0.0)), line.at((s + 1.0).min(line.length())));
        b - a
    };
    let curvatures: Vec<f64> = (0..n)
        .map(|k| {
            let s = k as f64 * CURVATURE_STEP;
            let (a, b) = ((s - 2.0).max(0.0), (s + 2.0).min(line.length()));
            signed_angle_between(along(a), along(b)).abs() / (b - a).max(1.0)
        })
        .collect();
    if curvatures.iter().all(|b| *b < STRAIGHT_CURVATURE) { Vec::new() } else { curvatures }
}

fn corresponding(
    lanes: &[TrafficLane],
    mine: usize,
    theirs: usize,
    n: &NeighborParts,
) -> Option<AdjacentLane> {
    let at =
        |lane: &TrafficLane, point: u32| lane.line.arc().get(point as usize).copied().unwrap_or(lane.length);
    let (a, b) = (&lanes[mine], &lanes[theirs]);
    let mine = [at(a, n.self_start), at(a, n.self_end)];
    (mine[1] - mine[0] > 1.0).then(|| AdjacentLane {
        lane: theirs,
        mine,
        theirs: [at(b, n.other_start), at(b, n.other_end)],
    })
}
