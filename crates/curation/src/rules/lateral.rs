//! Draws with a lateral offset from the logged path: a lane change, a shift through the interaction
//! region, a merge at another place.

use std::ops::Range;

use rand::RngExt;
use reactsim_geometry::smooth_step;
use reactsim_rollout::Stream;
use reactsim_scene::DT;
use reactsim_scene::dynamics::speeds;

use super::survey::Survey;
use super::{Draft, gaps};

/// Duration of a sideways motion, s.
const SHIFT_DURATION: Range<f64> = 2.2..5.0;
/// Largest curvature that a sideways motion may add, 1/m.
const MAX_SHIFT_CURVATURE: f64 = 0.1;
/// Largest lateral acceleration of a sideways motion, m/s².
const MAX_SHIFT_ACCELERATION: f64 = 1.8;

/// Share of the lateral draws that cut in ahead of a vehicle, if there is an adjacent lane.
const CUT_IN_SHARE: f64 = 0.45;
/// Distance by which a merge is earlier or later, metres.
const MERGE_SHIFT: Range<f64> = 8.0..35.0;
/// Distance over which the AV leaves its current position for the shifted path, metres.
const JOIN_DISTANCE: f64 = 12.0;

pub(super) fn draw(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    if !survey.is_moving() || survey.speed() < 0.5 && stream.random_bool(0.5) {
        return gaps::pull_out(survey, stream);
    }
    if !survey.adjacent_lanes.is_empty() && stream.random_bool(CUT_IN_SHARE) {
        return gaps::cut_in(survey, stream);
    }
    let log = survey.drive.speeds();
    let factor = if stream.random_bool(0.4) { 1.0 } else { stream.random_range(0.55..1.6) };
    let mut desired = speeds::retime(log, factor, survey.steps());
    desired.iter_mut().for_each(|v| *v = v.min(survey.limit));
    let travel = desired.iter().sum::<f64>() * DT;
    if travel < 4.0 {
        return Err("the AV hardly moves".into());
    }
    if let Some(offsets) = &survey.merge
        && stream.random_bool(0.4)
    {
        return Ok(merge(survey, offsets, &desired, stream));
    }
    let change = !survey.adjacent_lanes.is_empty() && stream.random_bool(0.65);
    let target = if change {
        survey.adjacent_lanes[stream.random_range(0..survey.adjacent_lanes.len())]
    } else {
        let side = if stream.random_bool(0.5) { 1.0 } else { -1.0 };
        side * stream.random_range(0.8..3.5)
    };
    let (after, lasts) = (stream.random_range(0.0..3.0), stream.random_range(SHIFT_DURATION));
    let returns = !change && stream.random_bool(0.4);
    // Start of the shift, and the length that steering and tyres need at this speed: a fifth-order ramp of
    // length d and height h has a curvature of up to 5.8 h / d².
    let driven = |t: f64| desired.iter().take((t / DT) as usize).sum::<f64>() * DT;
    let from = driven(after);
    let speed = desired[((after / DT) as usize).min(desired.len() - 1)].max(1.0);
    let least =
        (5.8 * target.abs() / MAX_SHIFT_CURVATURE.min(MAX_SHIFT_ACCELERATION / (speed * speed))).sqrt();
    let length = (driven(after + lasts) - from).max(least);
    if from + 0.5 * length > travel {
        return Err("no room for a sideways motion".into());
    }
    let (stay, back) = (stream.random_range(0.0..2.0) * speed, length);
    let aside = |s: f64| {
        let out = smooth_step((s - from) / length);
        let home = if returns { smooth_step((s - from - length - stay) / back) } else { 0.0 };
        target * (out - home)
    };
    let path = survey.shifted_path(&aside, travel);
    let side = if target > 0.0 { "left" } else { "right" };
    let what = match (change, returns) {
        (true, _) => format!("lane change to the {side}"),
        (false, true) => format!("{:.1} m to the {side} and back", target.abs()),
        (false, false) => format!("{:.1} m to the {side}", target.abs()),
    };
    let pace = if factor == 1.0 { String::new() } else { format!(", {factor:.2} of the speed") };
    Ok(Draft { maneuver: format!("{what} after {after:.1} s{pace}"), future: survey.follow(&path, &desired) })
}

/// Returns the logged lane change, moved along the road by some metres.
fn merge(survey: &Survey<'_>, offsets: &[f64], desired: &[f64], stream: &mut Stream) -> Draft {
    let travel = desired.iter().sum::<f64>() * DT;
    let by = stream.random_range(MERGE_SHIFT) * if stream.random_bool(0.5) { 1.0 } else { -1.0 };
    let at = |s: f64| offsets[(s.max(0.0) as usize).min(offsets.len() - 1)];
    // Whole metres are precise enough: the AV does not follow kinks. It starts from its current
    // position.
    let aside = |s: f64| (at(s - by) - at(s)) * smooth_step(s / JOIN_DISTANCE);
    let path = survey.shifted_path(&aside, travel);
    let what = if by > 0.0 { "later" } else { "earlier" };
    let maneuver = format!("merge {:.0} m {what}", by.abs());
    Draft { maneuver, future: survey.follow(&path, desired) }
}
