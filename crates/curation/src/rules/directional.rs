//! Draws of another route over the lane graph, at a speed that its bends allow.

use std::ops::Range;

use rand::RngExt;
use reactsim_rollout::Stream;
use reactsim_scene::dynamics::{AxlePath, speeds};
use reactsim_scene::{AgentState, DT};

use super::Draft;
use super::routes::PathEntry;
use super::survey::Survey;

/// Slowest cruising speed, m/s.
const MIN_CRUISE_SPEED: f64 = 2.5;
/// Fastest cruising speed, m/s.
const MAX_CRUISE_SPEED: f64 = 16.0;
/// Time by which the AV arrives before another vehicle enters its path, s.
pub(super) const ARRIVAL_LEAD: Range<f64> = -0.3..1.2;
/// Distance from the point where others enter the path to the stop of a hesitating AV, metres.
const HALT_OFFSET: Range<f64> = -2.0..2.0;
/// Deceleration of a hesitating AV, m/s².
const CALM_DECELERATION: f64 = 2.5;
/// Number of halvings of the range of speeds.
const HALVINGS: usize = 7;

/// Plan of when and how hard the AV sets off or speeds up.
pub(super) struct SpeedPlan {
    /// Acceleration, m/s².
    pub(super) gain: f64,
    /// Time during which the AV drives as in the log, s.
    pub(super) wait: f64,
    /// Arc length at which the AV stops because it hesitates, if it does, metres.
    pub(super) halt: Option<f64>,
}

pub(super) fn draw(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    if survey.branches.is_empty() {
        return Err("no other way over the lane graph".into());
    }
    let branch = &survey.branches[stream.random_range(0..survey.branches.len())];
    let speed = survey.speed();
    let wait = if speed < 1.0 {
        stream.random_range(0.0..4.0)
    } else if stream.random_bool(0.3) {
        stream.random_range(0.5..2.5)
    } else {
        0.0
    };
    let mut plan = SpeedPlan { gain: stream.random_range(1.2..2.5), wait, halt: None };
    let most = survey.limit.clamp(4.0, MAX_CRUISE_SPEED);
    // Cruise between walking speed and the limit, rather near the current speed; or so as to arrive
    // where another vehicle enters the path.
    let free = (speed.max(4.0) * stream.random_range(0.5..1.5)).clamp(3.0, most);
    let cruise = if !branch.path_entries.is_empty() && stream.random_bool(0.75) {
        let PathEntry { s, time } = branch.path_entries[stream.random_range(0..branch.path_entries.len())];
        if stream.random_bool(0.3) {
            // Hesitates in the path of others.
            plan.halt = Some(s + stream.random_range(HALT_OFFSET));
            free
        } else {
            cruise_to_arrive(survey, &branch.path, &plan, s, time - stream.random_range(ARRIVAL_LEAD), most)
        }
    } else {
        free
    };
    let waits = if wait > 0.0 { format!(" after {wait:.1} s") } else { String::new() };
    let future = survey.follow(&branch.path, &desired_speeds(survey, &plan, cruise));
    let fastest = future.iter().map(AgentState::speed).fold(0.0, f64::max);
    let stops = if plan.halt.is_some() { " and stop" } else { "" };
    let maneuver = format!("{}{stops}, up to {fastest:.1} m/s{waits}", branch.name());
    Ok(Draft { maneuver, future })
}

/// Returns the cruising speed, up to `most`, with which the AV arrives at arc length `s` at about
/// `time`.
pub(super) fn cruise_to_arrive(
    survey: &Survey<'_>,
    path: &AxlePath,
    plan: &SpeedPlan,
    s: f64,
    time: f64,
    most: f64,
) -> f64 {
    let allowed = path.allowed_speeds();
    // An approximation: the allowed speeds are respected, but not the accelerations between them.
    let arrival = |cruise: f64| {
        let mut distance = 0.0;
        let reached = desired_speeds(survey, plan, cruise).iter().position(|speed| {
            distance += speed.min(allowed.at(distance)) * DT;
            distance >= s
        });
        reached.map_or(f64::INFINITY, |k| (k + 1) as f64 * DT)
    };
    let (mut slow, mut fast) = (MIN_CRUISE_SPEED, most);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (slow + fast);
        if arrival(middle) > time { slow = middle } else { fast = middle }
    }
    0.5 * (slow + fast)
}

/// Returns the desired speeds at the steps, m/s.
pub(super) fn desired_speeds(survey: &Survey<'_>, plan: &SpeedPlan, cruise: f64) -> Vec<f64> {
    let (log, speed) = (survey.drive.speeds(), survey.speed());
    let at = |k: usize| if (k as f64) * DT < plan.wait { log[k].min(speed) } else { cruise };
    let mut desired: Vec<f64> = (1..=survey.steps()).map(at).collect();
    speeds::bound(speed, &mut desired, plan.gain, 3.0);
    if let Some(halt) = plan.halt {
        let (mut distance, mut before) = (0.0, speed);
        for v in &mut desired {
            // From where calm braking must begin to stop in time.
            if distance + before * before / (2.0 * CALM_DECELERATION) >= halt {
                *v = (before - CALM_DECELERATION * DT).max(0.0);
            }
            (distance, before) = (distance + *v * DT, *v);
        }
    }
    desired
}
