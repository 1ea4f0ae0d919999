//! Beside the logged way: a change of lanes, a shift through the interaction region, a merge at another place.

use rand::RngExt;

use super::survey::Survey;
use super::{Draft, between};
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

pub(super) fn draw(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    let log = survey.drive.speeds();
    let factor = if stream.random_bool(0.4) { 1.0 } else { between(stream, 0.55, 1.25) };
    let mut desired = speeds::retime(log, factor);
    desired.iter_mut().for_each(|v| *v = v.min(survey.limit));
    let travel = desired.iter().sum::<f64>() * DT;
    if travel < 4.0 {
        return Err("the AV hardly moves".into());
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
