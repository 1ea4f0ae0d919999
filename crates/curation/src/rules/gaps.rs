//! Draws that use the gaps of others: cutting in close ahead of a vehicle of the adjacent lane, pulling
//! out in front of passing vehicles.

use std::ops::{Range, RangeInclusive};

use rand::RngExt;
use reactsim_geometry::smooth_step;
use reactsim_rollout::Stream;
use reactsim_scene::dynamics::speeds;
use reactsim_scene::{AgentState, DT};

use super::Draft;
use super::survey::Survey;

/// Gap between the AV and the vehicle behind it after a cut-in, metres.
const CUT_IN_GAP: Range<f64> = 1.0..9.0;
/// Duration of the lateral motion of a cut-in, s.
const CUT_IN_DURATION: Range<f64> = 2.0..3.4;
/// Share of that duration after which the AV is ahead of the other vehicle.
const CUT_IN_SHARE: f64 = 0.6;
/// Speed of the vehicle behind minus that of the AV after a cut-in, m/s.
const CUT_IN_SPEED_DIFFERENCE: Range<f64> = -4.0..6.0;
/// Longitudinal acceleration towards a gap, m/s².
const APPROACH_ACCELERATION: RangeInclusive<f64> = -3.0..=2.2;
/// First step at which gaps are looked for.
const FIRST_GAP_STEP: usize = 12;
/// Tenths of the steps up to which gaps are looked for.
const LAST_GAP_TENTHS: usize = 7;
/// Number of steps between those at which gaps are looked for.
const GAP_STEP_SPACING: usize = 4;
/// Largest distance from a lane's centre line at which a vehicle drives in the lane, metres.
const IN_LANE_DISTANCE: f64 = 1.3;
/// Speed below which a vehicle does not count as moving, so that the AV does not cut in ahead of it, m/s.
const MOVING_SPEED: f64 = 2.0;
/// Distance over which an AV pulls out, metres.
const PULL_OUT_LENGTH: Range<f64> = 7.0..16.0;
/// Largest curvature that a lateral motion may add, 1/m.
const MAX_SHIFT_CURVATURE: f64 = 0.12;
/// Largest lateral acceleration of a lateral motion, m/s².
const MAX_SHIFT_ACCELERATION: f64 = 2.4;

/// Draws a lane change that ends close ahead of a vehicle of that lane.
pub(super) fn cut_in(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    if survey.adjacent_lanes.is_empty() {
        return Err("no lane beside the AV's".into());
    }
    let target = survey.adjacent_lanes[stream.random_range(0..survey.adjacent_lanes.len())];
    let last = survey.steps() * LAST_GAP_TENTHS / 10;
    let Some(range) = last.checked_sub(FIRST_GAP_STEP) else {
        return Err("no time to cut in".into());
    };
    let intervals = range / GAP_STEP_SPACING;
    let step = FIRST_GAP_STEP + GAP_STEP_SPACING * stream.random_range(0..=intervals);
    let time = step as f64 * DT;
    let followers: Vec<_> = survey
        .neighbors
        .iter()
        .filter_map(|n| Some((n.half_length, n.at(step)?)))
        .filter(|(_, p)| (p.offset - target).abs() < IN_LANE_DISTANCE && p.speed > MOVING_SPEED)
        .collect();
    if followers.is_empty() {
        return Err("nobody in the next lane to cut in on".into());
    }
    let (half_length, follower) = followers[stream.random_range(0..followers.len())];
    let gap = stream.random_range(CUT_IN_GAP);
    let distance = follower.s + half_length + survey.half_length() + gap;
    let now = survey.speed();
    let gain = 2.0 * (distance / time - now) / time;
    if !APPROACH_ACCELERATION.contains(&gain) || now + gain * time > survey.limit {
        return Err("the gap in the next lane is out of reach".into());
    }
    let after = (follower.speed - stream.random_range(CUT_IN_SPEED_DIFFERENCE)).max(0.0);
    let loss = stream.random_range(1.5..5.0);
    let target_speed = |t: f64| if t < time { (now + gain * t).max(0.0) } else { after };
    let mut desired: Vec<f64> = (1..=survey.steps()).map(|k| target_speed((k as f64 - 0.5) * DT)).collect();
    speeds::bound_ahead(now, &mut desired, 2.5, loss);
    let lasts = stream.random_range(CUT_IN_DURATION);
    let begin = (time - CUT_IN_SHARE * lasts).max(0.0);
    let future = shift(survey, &desired, target, begin, lasts)?;
    let side = if target > 0.0 { "left" } else { "right" };
    Ok(Draft { maneuver: format!("cut in to the {side}: {gap:.1} m ahead after {time:.1} s"), future })
}

