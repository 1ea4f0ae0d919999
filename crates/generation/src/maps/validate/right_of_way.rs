//! Checks of stop lines, lights, priorities and entries.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_scene::{LightState, StopKind};

use super::super::super::{RightOfWay, SignalPlan};
use super::survey::Survey;
use super::{Flaws, Rule};

/// Tolerance between cycles and phases, seconds.
const TIME_TOLERANCE: f64 = 1e-6;
/// Maximum distance of a light's stop point and of a lane's stop line from the beginning of the connector,
/// metres.
const STOP_DISTANCE: f64 = 6.0;
/// Distance, metres, below which lanes that do not cross are still too close for two vehicles.
const MIN_SPACING: f64 = 2.5;
/// Distance before entry lanes and behind exit lanes at which there must be no ground, metres.
const BORDER_DISTANCE: f64 = 10.0;

pub(super) fn check(survey: &Survey<'_>, flaws: &mut Flaws) {
    stop_lines(survey, flaws);
    let precedence = Precedence::new(survey);
    signals(survey, &precedence, flaws);
    priorities(survey, &precedence, flaws);
    entries(survey, flaws);
}

fn stop_lines(survey: &Survey<'_>, flaws: &mut Flaws) {
    for line in &survey.layout.map.stop_lines {
        let lane = survey.lane(&line.lane);
        if !lane.contains(line.at, 0.3) {
            flaws.add(Rule::StopLine, lane.id(), line.at, "the stop line is not on the lane");
        }
    }
}

/// Priorities between lanes.
struct Precedence {
    /// Pairs of a yielding lane and the lane that it yields to.
    gives_way: BTreeSet<(usize, usize)>,
    /// Connectors of all-way stops.
    all_way: BTreeSet<usize>,
    signalised: BTreeSet<usize>,
}

impl Precedence {
    fn new(survey: &Survey<'_>) -> Self {
        let mut gives_way = BTreeSet::new();
        let mut all_way = BTreeSet::new();
        for priority in &survey.layout.priorities {
            let lane = survey.find(&priority.lane);
            if priority.rule == RightOfWay::AllWayStop {
                all_way.insert(lane);
            }
            gives_way.extend(priority.to.iter().map(|to| (lane, survey.find(to))));
        }
        let signalised = survey.layout.signals.iter().map(|s| survey.find(&s.lane)).collect();
        Self { gives_way, all_way, signalised }
    }

    /// Whether one of the two lanes yields to the other.
    fn is_decided(&self, a: usize, b: usize) -> bool {
        self.gives_way.contains(&(a, b))
            || self.gives_way.contains(&(b, a))
            || self.all_way.contains(&a) && self.all_way.contains(&b)
    }
}

/// Whether vehicles may go.
fn lets_go(state: Option<LightState>) -> bool {
    use LightState::{ArrowCaution, ArrowGo, Caution, Go};
    matches!(state, Some(Go | ArrowGo | Caution | ArrowCaution))
}

fn signals(survey: &Survey<'_>, precedence: &Precedence, flaws: &mut Flaws) {
    let mut plans: BTreeMap<usize, &SignalPlan> = BTreeMap::new();
    let mut cycle: Option<f64> = None;
    for plan in &survey.layout.signals {
        let lane = survey.find(&plan.lane);
        if plans.insert(lane, plan).is_some() {
            flaws.add(Rule::Signal, &plan.lane, plan.stop_point, "a second light for the same lane");
        }
        let own: f64 = plan.phases.iter().map(|p| p.1).sum();
        if !(own > 0.0) || plan.phases.iter().any(|p| !(p.1 > 0.0)) {
            flaws.add(Rule::Signal, &plan.lane, plan.stop_point, "phases must last longer than 0 s");
        }
        let common = *cycle.get_or_insert(own);
        if !((own - common).abs() < TIME_TOLERANCE) {
            let found = format!("a cycle of {own} s, where others have {common} s");
            flaws.add(Rule::Signal, &plan.lane, plan.stop_point, found);
        }
        let traced = &survey.lanes[lane];
        let away = (traced.start() - plan.stop_point).norm();
        if !(away <= STOP_DISTANCE) {
            let found = format!("the stop point is {away:.2} m from the beginning of the lane");
            flaws.add(Rule::Signal, &plan.lane, plan.stop_point, found);
        }
        if !has_line(survey, lane, StopKind::Light) {
            flaws.add(Rule::Signal, &plan.lane, plan.stop_point, "no stop line at the beginning of the lane");
        }
    }
    let mut times: Vec<f64> = Vec::new();
    for plan in plans.values() {
        let mut at = 0.0;
        for phase in &plan.phases {
            at += phase.1;
            times.push(at);
        }
    }
    times.push(0.0);
    times.sort_by(f64::total_cmp);
    times.dedup_by(|a, b| (*a - *b).abs() < TIME_TOLERANCE);
    for (&(i, j), &at) in &survey.meetings {
        let (Some(a), Some(b)) = (plans.get(&i), plans.get(&j)) else { continue };
        if precedence.is_decided(i, j) {
            continue;
        }
        let both =
            times.windows(2).map(|w| 0.5 * (w[0] + w[1])).find(|&t| lets_go(a.at(t)) && lets_go(b.at(t)));
        if let Some(time) = both {
            let found = format!("may go at {time:.1} s, as may `{}`, which it meets", b.lane);
            flaws.add(Rule::Signal, &a.lane, at, found);
        }
    }
}

