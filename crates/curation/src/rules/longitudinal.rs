//! Draws of the logged path at another speed.

use rand::RngExt;
use reactsim_dynamics::speeds;
use reactsim_rollout::Stream;
use reactsim_scene::{DT, FUTURE};

use super::directional::{ARRIVAL_LEAD, SpeedPlan, cruise_to_arrive, desired_speeds};
use super::routes::PathEntry;
use super::survey::Survey;
use super::{Draft, between, pick};

/// Kinds of speed profiles, with the weights with which they are drawn.
const KINDS: &[(f64, Kind)] = &[
    (2.5, Kind::Stop),
    (1.5, Kind::Slow),
    (1.5, Kind::Faster),
    (1.5, Kind::EarlyStart),
    (1.0, Kind::LateStart),
    (1.0, Kind::LateBraking),
    (1.0, Kind::Creep),
    (1.5, Kind::Dip),
    (2.0, Kind::HardStop),
    (1.0, Kind::Accelerate),
    (1.0, Kind::GoThrough),
    (4.0, Kind::GoFirst),
];

/// Kind of a speed profile.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Stop,
    Slow,
    Faster,
    EarlyStart,
    LateStart,
    LateBraking,
    Creep,
    Dip,
    /// A stop as hard as possible, with a close follower.
    HardStop,
    /// Faster than the log from some moment on.
    Accelerate,
    /// Does not brake where the log does (for a light, a crossing, a queue).
    GoThrough,
    /// Arrives first where another vehicle enters the logged path ahead of the logged AV.
    GoFirst,
}

/// Draws a kind of speed profile for a stream. Without it a stop, which pressures others most easily,
/// would nearly always be proposed.
pub(super) fn kind(stream: &mut Stream) -> Kind {
    pick(stream, KINDS).copied().unwrap_or(Kind::Stop)
}

/// Draws a candidate of that kind, or of any kind.
pub(super) fn draw(survey: &Survey<'_>, kind: Option<Kind>, stream: &mut Stream) -> Result<Draft, String> {
    let kind = kind.unwrap_or_else(|| self::kind(stream));
    let (maneuver, desired) = profile(kind, survey.drive.speeds(), survey, stream)?;
    Ok(Draft { maneuver, future: survey.follow(&survey.logged, &desired) })
}

