//! The network of footways: stretches between nodes, and routes to the goals.

use reactsim_geometry::{Bounds, Polyline, Vec2, left};

use super::walker::Walker;
use crate::Layout;
use crate::heights::height_at;

/// Distance, metres, within which ends of footways are joined (see [`Layout::footways`]).
const JOIN_DISTANCE: f64 = 3.0;
/// Distance of a dead end from a lane's first or last point, metres, within which it is at the border of
/// the map; half of it for the distance from the map's bounds.
const BORDER_DISTANCE: f64 = 20.0;
/// Half of a walker's shoulder width, metres: walkers keep their centre this far from the edge of a
/// footway.
const SHOULDER_HALF_WIDTH: f64 = 0.25;
/// Cost of crossing a road, expressed as walking distance in metres: people avoid needless crossings.
const CROSSING_COST: f64 = 12.0;

/// A footway, or a part of one between two nodes.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    pub(super) line: Polyline,
    /// Height at each point of the line, metres; empty on maps without heights.
    heights: Vec<f64>,
    /// Unit vectors along the segments of the line.
    along: Vec<Vec2>,
    /// Maximum distance of a walker's centre from the line, metres.
    pub(super) half: f64,
    /// Index into the crossings, if the stretch is a crossing.
    pub(super) crossing: Option<usize>,
    /// Nodes at its beginning and end.
    pub(super) ends: [usize; 2],
}

impl Stretch {
    /// Returns the point at arc length `s`, `offset` metres to the left of the line, extrapolated straight
    /// beyond the ends. `near` is a segment close to it.
    pub(super) fn point(&self, s: f64, offset: f64, near: usize) -> Vec2 {
        let i = self.line.segment_from(s, near);
        self.line.on_segment(s, i) + left(self.along[i]) * offset
    }

    /// Returns the height at arc length `s`, metres, if known.
    pub(super) fn height_at(&self, s: f64) -> Option<f64> {
        height_at(&self.line, &self.heights, s)
    }

    /// Returns the unit vector along a segment.
    pub(super) fn along(&self, segment: usize) -> Vec2 {
        self.along[segment]
    }
}

/// All stretches, and the routes to all goals.
#[derive(Clone, Debug, Default)]
pub(super) struct Network {
    pub(super) stretches: Vec<Stretch>,
    /// Points where stretches meet or end.
    pub(super) nodes: Vec<Vec2>,
    /// Nodes at the border of the map, where people enter and leave.
    pub(super) exits: Vec<usize>,
    /// Nodes to which people walk: the exits, or all nodes if there are fewer than two exits.
    pub(super) goals: Vec<usize>,
    /// Per goal and node: the next stretch, if there is a route.
    next: Vec<Vec<Option<usize>>>,
    /// Footways that are crossings, in order.
    pub(super) crossings: Vec<usize>,
}

impl Network {
    pub(super) fn new(layout: &Layout) -> Self {
        let mut network = Self::default();
        for (line, heights, half, crossing) in pieces(layout, &mut network.crossings) {
            let along = (0..line.segments()).map(|i| {
                let (a, b) = line.segment(i);
                (b - a) / (b - a).norm()
            });
            let (along, ends) = (along.collect(), [line.at(0.0), line.at(line.length())]);
            let ends = ends.map(|p| network.node(p));
            network.stretches.push(Stretch { line, heights, along, half, crossing, ends });
        }
        let border = Border::new(layout);
        let degree = |n: usize| network.stretches.iter().filter(|s| s.ends.contains(&n)).count();
        network.exits = (0..network.nodes.len())
            .filter(|&n| degree(n) == 1 && network.at(n).is_some_and(|s| s.crossing.is_none()))
            .filter(|&n| border.near(network.nodes[n]))
            .collect();
        network.goals = match network.exits.len() {
            0 | 1 => (0..network.nodes.len()).collect(),
            _ => network.exits.clone(),
        };
        network.next = network.goals.iter().map(|&goal| network.next_stretches(goal)).collect();
        network
    }

    /// Returns the first stretch at a node.
    fn at(&self, node: usize) -> Option<&Stretch> {
        self.stretches.iter().find(|s| s.ends.contains(&node))
    }

    /// Returns the node at an end of a footway: an existing one nearby, or a new one.
    fn node(&mut self, p: Vec2) -> usize {
        let near = |n: &usize| (self.nodes[*n] - p).norm();
        let found = (0..self.nodes.len())
            .min_by(|a, b| near(a).total_cmp(&near(b)))
            .filter(|n| near(n) <= JOIN_DISTANCE);
        found.unwrap_or_else(|| {
            self.nodes.push(p);
            self.nodes.len() - 1
        })
    }

