//! Progress along the route of the expert (nuPlan devkit 1.2.2, `ego_progress_along_expert_route` and
//! `ego_is_making_progress`).

use reactsim_geometry::{Polyline, Vec2};

use crate::{EgoState, PlanningMap};

use super::center_lanes::center_lanes;
use super::context::Context;
use super::driven_lanes::driven_lanes;
use super::matched_lanes::lanes_overlap;
use super::{MetricValue, MissingInputs, UndefinedReason};

/// Distance in metres that replaces shorter ones in the ratio, and to which ego may move backwards without
/// giving 0. The documentation of the devkit states 0.1 m (devkit 1.2.2, closed-loop configuration).
const PROGRESS_THRESHOLD: f64 = 2.0;
/// Smallest ratio at which ego makes progress (devkit 1.2.2).
const MIN_PROGRESS: f64 = 0.2;

/// Result of the metric of progress.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpertProgress {
    /// Progress of ego relative to the expert, 0 to 1.
    pub value: MetricValue,
    /// Progress of ego, metres; `None` without a route.
    pub ego_total: Option<f64>,
    /// Progress of the expert, metres; 0 without a route.
    pub expert_total: f64,
    /// Progress of ego since the previous sample, metres, per sample; empty without a route.
    pub ego_progress: Vec<f64>,
}

/// A part of the route: a roadblock, and the lane through which the expert entered it.
struct Link<'a> {
    roadblock: usize,
    baseline: &'a Polyline,
}

impl Link<'_> {
    fn arc(&self, p: Vec2) -> f64 {
        self.baseline.project(p).s
    }

    fn start(&self) -> Vec2 {
        self.baseline.points()[0]
    }

    fn end(&self) -> Vec2 {
        self.baseline.points()[self.baseline.segments()]
    }
}

/// Judges the progress of ego along the roadblocks that the expert passed.
pub(super) fn expert_progress(context: &Context<'_>) -> ExpertProgress {
    let history = context.history;
    let Some(expert) = history.expert else { return undefined(UndefinedReason::IncompleteExpert) };
    if !context.has_lanes() && history.missing == MissingInputs::Undefined {
        return undefined(UndefinedReason::NoLanes);
    }
    let centers: Vec<Vec2> = expert.iter().map(|state| state.center(&history.shape)).collect();
    let link = |lane: usize| {
        let lane = history.map.lane(lane);
        Link { roadblock: lane.roadblock, baseline: &lane.baseline }
    };
    let route: Vec<Link<'_>> =
        passed_lanes(history.map, expert, &centers).entered.into_iter().map(link).collect();
    if route.is_empty() {
        return match history.missing {
            MissingInputs::Undefined => undefined(UndefinedReason::ExpertWithoutLanes),
            MissingInputs::AsDevkit => without_totals(MetricValue::Defined(1.0)),
        };
    }
    let ego_progress = increments(history.map, &route, &context.centers);
    let ego_total: f64 = ego_progress.iter().sum();
    let expert_total: f64 = increments(history.map, &route, &centers).iter().sum();
    let value = MetricValue::Defined(ratio(ego_total, expert_total));
    ExpertProgress { value, ego_total: Some(ego_total), expert_total, ego_progress }
}

/// Returns 1 if the ratio of progress is large enough, else 0.
pub(super) fn making_progress(progress: MetricValue) -> MetricValue {
    match progress {
        MetricValue::Defined(ratio) => MetricValue::pass(ratio >= MIN_PROGRESS),
        undefined @ MetricValue::Undefined(_) => undefined,
    }
}

fn ratio(ego: f64, expert: f64) -> f64 {
    if ego < -PROGRESS_THRESHOLD {
        return 0.0;
    }
    (ego.max(PROGRESS_THRESHOLD) / expert.max(PROGRESS_THRESHOLD)).min(1.0)
}

fn undefined(reason: UndefinedReason) -> ExpertProgress {
    without_totals(MetricValue::Undefined(reason))
}

fn without_totals(value: MetricValue) -> ExpertProgress {
    ExpertProgress { value, ego_total: None, expert_total: 0.0, ego_progress: Vec::new() }
}

/// The lanes that a vehicle passes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PassedLanes {
    /// The lane through which the vehicle enters each roadblock, in driving order.
    pub(crate) entered: Vec<usize>,
    /// The lane at the last sample that has one.
    pub(crate) last: Option<usize>,
}

/// Returns the lanes that a vehicle passes: a new one whenever its lanes change to lanes of another roadblock.
/// If lanes overlap, they are the lanes of the likeliest sequence ([`driven_lanes`]).
pub(crate) fn passed_lanes(map: &PlanningMap, expert: &[EgoState], centers: &[Vec2]) -> PassedLanes {
    let mut lists = center_lanes(map, centers);
    if lanes_overlap(map, &lists) {
        lists = driven_lanes(map, expert, centers).into_iter().map(|lane| vec![lane]).collect();
    }
    let last = lists.iter().rev().find_map(|lanes| lanes.first().copied());
    let mut kept: Vec<usize> = Vec::new();
    let mut entered: Vec<usize> = Vec::new();
    for lanes in lists {
        let Some(&first) = lanes.first() else { continue };
        if lanes.iter().any(|lane| kept.contains(lane)) {
            continue;
        }
        let roadblock = |lane: usize| map.lane(lane).roadblock;
        if entered.last().is_none_or(|&before| roadblock(before) != roadblock(first)) {
            entered.push(first);
        }
        kept = lanes;
    }
    PassedLanes { entered, last }
}

/// Returns the progress along the route since the previous sample, metres, per sample. Samples off the route
/// give 0; the sample that returns to it gives the whole distance.
fn increments(map: &PlanningMap, route: &[Link<'_>], centers: &[Vec2]) -> Vec<f64> {
    let Some(&first) = centers.first() else { return Vec::new() };
    let mut current = 0;
    let mut arc_before = route[current].arc(first);
    let mut increments = vec![0.0];
    for &center in &centers[1..] {
        if map.roadblock_contains(route[current].roadblock, center) {
            let arc = route[current].arc(center);
            increments.push(arc - arc_before);
            arc_before = arc;
        } else if let Some((link, distance)) = walk(map, route, current, arc_before, center) {
            increments.push(distance);
            current = link;
            arc_before = route[link].arc(center);
        } else {
            increments.push(0.0);
        }
    }
    increments
}

/// Returns the first link after `current` whose roadblock contains `center`, and the distance along the route
/// from `arc_before` on the current link, metres.
fn walk(
    map: &PlanningMap,
    route: &[Link<'_>],
    current: usize,
    arc_before: f64,
    center: Vec2,
) -> Option<(usize, f64)> {
    let from = &route[current];
    let (mut skipped, mut last) = (0.0, from.end());
    for (next, link) in route.iter().enumerate().skip(current + 1) {
        if map.roadblock_contains(link.roadblock, center) {
            let rest = from.baseline.length() - arc_before;
            return Some((next, rest + (link.arc(center) - link.arc(from.end())) + skipped));
        }
        let after = route.get(next + 1)?;
        skipped += link.arc(after.start()) - link.arc(last);
        last = link.end();
    }
    None
}
