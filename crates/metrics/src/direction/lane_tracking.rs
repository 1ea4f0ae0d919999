//! Assignment of vehicles to lanes: by nuPlan's route over lanes and connectors, or for each point
//! separately.

use std::ops::Range;

use reactsim_geometry::{Projection, Vec2, math, wrap};
use reactsim_scene::{LaneClass, LaneHit, LaneKind, Road};

use crate::Case;
use crate::options::DirConnector;

/// Distance in metres up to which a vehicle that leaves its connector stays assigned to it (nuPlan
/// `get_route`).
const PROXIMITY: f64 = 5.0;

/// The position of a pose on its lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LanePosition {
    /// Index of the lane.
    pub(crate) lane: usize,
    /// Arc length of the nearest point of the baseline, metres.
    pub(super) s: f64,
    /// Heading of the segment that contains this point, radians.
    pub(crate) theta: f64,
}

/// Assigns lanes to poses; reuses its buffers for all vehicles.
pub(crate) struct Tracker<'c> {
    /// The road on the level on which lanes are looked up.
    pub(super) road: Road<'c>,
    /// Whether to ignore bike lanes: in maps without drivable polygons they overlap adjacent lanes.
    skip_bikes: bool,
    hits: Vec<LaneHit>,
    /// Hits of all poses of a run, in sequence, and the range of each pose.
    all_hits: Vec<LaneHit>,
    hit_ranges: Vec<Range<usize>>,
    /// Candidate lanes of all poses of a run, and the range of each pose.
    members: Vec<usize>,
    lists: Vec<Range<usize>>,
}

impl<'c> Tracker<'c> {
    pub(crate) fn new(case: &Case<'c>) -> Self {
        let skip_bikes = case.road.map.drivable_area.is_none()
            && case.road.map.lanes.iter().any(|l| l.class == LaneClass::Bike);
        Self {
            road: case.road,
            skip_bikes,
            hits: Vec::new(),
            all_hits: Vec::new(),
            hit_ranges: Vec::new(),
            members: Vec::new(),
            lists: Vec::new(),
        }
    }

    fn look_up(&mut self, p: Vec2) {
        self.road.lanes_at(p, &mut self.hits);
        if self.skip_bikes {
            let road = self.road;
            self.hits.retain(|h| road.lane(h.lane).class != LaneClass::Bike);
        }
    }

    fn position(&self, lane: usize, projection: &Projection) -> LanePosition {
        let theta = self.road.lane(lane).baseline.heading(projection.segment);
        LanePosition { lane, s: projection.s, theta }
    }

    /// Returns whether any lane contains `p`, and whether the direction of one of them is certainly less than
    /// `degrees` off `axis`. `hint` carries such a lane from one pose to the next and is tried first.
    pub(super) fn some_lane_along(
        &mut self,
        p: Vec2,
        axis: Vec2,
        degrees: f64,
        hint: &mut Option<usize>,
    ) -> (bool, bool) {
        // The margin covers rounding: directions close to the bound are evaluated exactly elsewhere.
        let min_cos = math::cos(degrees.to_radians()) + 1e-9;
        let road = self.road;
        let along = |lane: usize, projection: &Projection| {
            let (a, b) = road.lane(lane).baseline.segment(projection.segment);
            (b - a).dot(&axis) > min_cos * (b - a).norm()
        };
        if let Some(lane) = *hint
            && road.lane_at(p, lane).is_some_and(|projection| along(lane, &projection))
        {
            return (true, true);
        }
        self.look_up(p);
        *hint = self.hits.iter().find(|h| along(h.lane, &h.projection)).map(|h| h.lane);
        (!self.hits.is_empty(), hint.is_some())
    }

    /// Assigns each pose to the lane with the smallest heading error among all that contain it; the first in
    /// map order on ties.
    pub(super) fn pointwise(
        &mut self,
        case: &Case<'c>,
        agent: usize,
        run: Range<usize>,
        placed: &mut Vec<Option<LanePosition>>,
    ) {
        placed.clear();
        placed.extend(run.map(|f| self.pointwise_at(case, agent, f)));
    }

    /// Assigns the pose at a frame as [`Self::pointwise`] does.
    pub(crate) fn pointwise_at(&mut self, case: &Case<'c>, agent: usize, f: usize) -> Option<LanePosition> {
        self.road = case.road_under(agent, f);
        self.look_up(case.motion.position(agent, f));
        let heading = case.motion.heading[case.motion.at(agent, f)];
        let all = self.hits.iter().map(|h| self.position(h.lane, &h.projection));
        least_error(all, heading)
    }

