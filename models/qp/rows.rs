//! Bounds on the distance over time that keep a vehicle clear of what is ahead.

use reactsim_geometry::direction;
use reactsim_scene::dynamics::VehicleMotion;

use super::obstacle::{Obstacle, Span, TIMES, step_of};
use super::planned_vehicle::PlannedVehicle;
use super::settings::Settings;
use super::speed::{AV_BRAKING_BOUNDS, Bound, CHECKED, STEPS};

/// Number of steps within which a plan must be clear: 3 s.
const NEAR_STEPS: usize = 30;

/// Bounds on the distance along the path at every checked step.
pub(super) struct DistanceBounds {
    /// One bound per entry of [`CHECKED`]; infinite if there is none.
    pub(super) ahead: [Bound; CHECKED.len()],
    /// Bounds that leave room for a response if the AV brakes.
    pub(super) av_braking: Vec<Bound>,
    /// Largest distance at each checked step, without the part that depends on the speed, metres.
    caps: [f64; CHECKED.len()],
    /// Distance, metres, and speed, m/s, after every step of the hardest braking.
    braking: [(f64, f64); STEPS],
}

impl DistanceBounds {
    pub(super) fn new(braking: [(f64, f64); STEPS]) -> Self {
        let ahead = CHECKED.map(|step| Bound { step, time: 0.0, bound: f64::INFINITY });
        Self { ahead, av_braking: Vec::new(), caps: [f64::INFINITY; CHECKED.len()], braking }
    }

    /// Bounds the distance at a checked step by `from` with a time gap, but never below what the
    /// hardest braking reaches.
    fn put(&mut self, i: usize, from: f64, time: f64, speed: f64) {
        let (least, slowest) = self.braking[CHECKED[i] - 1];
        let bound = (from + time * speed).max(least + time * slowest + 0.01);
        self.caps[i] = self.caps[i].min(from.max(least));
        // Of two bounds with different time gaps, keep the one that is tighter at the speed of the
        // hardest braking.
        let tightness = |b: f64, t: f64| b - t * slowest;
        let old = &mut self.ahead[i];
        if tightness(bound, time) < tightness(old.bound, old.time) {
            *old = Bound { step: CHECKED[i], time, bound };
        }
    }

    /// Requires a stop before an arc length of the path.
    pub(super) fn stop_at(&mut self, place: f64) {
        for i in 0..CHECKED.len() {
            self.put(i, place, 0.0, 0.0);
        }
    }

    /// Lowers the desired distances to the allowed ones. Distance lost this way is not made up later.
    pub(super) fn cap(&self, desired: &mut [f64; STEPS]) {
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
        let (mut before, mut desired_before) = (0.0_f64, 0.0);
        for (desired, most) in desired.iter_mut().zip(allowed) {
            let step = *desired - desired_before;
            desired_before = *desired;
            *desired = (before + step).min(most).max(before.min(most));
            before = *desired;
        }
    }

    /// Adds the bounds of an obstacle. Returns whether the obstacle matters.
    pub(super) fn keep_clear(
        &mut self,
        vehicle: &PlannedVehicle<'_>,
        obstacle: &Obstacle,
        spans: &[Option<Span>; TIMES],
        desired: &[f64; STEPS],
        settings: &Settings,
    ) -> bool {
        let Some(first) = (0..TIMES).find(|&t| spans[t].is_some_and(|s| s.to > 0.0)) else { return false };
        let Some(span) = spans[first] else { return false };
        let axis = direction(vehicle.now.pose.heading);
        let to = obstacle.boxes[0].center - vehicle.now.pose.position;
        let in_front = to.dot(&axis) > 0.0;
        let pace = obstacle.velocities[first].norm();
        let leads = obstacle.stands() || span.speed >= 0.5 * pace;
        // Agents from behind yield themselves.
        if !in_front && (leads || span.from < 0.0) {
            return false;
        }
        if obstacle.leader_only && !(leads && in_front && first == 0) && !obstacle.stands() {
            return false;
        }
        if !leads {
            if first > obstacle.crossing_horizon {
                return false;
            }
            let passes = |t: usize| {
                spans[t]
                    .is_none_or(|s| desired[step_of(t).max(1) - 1] > s.to + 0.5 + 0.02 * step_of(t) as f64)
            };
            if (first.max(1)..TIMES).all(passes) {
                return false;
            }
        }
        let time = if leads { settings.closing_time } else { 0.3 };
        for (t, s) in spans.iter().enumerate().skip(1) {
            let Some(s) = s else { continue };
            if !leads && t > obstacle.crossing_horizon || s.to < 0.0 || s.from < 0.0 && !in_front {
                continue;
            }
            self.put(t - 1, s.from - settings.gap, time, s.speed.max(0.0));
        }
        if obstacle.is_av
            && leads
            && !obstacle.stands()
            && self.av_braking.len() + 2 <= AV_BRAKING_BOUNDS
            && let Some(s) = spans[0]
        {
            self.bound_for_av_braking(s, settings);
        }
        true
    }

    /// Bounds the distances after 0.5 s and 1 s so that the vehicle can still halt behind an AV that
    /// brakes from now on.
    fn bound_for_av_braking(&mut self, span: Span, settings: &Settings) {
        let halt =
            span.from + span.speed.max(0.0) * span.speed / (2.0 * settings.av_brake) - 0.5 * settings.gap;
        for step in [5, 10] {
            // The halting distance is quadratic in the speed. It is linearised about the hardest
            // braking, which gives the lowest possible speed.
            let (least, slowest) = self.braking[step - 1];
            let about = slowest + 1.0;
            let time = about / settings.own_brake;
            let bound = halt + about * about / (2.0 * settings.own_brake);
            self.av_braking.push(Bound { step, time, bound: bound.max(least + time * slowest + 0.01) });
        }
    }
}

/// Returns how far a plan enters obstacles within the next three seconds, metres.
pub(super) fn excess(now: &VehicleMotion, moves: &[VehicleMotion], all: &[[Option<Span>; TIMES]]) -> f64 {
    let mut arc = [0.0; STEPS];
    let (mut distance, mut before) = (0.0, now.pose.position);
    for (arc, moving) in arc.iter_mut().zip(moves) {
        distance += (moving.pose.position - before).norm();
        before = moving.pose.position;
        *arc = distance;
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
