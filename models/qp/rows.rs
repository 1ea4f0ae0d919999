//! Bounds of the way over time: what keeps a vehicle clear of what is ahead.

use reactsim::dynamics::Moving;
use reactsim::geometry::direction;

use super::obstacle::{Obstacle, Span, TIMES, step_of};
use super::settings::Settings;
use super::speed::{ANSWERS, Bound, CHECKED, STEPS};
use super::vehicle::Subject;

/// Steps within which a plan must be kept clear.
const NEAR_STEPS: usize = 30;

/// Bounds of the way at every checked time.
pub(super) struct Rows {
    pub(super) ahead: [Bound; CHECKED.len()],
    pub(super) answers: Vec<Bound>,
    /// Way that must not be exceeded at each time, without the part that depends on the speed.
    caps: [f64; CHECKED.len()],
    braking: [(f64, f64); STEPS],
}

impl Rows {
    pub(super) fn new(braking: [(f64, f64); STEPS]) -> Self {
        let ahead = CHECKED.map(|step| Bound { step, time: 0.0, bound: f64::INFINITY });
        Self { ahead, answers: Vec::new(), caps: [f64::INFINITY; CHECKED.len()], braking }
    }

    /// Asks for a way of at most `from` with a time gap, at a checked time; no more than what the hardest braking would reach.
    fn put(&mut self, i: usize, from: f64, time: f64, speed: f64) {
        let (least, slowest) = self.braking[CHECKED[i] - 1];
        let bound = (from + time * speed).max(least + time * slowest + 0.01);
        self.caps[i] = self.caps[i].min(from.max(least));
        // Of two bounds with different time gaps the one that asks for less way at the present speed is taken.
        let worth = |b: f64, t: f64| b - t * slowest;
        let old = &mut self.ahead[i];
        if worth(bound, time) < worth(old.bound, old.time) {
            *old = Bound { step: CHECKED[i], time, bound };
        }
    }

    /// Stops before a place of the way.
    pub(super) fn stop_at(&mut self, place: f64) {
        for i in 0..CHECKED.len() {
            self.put(i, place, 0.0, 0.0);
        }
    }

    /// Lowers what is wanted to what is allowed; what was not gone in time is not made up for.
    pub(super) fn cap(&self, wanted: &mut [f64; STEPS]) {
        if self.caps.iter().all(|c| c.is_infinite()) {
            return;
        }
        let mut allowed = [f64::INFINITY; STEPS];
        let mut least = f64::INFINITY;
        for i in (0..CHECKED.len()).rev() {
            least = least.min(self.caps[i]);
            let from = if i == 0 { 0 } else { CHECKED[i - 1] };
            allowed[from..CHECKED[i]].fill(least);
        }
        let (mut before, mut wish_before) = (0.0_f64, 0.0);
        for (way, most) in wanted.iter_mut().zip(allowed) {
            let step = *way - wish_before;
            wish_before = *way;
            *way = (before + step).min(most).max(before.min(most));
            before = *way;
        }
    }

    /// Keeps clear of an obstacle. Whether it is one at all.
    pub(super) fn keep_clear(
        &mut self,
        subject: &Subject<'_>,
        obstacle: &Obstacle,
        spans: &[Option<Span>; TIMES],
        wanted: &[f64; STEPS],
        settings: &Settings,
    ) -> bool {
        let Some(first) = (0..TIMES).find(|&t| spans[t].is_some_and(|s| s.to > 0.0)) else { return false };
        let Some(span) = spans[first] else { return false };
        let axis = direction(subject.now.pose.heading);
        let to = obstacle.boxes[0].center - subject.now.pose.position;
        let in_front = to.dot(&axis) > 0.0;
        let pace = obstacle.velocities[first].norm();
        let leads = obstacle.stands() || span.speed >= 0.5 * pace;
        // Who comes from behind looks out itself.
        if !in_front && (leads || span.from < 0.0) {
            return false;
        }
        if obstacle.leader_only && !(leads && in_front && first == 0) && !obstacle.stands() {
            return false;
        }
        if !leads {
            if first > obstacle.sight {
                return false;
            }
            let passes = |t: usize| {
                spans[t].is_none_or(|s| wanted[step_of(t).max(1) - 1] > s.to + 0.5 + 0.02 * step_of(t) as f64)
            };
            if (first.max(1)..TIMES).all(passes) {
                return false;
            }
        }
        let time = if leads { settings.closing_time } else { 0.3 };
        for (t, s) in spans.iter().enumerate().skip(1) {
            let Some(s) = s else { continue };
            if !leads && t > obstacle.sight || s.to < 0.0 || s.from < 0.0 && !in_front {
                continue;
            }
            self.put(t - 1, s.from - settings.gap, time, s.speed.max(0.0));
        }
        if obstacle.is_av
            && leads
            && !obstacle.stands()
            && self.answers.len() + 2 <= ANSWERS
            && let Some(s) = spans[0]
        {
            self.answer(s, settings);
        }
        true
    }

    /// After half a second and after a second, it must still be possible to halt behind an AV that brakes from now on.
    fn answer(&mut self, span: Span, settings: &Settings) {
        let halt =
            span.from + span.speed.max(0.0) * span.speed / (2.0 * settings.av_brake) - 0.5 * settings.gap;
        for step in [5, 10] {
            // The way of halting grows with the square of the speed: linear about the hardest braking, which is the least there is.
            let (least, slowest) = self.braking[step - 1];
            let about = slowest + 1.0;
            let time = about / settings.own_brake;
            let bound = halt + about * about / (2.0 * settings.own_brake);
            self.answers.push(Bound { step, time, bound: bound.max(least + time * slowest + 0.01) });
        }
    }
}

/// How far a plan goes into what is in the way within the next three seconds, metres.
pub(super) fn excess(now: &Moving, moves: &[Moving], all: &[[Option<Span>; TIMES]]) -> f64 {
    let mut arc = [0.0; STEPS];
    let (mut way, mut before) = (0.0, now.pose.position);
    for (arc, moving) in arc.iter_mut().zip(moves) {
        way += (moving.pose.position - before).norm();
        before = moving.pose.position;
        *arc = way;
    }
    let mut most = 0.0_f64;
    for spans in all {
        for (t, span) in spans.iter().enumerate().skip(1) {
            let step = step_of(t);
            if step > NEAR_STEPS {
                break;
            }
            if let Some(s) = span
                && arc[step - 1] < s.to
            {
                most = most.max(arc[step - 1] - s.from.max(0.0));
            }
        }
    }
    most
}
