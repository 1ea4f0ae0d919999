//! Into the gaps of others: cutting in close ahead of a vehicle of the next lane, pulling out in front of those who pass.

use rand::RngExt;

use super::survey::Survey;
use super::{Draft, between};
use crate::dynamics::speeds;
use crate::geometry::smooth_step;
use crate::rollout::Stream;
use crate::scene::{AgentState, DT, FUTURE};

/// Gap that is left behind the AV where it cuts in, metres.
const CUT_IN_GAP: (f64, f64) = (1.0, 9.0);
/// Time of the lateral motion of a cut-in, s.
const CUT_IN_TIME: (f64, f64) = (2.0, 3.4);
/// Share of that time that has passed when the AV is ahead of the other vehicle.
const CUT_IN_SHARE: f64 = 0.6;
/// How much slower than the vehicle behind the AV drives after it, m/s.
const CUT_IN_SLOWER: (f64, f64) = (-4.0, 6.0);
/// Longitudinal acceleration on the way to a gap, m/s².
const APPROACH: (f64, f64) = (-3.0, 2.2);
/// Steps at which gaps are looked for, and the distance between them.
const GAP_STEPS: (usize, usize, usize) = (12, 56, 4);
/// A vehicle drives in the lane at this distance from its centre line or nearer, metres.
const IN_LANE: f64 = 1.3;
/// Vehicles slower than this are not cut in on, m/s.
const MOVING_SPEED: f64 = 2.0;
/// Way over which an AV pulls out, metres.
const PULL_OUT_WAY: (f64, f64) = (7.0, 16.0);
/// Curvature that a lateral motion may add, 1/m.
const BEND: f64 = 0.12;
/// Lateral acceleration that it may take, m/s².
const ASIDE: f64 = 2.4;

/// A lane change that ends close ahead of a vehicle of that lane.
pub(super) fn cut_in(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    if survey.beside.is_empty() {
        return Err("no lane beside the AV's".into());
    }
    let target = survey.beside[stream.random_range(0..survey.beside.len())];
    let (first, last, every) = GAP_STEPS;
    let step = first + every * stream.random_range(0..=(last - first) / every);
    let time = step as f64 * DT;
    let followers: Vec<_> = survey
        .neighbors
        .iter()
        .filter_map(|n| Some((n.half_length, n.at(step)?)))
        .filter(|(_, p)| (p.offset - target).abs() < IN_LANE && p.speed > MOVING_SPEED)
        .collect();
    if followers.is_empty() {
        return Err("nobody in the next lane to cut in on".into());
    }
    let (half_length, follower) = followers[stream.random_range(0..followers.len())];
    let gap = between(stream, CUT_IN_GAP.0, CUT_IN_GAP.1);
    let way = follower.s + half_length + survey.half_length() + gap;
    let now = survey.speed();
    let gain = 2.0 * (way / time - now) / time;
    if !(APPROACH.0..=APPROACH.1).contains(&gain) || now + gain * time > survey.limit {
        return Err("the gap in the next lane is out of reach".into());
    }
    let after = (follower.speed - between(stream, CUT_IN_SLOWER.0, CUT_IN_SLOWER.1)).max(0.0);
    let loss = between(stream, 1.5, 5.0);
    let wanted = |t: f64| if t < time { (now + gain * t).max(0.0) } else { after };
    let mut desired: Vec<f64> = (1..=FUTURE).map(|k| wanted((k as f64 - 0.5) * DT)).collect();
    speeds::bound_ahead(now, &mut desired, 2.5, loss);
    let lasts = between(stream, CUT_IN_TIME.0, CUT_IN_TIME.1);
    let begin = (time - CUT_IN_SHARE * lasts).max(0.0);
    let future = aside(survey, &desired, target, begin, lasts)?;
    let side = if target > 0.0 { "left" } else { "right" };
    Ok(Draft { maneuver: format!("cut in to the {side}: {gap:.1} m ahead after {time:.1} s"), future })
}

/// From a standstill beside or behind others into their way, and where `returns` back again.
pub(super) fn pull_out(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    let log = survey.drive.speeds();
    let Some(stands) = (0..FUTURE / 2).find(|&k| log[k] < 0.5) else {
        return Err("the AV does not stand".into());
    };
    let go = stands as f64 * DT + between(stream, 0.0, 3.0);
    let (gain, cruise) = (between(stream, 1.2, 2.5), between(stream, 3.0, 9.0).min(survey.limit));
    let logged = |t: f64| log[((t / DT) as usize).min(FUTURE)];
    let wanted = |t: f64| if t < go { logged(t) } else { cruise };
    let mut desired: Vec<f64> = (1..=FUTURE).map(|k| wanted((k as f64 - 0.5) * DT)).collect();
    speeds::bound(survey.speed(), &mut desired, gain, 4.0);
    let lane = !survey.beside.is_empty() && stream.random_bool(0.6);
    let target = if lane {
        survey.beside[stream.random_range(0..survey.beside.len())]
    } else {
        let side = if stream.random_bool(0.7) { 1.0 } else { -1.0 };
        side * between(stream, 1.4, 3.2)
    };
    let (way, returns) = (between(stream, PULL_OUT_WAY.0, PULL_OUT_WAY.1), !lane && stream.random_bool(0.5));
    let travelled = |t: f64| desired.iter().take((t / DT) as usize).sum::<f64>() * DT;
    let from = travelled(go);
    if from + 0.7 * way > travelled(FUTURE as f64 * DT) {
        return Err("no room to pull out".into());
    }
    let stay = between(stream, 2.0, 12.0);
    let offset = |s: f64| {
        let back = if returns { smooth_step((s - from - way - stay) / way) } else { 0.0 };
        target * (smooth_step((s - from) / way) - back)
    };
    let path = survey.aside(&offset, travelled(FUTURE as f64 * DT));
    let side = if target > 0.0 { "left" } else { "right" };
    let what = if returns { "squeeze past on" } else { "pull out to" };
    Ok(Draft {
        maneuver: format!("{what} the {side} after {go:.1} s"),
        future: survey.follow(&path, &desired),
    })
}

/// Drives a lateral motion to `target` metres that begins after `begin` s and lasts `lasts` s, or longer where the speed asks for it.
fn aside(
    survey: &Survey<'_>,
    desired: &[f64],
    target: f64,
    begin: f64,
    lasts: f64,
) -> Result<Vec<AgentState>, String> {
    let travelled = |t: f64| desired.iter().take((t / DT) as usize).sum::<f64>() * DT;
    let travel = travelled(FUTURE as f64 * DT);
    let from = travelled(begin);
    let speed = desired[((begin / DT) as usize).min(desired.len() - 1)].max(1.0);
    // The fifth-order ramp of length d and height h has a curvature of up to 5.8 h / d².
    let steerable = (5.8 * target.abs() / BEND.min(ASIDE / (speed * speed))).sqrt();
    let way = (travelled(begin + lasts) - from).max(steerable);
    if from + 0.5 * way > travel {
        return Err("no room for a sideways motion".into());
    }
    let offset = |s: f64| target * smooth_step((s - from) / way);
    let path = survey.aside(&offset, travel);
    Ok(survey.follow(&path, desired))
}