/// Draws a motion from a standstill next to or behind others into their path, in some draws with a
/// return.
pub(super) fn pull_out(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    let (log, steps) = (survey.drive.speeds(), survey.steps());
    let Some(stands) = (0..steps / 2).find(|&k| log[k] < 0.5) else {
        return Err("the AV does not stand".into());
    };
    let go = stands as f64 * DT + stream.random_range(0.0..3.0);
    let (gain, cruise) = (stream.random_range(1.2..2.5), survey.limit.min(stream.random_range(3.0..9.0)));
    let logged = |t: f64| log[((t / DT) as usize).min(steps)];
    let target_speed = |t: f64| if t < go { logged(t) } else { cruise };
    let mut desired: Vec<f64> = (1..=survey.steps()).map(|k| target_speed((k as f64 - 0.5) * DT)).collect();
    speeds::bound(survey.speed(), &mut desired, gain, 4.0);
    let lane = !survey.adjacent_lanes.is_empty() && stream.random_bool(0.6);
    let target = if lane {
        survey.adjacent_lanes[stream.random_range(0..survey.adjacent_lanes.len())]
    } else {
        let side = if stream.random_bool(0.7) { 1.0 } else { -1.0 };
        side * stream.random_range(1.4..3.2)
    };
    let (length, returns) = (stream.random_range(PULL_OUT_LENGTH), !lane && stream.random_bool(0.5));
    let travelled = |t: f64| desired.iter().take((t / DT) as usize).sum::<f64>() * DT;
    let from = travelled(go);
    if from + 0.7 * length > travelled(steps as f64 * DT) {
        return Err("no room to pull out".into());
    }
    let stay = stream.random_range(2.0..12.0);
    let offset = |s: f64| {
        let back = if returns { smooth_step((s - from - length - stay) / length) } else { 0.0 };
        target * (smooth_step((s - from) / length) - back)
    };
    let path = survey.shifted_path(&offset, travelled(steps as f64 * DT));
    let side = if target > 0.0 { "left" } else { "right" };
    let what = if returns { "squeeze past on" } else { "pull out to" };
    Ok(Draft {
        maneuver: format!("{what} the {side} after {go:.1} s"),
        future: survey.follow(&path, &desired),
    })
}

/// Drives a lateral motion to `target` metres that begins after `begin` s and takes `lasts` s, or longer
/// if the speed requires it.
fn shift(
    survey: &Survey<'_>,
    desired: &[f64],
    target: f64,
    begin: f64,
    lasts: f64,
) -> Result<Vec<AgentState>, String> {
    let travelled = |t: f64| desired.iter().take((t / DT) as usize).sum::<f64>() * DT;
    let travel = travelled(survey.steps() as f64 * DT);
    let from = travelled(begin);
    let speed = desired[((begin / DT) as usize).min(desired.len() - 1)].max(1.0);
    // A fifth-order ramp of length d and height h has a curvature of up to 5.8 h / d².
    let steerable =
        (5.8 * target.abs() / MAX_SHIFT_CURVATURE.min(MAX_SHIFT_ACCELERATION / (speed * speed))).sqrt();
    let length = (travelled(begin + lasts) - from).max(steerable);
    if from + 0.5 * length > travel {
        return Err("no room for a sideways motion".into());
    }
    let offset = |s: f64| target * smooth_step((s - from) / length);
    let path = survey.shifted_path(&offset, travel);
    Ok(survey.follow(&path, desired))
}