/// Whether a stop line of this kind is at the end of a lane before this one.
fn has_line(survey: &Survey<'_>, lane: usize, kind: StopKind) -> bool {
    let traced = &survey.lanes[lane];
    survey.layout.map.stop_lines.iter().any(|line| {
        line.kind == kind
            && (traced.part.predecessors.contains(&line.lane) || line.lane == traced.part.id)
            && (line.at - traced.start()).norm() <= STOP_DISTANCE
    })
}

fn priorities(survey: &Survey<'_>, precedence: &Precedence, flaws: &mut Flaws) {
    for priority in &survey.layout.priorities {
        let lane = survey.find(&priority.lane);
        let start = survey.lanes[lane].start();
        for to in &priority.to {
            let other = survey.find(to);
            if survey.meet(lane, other).is_none() && !too_near(survey, lane, other) {
                let found = format!("gives way to `{to}`, which it does not meet");
                flaws.add(Rule::Priority, &priority.lane, start, found);
            }
            if precedence.gives_way.contains(&(other, lane)) && !precedence.all_way.contains(&lane) {
                let found = format!("gives way to `{to}`, which gives way to it");
                flaws.add(Rule::Priority, &priority.lane, start, found);
            }
        }
        let stops = matches!(priority.rule, RightOfWay::Stop | RightOfWay::AllWayStop);
        if stops && !has_line(survey, lane, StopKind::Sign) {
            flaws.add(Rule::Priority, &priority.lane, start, "must stop, but has no stop line with a sign");
        }
    }
    for (&(i, j), &at) in &survey.meetings {
        let (a, b) = (&survey.lanes[i], &survey.lanes[j]);
        let by_light = precedence.signalised.contains(&i) && precedence.signalised.contains(&j);
        if !by_light && !precedence.is_decided(i, j) {
            flaws.add(Rule::Priority, a.id(), at, format!("neither it nor `{}` gives way", b.id()));
        }
    }
}

/// Whether the centre lines of two lanes come so close that vehicles cannot pass each other.
fn too_near(survey: &Survey<'_>, a: usize, b: usize) -> bool {
    let (a, b) = (&survey.lanes[a].line, &survey.lanes[b].line);
    a.points().iter().any(|&p| b.project(p).distance < MIN_SPACING)
}

fn entries(survey: &Survey<'_>, flaws: &mut Flaws) {
    let mut entered = BTreeSet::new();
    for entry in &survey.layout.entries {
        let i = survey.find(&entry.lane);
        let start = survey.lanes[i].start();
        if !entered.insert(i) {
            flaws.add(Rule::Entry, &entry.lane, start, "is named twice");
        }
        if !(entry.flow > 0.0 && entry.flow < 2500.0) {
            let found = format!("{} vehicles per hour, expected above 0 and below 2500", entry.flow);
            flaws.add(Rule::Entry, &entry.lane, start, found);
        }
        if !survey.lanes[i].part.predecessors.is_empty() {
            flaws.add(Rule::Entry, &entry.lane, start, "is entered although another lane leads into it");
        }
        if !reaches_exit(survey, i) {
            flaws.add(Rule::Entry, &entry.lane, start, "no lane that leaves the map can be reached");
        }
    }
    for (i, lane) in survey.lanes.iter().enumerate() {
        if lane.part.predecessors.is_empty() {
            if !entered.contains(&i) {
                flaws.add(Rule::Entry, lane.id(), lane.start(), "nobody can come in: it is no entry");
            }
            let before = lane.start() - lane.unit(0) * BORDER_DISTANCE;
            if survey.drivable(before, lane.height(lane.start()), 0.0) {
                flaws.add(Rule::Entry, lane.id(), lane.start(), "begins inside the drivable ground");
            }
        }
        let ahead = lane.end() + lane.unit(lane.line.segments() - 1) * BORDER_DISTANCE;
        if lane.part.successors.is_empty() && survey.drivable(ahead, lane.height(lane.end()), 0.0) {
            flaws.add(Rule::Entry, lane.id(), lane.end(), "ends inside the drivable ground");
        }
    }
}

/// Whether a lane that leaves the map can be reached.
fn reaches_exit(survey: &Survey<'_>, from: usize) -> bool {
    let mut seen = BTreeSet::from([from]);
    let mut open = vec![from];
    while let Some(i) = open.pop() {
        let next = &survey.lanes[i].part.successors;
        if next.is_empty() {
            return true;
        }
        open.extend(next.iter().map(|id| survey.find(id)).filter(|&j| seen.insert(j)));
    }
    false
}
