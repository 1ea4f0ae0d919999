//! Right of way at a junction: lights and signs.

use reactsim_scene::{LightState, StopKind};

use super::interior::{Movement, Turn, conflicts};
use crate::RightOfWay;
use crate::maps::build::{LaneRef, MapBuilder};

/// A part of the cycle in which one road has green.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phase {
    /// The road: 0 for arms 0 and 2, 1 for arms 1 and 3.
    pub(super) axis: usize,
    /// Whether it is a phase for left turns.
    pub(super) left: bool,
    /// Duration of green, seconds.
    pub(super) green: f64,
    /// Duration of yellow, seconds.
    pub(super) yellow: f64,
    /// Duration of the all-red clearance, seconds.
    pub(super) all_red: f64,
}

impl Phase {
    fn seconds(&self) -> f64 {
        self.green + self.yellow + self.all_red
    }
}

/// A fixed-time signal plan.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) phases: Vec<Phase>,
    /// Time within the cycle at time 0, seconds.
    pub(super) offset: f64,
}

impl Plan {
    pub(super) fn cycle(&self) -> f64 {
        self.phases.iter().map(Phase::seconds).sum()
    }

    /// Whether left turns of a road have their own phase.
    fn protects(&self, axis: usize) -> bool {
        self.phases.iter().any(|p| p.axis == axis && p.left)
    }

    /// Returns the signal group of a movement: its road, and whether it is a protected left turn.
    fn group(&self, m: &Movement) -> (usize, bool) {
        let axis = m.from % 2;
        (axis, m.turn == Turn::Left && self.protects(axis))
    }

    /// Returns the light states of a signal group from time 0 on.
    fn states(&self, (axis, left): (usize, bool)) -> Vec<(LightState, f64)> {
        use LightState::{ArrowCaution, ArrowGo, ArrowStop, Caution, Go, Stop};
        let [go, caution, stop] = if left { [ArrowGo, ArrowCaution, ArrowStop] } else { [Go, Caution, Stop] };
        let mut all: Vec<(LightState, f64)> = Vec::new();
        for phase in &self.phases {
            if (phase.axis, phase.left) == (axis, left) {
                all.extend([(go, phase.green), (caution, phase.yellow), (stop, phase.all_red)]);
            } else {
                all.push((stop, phase.seconds()));
            }
        }
        // From the offset on, followed by the part before it.
        let (mut first, mut last, mut at) = (Vec::new(), Vec::new(), 0.0);
        for (state, seconds) in all {
            let cut = (self.offset - at).clamp(0.0, seconds);
            last.push((state, cut));
            first.push((state, seconds - cut));
            at += seconds;
        }
        let mut merged: Vec<(LightState, f64)> = Vec::new();
        for (state, seconds) in first.into_iter().chain(last).filter(|p| p.1 > 1e-9) {
            match merged.last_mut() {
                Some(before) if before.0 == state => before.1 += seconds,
                _ => merged.push((state, seconds)),
            }
        }
        merged
    }

    /// Adds the lights, and the priorities between movements that have green at the same time.
    pub(super) fn apply(&self, b: &mut MapBuilder, movements: &[Movement]) {
        for m in movements {
            b.signal(m.lane, self.states(self.group(m)));
            b.stop(StopKind::Light, m.lane);
        }
        let mut yields = YieldRelations::new(movements);
        for (i, j) in conflicts(b, movements) {
            let (p, q) = (&movements[i], &movements[j]);
            if self.group(p) == self.group(q) {
                let rank = |m: &Movement| (m.turn, !m.bike);
                yields.decide(i, j, rank(p) <= rank(q));
            }
        }
        yields.apply(b, |_| RightOfWay::Yield);
    }

    /// Returns the lanes whose green means that people must not cross an arm: those from it, those straight
    /// into it, and protected turns into it.
    pub(super) fn waits(&self, movements: &[Movement], slot: usize) -> Vec<LaneRef> {
        let held =
            |m: &&Movement| m.from == slot || m.to == slot && (m.turn == Turn::Through || self.group(m).1);
        movements.iter().filter(held).map(|m| m.lane).collect()
    }
}

/// Adds signs on the minor road: stop signs if `stop`, otherwise give-way signs. `major` is the axis of the
/// major road.
pub(super) fn signs(b: &mut MapBuilder, movements: &[Movement], major: usize, stop: bool) {
    let (kind, rule) =
        if stop { (StopKind::Sign, RightOfWay::Stop) } else { (StopKind::Yield, RightOfWay::Yield) };
    let minor = |m: &Movement| m.from % 2 != major;
    for m in movements.iter().filter(|m| minor(m)) {
        b.stop(kind, m.lane);
    }
    // The ranks of the Highway Capacity Manual, with distinct values for equal ranks.
    let rank = |m: &Movement| match (minor(m), m.turn) {
        (false, Turn::Through) => 0,
        (false, Turn::Right) => 1,
        (false, Turn::Left) => 2,
        (true, Turn::Right) => 3,
        (true, Turn::Through) => 4,
        (true, Turn::Left) => 5,
    };
    let mut yields = YieldRelations::new(movements);
    for (i, j) in conflicts(b, movements) {
        let (p, q) = (&movements[i], &movements[j]);
        // Right-turning vehicles cross the bicycle lane next to them.
        let first = if p.from == q.from && p.bike != q.bike { p.bike } else { rank(p) <= rank(q) };
        yields.decide(i, j, first);
    }
    yields.apply(b, |m| if minor(m) { rule } else { RightOfWay::Yield });
}

/// Adds stop signs on all arms.
pub(super) fn all_way(b: &mut MapBuilder, movements: &[Movement]) {
    let mut yields = YieldRelations::new(movements);
    for (i, j) in conflicts(b, movements) {
        yields.decide(i, j, true);
        yields.decide(i, j, false);
    }
    movements.iter().for_each(|m| b.stop(StopKind::Sign, m.lane));
    yields.apply(b, |_| RightOfWay::AllWayStop);
}

/// The lanes to which each movement yields.
struct YieldRelations<'m> {
    movements: &'m [Movement],
    to: Vec<Vec<LaneRef>>,
}

impl<'m> YieldRelations<'m> {
    fn new(movements: &'m [Movement]) -> Self {
        Self { movements, to: vec![Vec::new(); movements.len()] }
    }

    fn decide(&mut self, i: usize, j: usize, first_goes: bool) {
        let (goes, yields) = if first_goes { (i, j) } else { (j, i) };
        self.to[yields].push(self.movements[goes].lane);
    }

    fn apply(&self, b: &mut MapBuilder, rule: impl Fn(&Movement) -> RightOfWay) {
        for (m, to) in self.movements.iter().zip(&self.to) {
            let rule = rule(m);
            if !to.is_empty() || rule != RightOfWay::Yield {
                b.priority(m.lane, to, rule);
            }
        }
    }
}