    /// Assigns poses to lanes by nuPlan's `get_route` and `remove_extra_lane_connectors`, on box centres.
    pub(super) fn route(
        &mut self,
        case: &Case<'c>,
        agent: usize,
        run: Range<usize>,
        placed: &mut Vec<Option<LanePosition>>,
    ) {
        self.all_hits.clear();
        self.hit_ranges.clear();
        self.members.clear();
        self.lists.clear();
        for f in run.clone() {
            let p = case.motion.position(agent, f);
            // At rest, the hits of the last look-up hold.
            let before = self.hit_ranges.last().filter(|_| case.motion.rests(agent, f)).cloned();
            let hits = before.unwrap_or_else(|| {
                self.road = case.road_under(agent, f);
                self.look_up(p);
                let from = self.all_hits.len();
                self.all_hits.extend_from_slice(&self.hits);
                from..self.all_hits.len()
            });
            self.hit_ranges.push(hits);
            let list = self.advance(p);
            self.lists.push(list);
        }
        self.prune();
        placed.clear();
        for (q, f) in run.enumerate() {
            let p = case.motion.position(agent, f);
            let hits = &self.all_hits[self.hit_ranges[q].clone()];
            let place = |&lane: &usize| match hits.iter().find(|h| h.lane == lane) {
                Some(hit) => self.position(lane, &hit.projection),
                None => self.position(lane, &self.road.lane(lane).baseline.project(p)),
            };
            let list = &self.members[self.lists[q].clone()];
            placed.push(match case.options.dir_connector {
                DirConnector::First => list.first().map(place),
                DirConnector::MinHeading => {
                    least_error(list.iter().map(place), case.motion.heading[case.motion.at(agent, f)])
                }
            });
        }
    }

    fn holds(&self, lane: usize) -> bool {
        self.hits.iter().any(|h| h.lane == lane)
    }

    fn begins_with(&self, list: &Range<usize>, kind: LaneKind) -> bool {
        self.members[list.clone()].first().is_some_and(|&lane| self.road.lane(lane).kind == kind)
    }

    /// Returns the candidate lanes of the next pose at `p`, whose hits have been looked up.
    fn advance(&mut self, p: Vec2) -> Range<usize> {
        let q = self.lists.len();
        let before = self.lists.last().cloned().unwrap_or(0..0);
        let start = self.members.len();
        for k in before.clone() {
            let lane = self.members[k];
            if self.holds(lane) {
                self.members.push(lane);
            }
        }
        if self.members.len() == start && before.len() == 1 {
            let only = self.members[before.start];
            for &next in &self.road.map.lanes[only].successors {
                if self.holds(next) {
                    self.members.push(next);
                }
            }
        }
        if self.members.len() > start {
            return start..self.members.len();
        }
        let is_lane = |h: &&LaneHit| self.road.lane(h.lane).kind == LaneKind::Lane;
        match self.hits.iter().find(is_lane) {
            Some(hit) => self.members.push(hit.lane),
            None => self.members.extend(self.hits.iter().map(|h| h.lane)),
        }
        let fresh = start..self.members.len();
        let lost = fresh.is_empty() && self.road.in_intersection(p);
        if q > 1
            && self.begins_with(&before, LaneKind::Connector)
            && (lost || self.begins_with(&fresh, LaneKind::Connector))
        {
            let end = self.members.len();
            for k in before {
                let lane = self.members[k];
                if self.road.distance_to_lane(p, lane) < PROXIMITY {
                    self.members.push(lane);
                }
            }
            if self.members.len() > end {
                return end..self.members.len();
            }
        }
        fresh
    }

    /// Narrows each list of several lanes by the list of the next pose, going backwards.
    fn prune(&mut self) {
        for q in (0..self.lists.len().saturating_sub(1)).rev() {
            let (mut list, next) = (self.lists[q].clone(), self.lists[q + 1].clone());
            if list.len() <= 1 {
                continue;
            }
            let held = |lane: &usize| self.members[list.clone()].contains(lane);
            if list.len() > next.len() && self.members[next.clone()].iter().all(held) {
                list = next.clone();
            }
            if self.begins_with(&next, LaneKind::Lane) {
                let incoming = &self.road.map.lanes[self.members[next.start]].predecessors;
                let start = self.members.len();
                // The members stored by the forward pass, even if the list was just replaced by the next one.
                for k in self.lists[q].clone() {
                    let lane = self.members[k];
                    if incoming.contains(&lane) {
                        self.members.push(lane);
                    }
                }
                if self.members.len() > start {
                    list = start..self.members.len();
                }
            }
            self.lists[q] = list;
        }
    }
}

fn least_error(positions: impl Iterator<Item = LanePosition>, heading: f64) -> Option<LanePosition> {
    let mut best: Option<(f64, LanePosition)> = None;
    for position in positions {
        let error = wrap(heading - position.theta).abs();
        if best.is_none_or(|(least, _)| error < least) {
            best = Some((error, position));
        }
    }
    best.map(|b| b.1)
}
