//! The network of footways: stretches between nodes, and which way leads where.

use crate::generation::Layout;
use crate::geometry::{Polyline, Vec2, left};

/// Ends of footways this near are joined, metres (see [`Layout::footways`]).
const JOIN: f64 = 3.0;
/// A dead end so near to where a lane begins or ends lies at the border of the map, metres; so does one as near to the map's bounds.
const BORDER: f64 = 20.0;
/// Half of a walker's shoulders: walkers keep their middle this far from the edge of a footway, metres.
const SHOULDER: f64 = 0.25;
/// What having to cross a road is worth in metres of way: people avoid needless crossings.
const CROSSING_COST: f64 = 12.0;

/// A footway, or a part of one between two nodes.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    pub(super) line: Polyline,
    /// Unit vectors along the segments of the line.
    along: Vec<Vec2>,
    /// How far the middle of a walker may be from the line, metres.
    pub(super) half: f64,
    /// Index into the crossings, if it is one.
    pub(super) crossing: Option<usize>,
    /// Nodes at its beginning and at its end.
    pub(super) ends: [usize; 2],
}

impl Stretch {
    /// The point after `s` metres, `offset` to the left of the line; beyond the ends it goes on straight. `near` is a segment close to it.
    pub(super) fn point(&self, s: f64, offset: f64, near: usize) -> Vec2 {
        let i = self.line.segment_from(s, near);
        self.line.on_segment(s, i) + left(self.along[i]) * offset
    }

    /// Unit vector along a segment.
    pub(super) fn along(&self, segment: usize) -> Vec2 {
        self.along[segment]
    }
}

/// All stretches, and the way to each place where people leave.
#[derive(Clone, Debug, Default)]
pub(super) struct Network {
    pub(super) stretches: Vec<Stretch>,
    /// Where stretches meet or end.
    pub(super) nodes: Vec<Vec2>,
    /// Nodes at the border of the map: people come and leave there.
    pub(super) exits: Vec<usize>,
    /// Nodes to which people walk: the exits, or all where there are fewer than two.
    pub(super) goals: Vec<usize>,
    /// Per goal and node the stretch to take next, if there is a way.
    next: Vec<Vec<Option<usize>>>,
    /// Footways that are crossings, in order.
    pub(super) crossings: Vec<usize>,
}

impl Network {
    pub(super) fn new(layout: &Layout) -> Self {
        let mut network = Self::default();
        for (line, half, crossing) in pieces(layout, &mut network.crossings) {
            let along = (0..line.segments()).map(|i| {
                let (a, b) = line.segment(i);
                (b - a) / (b - a).norm()
            });
            let (along, ends) = (along.collect(), [line.at(0.0), line.at(line.length())]);
            let ends = ends.map(|p| network.node(p));
            network.stretches.push(Stretch { line, along, half, crossing, ends });
        }
        let border = Border::new(layout);
        let ways = |n: usize| network.stretches.iter().filter(|s| s.ends.contains(&n)).count();
        network.exits = (0..network.nodes.len())
            .filter(|&n| ways(n) == 1 && network.at(n).is_some_and(|s| s.crossing.is_none()))
            .filter(|&n| border.near(network.nodes[n]))
            .collect();
        network.goals = match network.exits.len() {
            0 | 1 => (0..network.nodes.len()).collect(),
            _ => network.exits.clone(),
        };
        network.next = network.goals.iter().map(|&goal| network.ways_to(goal)).collect();
        network
    }

    /// The first stretch at a node.
    fn at(&self, node: usize) -> Option<&Stretch> {
        self.stretches.iter().find(|s| s.ends.contains(&node))
    }

    /// The node at an end of a footway: one that is near already, or a new one.
    fn node(&mut self, p: Vec2) -> usize {
        let near = |n: &usize| (self.nodes[*n] - p).norm();
        let found =
            (0..self.nodes.len()).min_by(|a, b| near(a).total_cmp(&near(b))).filter(|n| near(n) <= JOIN);
        found.unwrap_or_else(|| {
            self.nodes.push(p);
            self.nodes.len() - 1
        })
    }

    /// Per node the stretch to take towards `goal` (Bellman and Ford: networks are small).
    fn ways_to(&self, goal: usize) -> Vec<Option<usize>> {
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

    /// The stretch to take from a node towards a goal (an index into the goals); `None` at the goal itself and where there is no way.
    pub(super) fn next(&self, goal: usize, node: usize) -> Option<usize> {
        self.next[goal][node]
    }

    /// Whether a node is a place to which people walk from elsewhere, seen from `node`.
    pub(super) fn leads(&self, goal: usize, node: usize) -> bool {
        self.goals[goal] == node || self.next(goal, node).is_some()
    }
}

/// Footways cut where a crossing begins or ends in their middle: line, room, and which crossing it is. Fills the list of crossings.
fn pieces(layout: &Layout, crossings: &mut Vec<usize>) -> Vec<(Polyline, f64, Option<usize>)> {
    let ends = |line: &Polyline| [line.at(0.0), line.at(line.length())];
    let mut pieces = Vec::new();
    for (i, footway) in layout.footways.iter().enumerate() {
        let (line, half) = (&footway.line, (0.5 * footway.width - SHOULDER).max(0.1));
        if footway.crossing {
            crossings.push(i);
            pieces.push((line.clone(), half, Some(crossings.len() - 1)));
            continue;
        }
        let mut cuts: Vec<f64> = layout
            .footways
            .iter()
            .filter(|f| f.crossing)
            .flat_map(|f| ends(&f.line))
            .filter(|&p| ends(line).iter().all(|&e| (e - p).norm() > JOIN))
            .map(|p| line.project(p))
            .filter(|at| at.distance <= JOIN)
            .map(|at| at.s)
            .collect();
        cuts.sort_by(f64::total_cmp);
        cuts.dedup_by(|b, a| *b - *a < JOIN);
        let bounds: Vec<f64> = [0.0].into_iter().chain(cuts).chain([line.length()]).collect();
        for part in bounds.windows(2) {
            let inner = line.points().iter().zip(line.arc());
            let inner = inner.filter(|(_, s)| **s > part[0] + 0.01 && **s < part[1] - 0.01).map(|(p, _)| *p);
            let points: Vec<Vec2> =
                [line.at(part[0])].into_iter().chain(inner).chain([line.at(part[1])]).collect();
            if let Ok(piece) = Polyline::new(&points) {
                pieces.push((piece, half, None));
            }
        }
    }
    pieces
}

/// Where the map ends.
struct Border {
    ends: Vec<Vec2>,
    low: Vec2,
    high: Vec2,
}

impl Border {
    fn new(layout: &Layout) -> Self {
        let lanes = &layout.map.lanes;
        let first = lanes.iter().filter(|l| l.predecessors.is_empty()).filter_map(|l| l.points.first());
        let last = lanes.iter().filter(|l| l.successors.is_empty()).filter_map(|l| l.points.last());
        let walks = layout.footways.iter().flat_map(|f| f.line.points());
        let all = || lanes.iter().flat_map(|l| &l.points).chain(walks.clone());
        let low = all().fold(Vec2::repeat(f64::INFINITY), |m, p| m.inf(p));
        let high = all().fold(Vec2::repeat(f64::NEG_INFINITY), |m, p| m.sup(p));
        Self { ends: first.chain(last).copied().collect(), low, high }
    }

    fn near(&self, p: Vec2) -> bool {
        let inside = (p - self.low).inf(&(self.high - p));
        inside.x.min(inside.y) < 0.5 * BORDER || self.ends.iter().any(|e| (e - p).norm() < BORDER)
    }
}