/// Returns the speeds at steps 1 to 80 (m/s), with a description.
fn profile(
    kind: Kind,
    log: &[f64],
    survey: &Survey<'_>,
    stream: &mut Stream,
) -> Result<(String, Vec<f64>), String> {
    let (now, limit) = (log[0], survey.limit);
    let top = log.iter().fold(0.0_f64, |a, &v| a.max(v));
    let logged = |t: f64| {
        let k = (t / DT).clamp(0.0, FUTURE as f64);
        let i = (k as usize).min(FUTURE - 1);
        log[i] + (log[i + 1] - log[i]) * (k - i as f64)
    };
    let sampled = |target_speed: &dyn Fn(f64) -> f64| -> Vec<f64> {
        (1..=FUTURE).map(|k| target_speed((k as f64 - 0.5) * DT).max(0.0)).collect()
    };
    // With anticipation, and without.
    let anticipated = |target_speed: &dyn Fn(f64) -> f64, gain: f64, loss: f64| {
        let mut speeds = sampled(target_speed);
        speeds::bound(now, &mut speeds, gain, loss);
        speeds
    };
    let unanticipated = |target_speed: &dyn Fn(f64) -> f64, gain: f64, loss: f64| {
        let mut speeds = sampled(target_speed);
        speeds::bound_ahead(now, &mut speeds, gain, loss);
        speeds
    };
    match kind {
        Kind::Stop => {
            let (after, loss) = (between(stream, 0.0, 3.0), between(stream, 1.2, 4.5));
            if top < 1.0 {
                return Err("the AV hardly moves".into());
            }
            // Braking begins after the time, not before.
            let mut speed = now;
            let mut speeds = Vec::with_capacity(FUTURE);
            for k in 1..=FUTURE {
                let t = (k as f64 - 0.5) * DT;
                speed = if t < after { logged(t) } else { speed.min(logged(t)).max(loss * DT) - loss * DT };
                speeds.push(speed);
            }
            speeds::bound_ahead(
                now,
                &mut speeds,
                speeds::MAX_PLANNED_ACCELERATION,
                speeds::MAX_PLANNED_DECELERATION,
            );
            Ok((format!("stop: {loss:.1} m/s² after {after:.1} s"), speeds))
        }
        Kind::Slow => {
            let factor = between(stream, 0.3, 0.8);
            Ok((format!("slow: {factor:.2} of the speed"), speeds::retime(log, factor)))
        }
        Kind::Faster => {
            let factor = between(stream, 1.15, 1.8);
            let mut speeds = speeds::retime(log, factor);
            speeds.iter_mut().for_each(|v| *v = v.min(limit));
            speeds::bound(now, &mut speeds, 2.5, 4.0);
            Ok((format!("faster: {factor:.2} of the speed"), speeds))
        }
        Kind::EarlyStart => {
            let Some(slow) = (0..=FUTURE).find(|&k| log[k] < 1.0) else {
                return Err("the AV does not stand".into());
            };
            let (gain, cruise) = (between(stream, 1.2, 2.5), between(stream, 4.0, 11.0).min(limit));
            let go = (slow as f64 * DT + between(stream, -1.0, 2.5)).max(0.0);
            let target_speed = |t: f64| if t < go { logged(t) } else { cruise.max(logged(t)) };
            Ok((
                format!("early start: after {go:.1} s to {cruise:.0} m/s"),
                anticipated(&target_speed, gain, 4.0),
            ))
        }
        Kind::LateStart => {
            let starts = (1..=FUTURE).find(|&k| log[k] > log[k - 1].max(0.3) && log[k - 1] < 2.0);
            let Some(starts) = starts else { return Err("the AV does not set off".into()) };
            let (late, hold) = (between(stream, 1.0, 5.0), log[starts - 1]);
            let from = starts as f64 * DT;
            let target_speed = |t: f64| {
                if t < from {
                    logged(t)
                } else if t < from + late {
                    hold
                } else {
                    logged(t - late)
                }
            };
            Ok((format!("late start: by {late:.1} s"), anticipated(&target_speed, 2.5, 4.0)))
        }
        Kind::LateBraking => {
            let brakes = (0..FUTURE).find(|&k| k + 15 <= FUTURE && log[k] - log[k + 15] > 1.5);
            let Some(brakes) = brakes else { return Err("the AV does not brake".into()) };
            let (late, loss) = (between(stream, 0.7, 2.5), between(stream, 3.0, 5.0));
            let (from, speed) = (brakes as f64 * DT, log[brakes]);
            let target_speed = |t: f64| {
                if t < from {
                    logged(t)
                } else if t < from + late {
                    speed
                } else {
                    logged(t).min(speed)
                }
            };
            let speeds = unanticipated(&target_speed, 2.5, loss);
            Ok((format!("late braking: by {late:.1} s"), speeds))
        }
        Kind::Creep => {
            let (after, loss) = (between(stream, 0.0, 2.5), between(stream, 1.2, 3.5));
            let creep = between(stream, 0.8, 2.5);
            let target_speed = |t: f64| if t < after { logged(t) } else { creep.min(logged(t).max(creep)) };
            let speeds = unanticipated(&target_speed, 1.5, loss);
            Ok((format!("creep: {creep:.1} m/s after {after:.1} s"), speeds))
        }
        Kind::HardStop => {
            let (after, loss) = (between(stream, 0.0, 4.5), between(stream, 4.3, 5.6));
            if !survey.is_followed_closely(after) {
                return Err("nobody close behind the AV".into());
            }
            let target_speed = |t: f64| if t < after { logged(t) } else { 0.0 };
            Ok((
                format!("hard stop: {loss:.1} m/s² after {after:.1} s"),
                unanticipated(&target_speed, 1.5, loss),
            ))
        }
        Kind::Accelerate => {
            let (after, gain) = (between(stream, 0.0, 3.5), between(stream, 1.2, 3.0));
            let more = between(stream, 2.0, 8.0);
            let target_speed = |t: f64| if t < after { logged(t) } else { (logged(after) + more).min(limit) };
            let speeds = unanticipated(&target_speed, gain, 4.0);
            Ok((format!("accelerate: {gain:.1} m/s² after {after:.1} s"), speeds))
        }
        Kind::GoThrough => {
            let brakes = (0..FUTURE).find(|&k| k + 15 <= FUTURE && log[k] - log[k + 15] > 1.5);
            let Some(brakes) = brakes else { return Err("the AV does not brake".into()) };
            let (from, speed) = (brakes as f64 * DT, log[brakes] * between(stream, 0.9, 1.2));
            let target_speed = |t: f64| if t < from { logged(t) } else { logged(t).max(speed.min(limit)) };
            Ok(("go through: does not brake".to_owned(), unanticipated(&target_speed, 2.5, 4.0)))
        }
        Kind::GoFirst => {
            let crossings = survey.entries_before_av();
            if crossings.is_empty() {
                return Err("nobody goes before the AV".into());
            }
            let PathEntry { s, time } = crossings[stream.random_range(0..crossings.len())];
            let wait = if now < 1.0 { between(stream, 0.0, time.min(3.0)) } else { 0.0 };
            let plan = SpeedPlan { gain: between(stream, 1.5, 3.0), wait, halt: None };
            let arrival = time - stream.random_range(ARRIVAL_LEAD);
            let cruise = cruise_to_arrive(survey, &survey.logged, &plan, s, arrival, limit.max(4.0));
            Ok((format!("go first: up to {cruise:.1} m/s"), desired_speeds(survey, &plan, cruise)))
        }
        Kind::Dip => {
            if top < 3.0 {
                return Err("the AV hardly moves".into());
            }
            let (after, lasts) = (between(stream, 0.0, 2.5), between(stream, 1.5, 4.0));
            let (share, loss) = (between(stream, 0.0, 0.5), between(stream, 1.5, 4.5));
            let target_speed = |t: f64| {
                if t < after || t > after + lasts { logged(t) } else { share * logged(t) }
            };
            let speeds = unanticipated(&target_speed, 2.0, loss);
            Ok((format!("brake and go on: {loss:.1} m/s² for {lasts:.1} s after {after:.1} s"), speeds))
        }
    }
}