    /// Returns, per node, the next stretch towards `goal` (Bellman-Ford: networks are small).
    fn next_stretches(&self, goal: usize) -> Vec<Option<usize>> {
        let mut cost = vec![f64::INFINITY; self.nodes.len()];
        let mut next = vec![None; self.nodes.len()];
        cost[goal] = 0.0;
        loop {
            let mut changed = false;
            for (i, stretch) in self.stretches.iter().enumerate() {
                let own =
                    stretch.line.length() + if stretch.crossing.is_some() { CROSSING_COST } else { 0.0 };
                let [a, b] = stretch.ends;
                for (from, to) in [(a, b), (b, a)] {
                    if cost[to] + own < cost[from] {
                        cost[from] = cost[to] + own;
                        next[from] = Some(i);
                        changed = true;
                    }
                }
            }
            if !changed {
                return next;
            }
        }
    }

    /// Returns the remaining length of the stretch of a pedestrian, metres, and the node at its end.
    pub(super) fn ahead(&self, w: &Walker) -> (f64, usize) {
        let stretch = &self.stretches[w.stretch];
        let left = if w.forward { stretch.line.length() - w.s } else { w.s };
        (left, stretch.ends[usize::from(w.forward)])
    }

    /// Returns the next stretch from a node towards a goal (an index into the goals); `None` at the goal
    /// itself and without a route.
    pub(super) fn next(&self, goal: usize, node: usize) -> Option<usize> {
        self.next[goal][node]
    }

    /// Whether a route leads from `node` to a goal, or `node` is the goal.
    pub(super) fn leads(&self, goal: usize, node: usize) -> bool {
        self.goals[goal] == node || self.next(goal, node).is_some()
    }
}

/// Splits footways where a crossing begins or ends in their middle. Returns line, heights, half width
/// for walkers and crossing index of each piece, and fills the list of crossings.
fn pieces(layout: &Layout, crossings: &mut Vec<usize>) -> Vec<(Polyline, Vec<f64>, f64, Option<usize>)> {
    let ends = |line: &Polyline| [line.at(0.0), line.at(line.length())];
    let mut pieces = Vec::new();
    for (i, footway) in layout.footways.iter().enumerate() {
        let (line, half) = (&footway.line, (0.5 * footway.width - SHOULDER_HALF_WIDTH).max(0.1));
        if footway.crossing {
            crossings.push(i);
            pieces.push((line.clone(), footway.heights.clone(), half, Some(crossings.len() - 1)));
            continue;
        }
        let mut cuts: Vec<f64> = layout
            .footways
            .iter()
            .filter(|f| f.crossing)
            .flat_map(|f| ends(&f.line))
            .filter(|&p| ends(line).iter().all(|&e| (e - p).norm() > JOIN_DISTANCE))
            .map(|p| line.project(p))
            .filter(|at| at.distance <= JOIN_DISTANCE)
            .map(|at| at.s)
            .collect();
        cuts.sort_by(f64::total_cmp);
        cuts.dedup_by(|b, a| *b - *a < JOIN_DISTANCE);
        let bounds: Vec<f64> = [0.0].into_iter().chain(cuts).chain([line.length()]).collect();
        for part in bounds.windows(2) {
            let inner = line.points().iter().zip(line.arc());
            let inner =
                inner.filter(|(_, s)| **s > part[0] + 0.01 && **s < part[1] - 0.01).map(|(p, s)| (*p, *s));
            let end = |s: f64| [(line.at(s), s)].into_iter();
            let (points, arc): (Vec<Vec2>, Vec<f64>) = end(part[0]).chain(inner).chain(end(part[1])).unzip();
            if let Ok(piece) = Polyline::new(&points) {
                let heights = arc.iter().filter_map(|&s| height_at(line, &footway.heights, s)).collect();
                pieces.push((piece, heights, half, None));
            }
        }
    }
    pieces
}

/// Border of the map.
struct Border {
    ends: Vec<Vec2>,
    bounds: Bounds,
}

impl Border {
    fn new(layout: &Layout) -> Self {
        let lanes = &layout.map.lanes;
        let first = lanes.iter().filter(|l| l.predecessors.is_empty()).filter_map(|l| l.points.first());
        let last = lanes.iter().filter(|l| l.successors.is_empty()).filter_map(|l| l.points.last());
        let walks = layout.footways.iter().flat_map(|f| f.line.points());
        let bounds = Bounds::of(lanes.iter().flat_map(|l| &l.points).chain(walks).copied());
        Self { ends: first.chain(last).copied().collect(), bounds }
    }

    fn near(&self, p: Vec2) -> bool {
        let inside = (p - self.bounds.min).inf(&(self.bounds.max - p));
        inside.x.min(inside.y) < 0.5 * BORDER_DISTANCE
            || self.ends.iter().any(|e| (e - p).norm() < BORDER_DISTANCE)
    }
}
