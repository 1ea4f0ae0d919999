//! Who goes first at a junction: lights, signs.

use super::interior::{Movement, Turn, conflicts};
use crate::generation::RightOfWay;
use crate::generation::maps::build::{LaneRef, MapBuilder};
use crate::scene::{LightState, StopKind};

/// A part of a cycle in which one road has green.
#[derive(Clone, Copy, Debug)]
pub(super) struct Phase {
    /// The road: 0 for arms 0 and 2, 1 for arms 1 and 3.
    pub(super) axis: usize,
    /// Whether it is that of the left turns.
    pub(super) left: bool,
    /// Seconds.
    pub(super) green: f64,
    pub(super) yellow: f64,
    pub(super) all_red: f64,
}

impl Phase {
    fn seconds(&self) -> f64 {
        self.green + self.yellow + self.all_red
    }
}

/// A fixed-time plan.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) phases: Vec<Phase>,
    /// Seconds of the cycle that have passed at time 0.
    pub(super) offset: f64,
}

impl Plan {
    pub(super) fn cycle(&self) -> f64 {
        self.phases.iter().map(Phase::seconds).sum()
    }

    /// Whether left turns of a road have a phase of their own.
    fn protects(&self, axis: usize) -> bool {
        self.phases.iter().any(|p| p.axis == axis && p.left)
    }

    /// The road, and whether it is the phase of its left turns, in which a way is green.
    fn group(&self, m: &Movement) -> (usize, bool) {
        let axis = m.from % 2;
        (axis, m.turn == Turn::Left && self.protects(axis))
    }

    /// What a group is shown from time 0 on.
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
        // From the offset on, then what came before it.
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

    /// Sets lights, and says who gives way among those who have green at once.
    pub(super) fn apply(&self, b: &mut MapBuilder, movements: &[Movement]) {
        for m in movements {
            b.signal(m.lane, self.states(self.group(m)));
            b.stop(StopKind::Light, m.lane);
        }
        let mut yields = Yields::new(movements);
        for (i, j) in conflicts(b, movements) {
            let (p, q) = (&movements[i], &movements[j]);
            if self.group(p) == self.group(q) {
                let rank = |m: &Movement| (m.turn, !m.bike);
                yields.decide(i, j, rank(p) <= rank(q));
            }
        }
        yields.apply(b, movements, |_| RightOfWay::Yield);
    }

    /// The lanes whose green means that people do not cross an arm: those that come from it, those that go straight into it, and
    /// protected turns into it.
    pub(super) fn waits(&self, movements: &[Movement], slot: usize) -> Vec<LaneRef> {
        let held =
            |m: &&Movement| m.from == slot || m.to == slot && (m.turn == Turn::Through || self.group(m).1);
        movements.iter().filter(held).map(|m| m.lane).collect()
    }
}

/// Sets signs on the minor road: `stop` or give way; the major road is that of this axis.
pub(super) fn signs(b: &mut MapBuilder, movements: &[Movement], major: usize, stop: bool) {
    let (kind, rule) =
        if stop { (StopKind::Sign, RightOfWay::Stop) } else { (StopKind::Yield, RightOfWay::Yield) };
    let minor = |m: &Movement| m.from % 2 != major;
    for m in movements.iter().filter(|m| minor(m)) {
        b.stop(kind, m.lane);
    }
    // The ranks of the Highway Capacity Manual, told apart where they are equal.
    let rank = |m: &Movement| match (minor(m), m.turn) {
        (false, Turn::Through) => 0,
        (false, Turn::Right) => 1,
        (false, Turn::Left) => 2,
        (true, Turn::Right) => 3,
        (true, Turn::Through) => 4,
        (true, Turn::Left) => 5,
    };
    let mut yields = Yields::new(movements);
    for (i, j) in conflicts(b, movements) {
        let (p, q) = (&movements[i], &movements[j]);
        // Who turns right crosses the bicycle lane beside.
        let first = if p.from == q.from && p.bike != q.bike { p.bike } else { rank(p) <= rank(q) };
        yields.decide(i, j, first);
    }
    yields.apply(b, movements, |m| if minor(m) { rule } else { RightOfWay::Yield });
}

/// Sets stop signs on all arms.
pub(super) fn all_way(b: &mut MapBuilder, movements: &[Movement]) {
    let mut yields = Yields::new(movements);
    for (i, j) in conflicts(b, movements) {
        yields.to[i].push(movements[j].lane);
        yields.to[j].push(movements[i].lane);
    }
    for (m, to) in movements.iter().zip(&yields.to) {
        b.stop(StopKind::Sign, m.lane);
        b.priority(m.lane, to, RightOfWay::AllWayStop);
    }
}

/// Who gives way to whom.
struct Yields {
    to: Vec<Vec<LaneRef>>,
    pairs: Vec<(usize, usize)>,
}

impl Yields {
    fn new(movements: &[Movement]) -> Self {
        Self { to: vec![Vec::new(); movements.len()], pairs: Vec::new() }
    }

    fn decide(&mut self, i: usize, j: usize, first_goes: bool) {
        self.pairs.push(if first_goes { (j, i) } else { (i, j) });
    }

    fn apply(mut self, b: &mut MapBuilder, movements: &[Movement], rule: impl Fn(&Movement) -> RightOfWay) {
        for (who, to) in self.pairs {
            self.to[who].push(movements[to].lane);
        }
        for (m, to) in movements.iter().zip(&self.to) {
            let rule = rule(m);
            if !to.is_empty() || rule == RightOfWay::Stop {
                b.priority(m.lane, to, rule);
            }
        }
    }
}
