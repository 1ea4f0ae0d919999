//! Beside the logged way: a change of lanes, a shift through the interaction region, a merge at another place.

use rand::RngExt;

use super::survey::Survey;
use super::{Draft, between, gaps};
use crate::dynamics::speeds;
use crate::geometry::smooth_step;
use crate::rollout::Stream;
use crate::scene::DT;

/// Longest and shortest time of a sideways motion, s.
const TIMES: (f64, f64) = (2.2, 5.0);
/// Curvature that a sideways motion may add, 1/m.
const BEND: f64 = 0.1;
/// Lateral acceleration that it may take, m/s².
const ASIDE: f64 = 1.8;

/// Share of the lateral draws that cut in ahead of somebody, where there is a lane beside.
const CUTS_IN: f64 = 0.45;
/// How much sooner or later a merge is, metres.
const SOONER: (f64, f64) = (8.0, 35.0);
/// Way over which the AV sets out from where it is, metres.
const SET_OUT: f64 = 12.0;

pub(super) fn draw(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    if !survey.moves() || survey.speed() < 0.5 && stream.random_bool(0.5) {
        return gaps::pull_out(survey, stream);
    }
    if !survey.beside.is_empty() && stream.random_bool(CUTS_IN) {
        return gaps::cut_in(survey, stream);
    }
    let log = survey.drive.speeds();
    let factor = if stream.random_bool(0.4) { 1.0 } else { between(stream, 0.55, 1.6) };
    let mut desired = speeds::retime(log, factor);
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
    let change = !survey.beside.is_empty() && stream.random_bool(0.65);
    let target = if change {
        survey.beside[stream.random_range(0..survey.beside.len())]
    } else {
        let side = if stream.random_bool(0.5) { 1.0 } else { -1.0 };
        side * between(stream, 0.8, 3.5)
    };
    let (after, lasts) = (between(stream, 0.0, 3.0), between(stream, TIMES.0, TIMES.1));
    let returns = !change && stream.random_bool(0.4);
    // The way at which it begins, and how long the steering and the tyres need at this speed: the fifth-order ramp of length d and
    // height h has a curvature of up to 5.8 h / d².
    let driven = |t: f64| desired.iter().take((t / DT) as usize).sum::<f64>() * DT;
    let from = driven(after);
    let speed = desired[((after / DT) as usize).min(desired.len() - 1)].max(1.0);
    let least = (5.8 * target.abs() / BEND.min(ASIDE / (speed * speed))).sqrt();
    let way = (driven(after + lasts) - from).max(least);
    if from + 0.5 * way > travel {
        return Err("no room for a sideways motion".into());
    }
    let (stay, back) = (between(stream, 0.0, 2.0) * speed, way);
    let aside = |s: f64| {
        let out = smooth_step((s - from) / way);
        let home = if returns { smooth_step((s - from - way - stay) / back) } else { 0.0 };
        target * (out - home)
    };
    let path = survey.aside(&aside, travel);
    let side = if target > 0.0 { "left" } else { "right" };
    let what = match (change, returns) {
        (true, _) => format!("lane change to the {side}"),
        (false, true) => format!("{:.1} m to the {side} and back", target.abs()),
        (false, false) => format!("{:.1} m to the {side}", target.abs()),
    };
    let pace = if factor == 1.0 { String::new() } else { format!(", {factor:.2} of the speed") };
    Ok(Draft { maneuver: format!("{what} after {after:.1} s{pace}"), future: survey.follow(&path, &desired) })
}

/// The logged change of lanes, sooner or later by some metres.
fn merge(survey: &Survey<'_>, offsets: &[f64], desired: &[f64], stream: &mut Stream) -> Draft {
    let travel = desired.iter().sum::<f64>() * DT;
    let by = between(stream, SOONER.0, SOONER.1) * if stream.random_bool(0.5) { 1.0 } else { -1.0 };
    let at = |s: f64| offsets[(s.max(0.0) as usize).min(offsets.len() - 1)];
    // Whole metres are enough: the AV does not follow kinks. It sets out where it is.
    let aside = |s: f64| (at(s - by) - at(s)) * smooth_step(s / SET_OUT);
    let path = survey.aside(&aside, travel);
    let what = if by > 0.0 { "later" } else { "earlier" };
    let maneuver = format!("merge {:.0} m {what}", by.abs());
    Draft { maneuver, future: survey.follow(&path, desired) }
}
