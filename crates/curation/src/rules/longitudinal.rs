//! Draws of the logged path at another speed.
//!
//! Every kind of speed profile is a function with the ranges that it draws from: `DELAY`, the time until the
//! speed differs from the log, s; `LATE`, the delay of what the log does, s; `GAIN` and `BRAKING`,
//! acceleration and deceleration, m/s²; `FACTOR`, a factor of the logged speed. Candidates depend on the
//! order of draws.

use std::ops::Range;

use rand::RngExt;
use reactsim_rollout::Stream;
use reactsim_scene::DT;
use reactsim_scene::dynamics::speeds::{self, MAX_PLANNED_ACCELERATION, MAX_PLANNED_DECELERATION};

use super::directional::{ARRIVAL_LEAD, SpeedPlan, cruise_to_arrive, desired_speeds};
use super::routes::PathEntry;
use super::survey::Survey;
use super::{Draft, pick};

/// Acceleration bound of profiles that do not draw one, m/s².
const ACCELERATION: f64 = 2.5;
/// Acceleration bound of profiles that slow down or stop, m/s²: it limits how a faster log is followed until
/// then.
const SLOWING_ACCELERATION: f64 = 1.5;
/// Deceleration bound of profiles that do not draw one, m/s².
const DECELERATION: f64 = 4.0;
/// Speed in m/s below which the AV stands or crawls.
const CRAWLING_SPEED: f64 = 1.0;

/// A kind of speed profile: draws a description and the speeds at the steps from 1 on (m/s).
pub(super) type Kind = fn(&Log<'_>, &mut Stream) -> Result<(String, Vec<f64>), String>;

/// Kinds of speed profiles, with the weights with which they are drawn.
const KINDS: &[(f64, Kind)] = &[
    (2.5, stop),
    (1.5, slow),
    (1.5, faster),
    (1.5, early_start),
    (1.0, late_start),
    (1.0, late_braking),
    (1.0, creep),
    (1.5, dip),
    (2.0, hard_stop),
    (1.0, accelerate),
    (1.0, go_through),
    (4.0, go_first),
];

/// Draws a kind of speed profile for a stream. Without it a stop, which pressures others most easily,
/// would nearly always be proposed.
pub(super) fn kind(stream: &mut Stream) -> Kind {
    pick(stream, KINDS).copied().unwrap_or(stop)
}

/// Draws a candidate of that kind, or of any kind.
pub(super) fn draw(survey: &Survey<'_>, kind: Option<Kind>, stream: &mut Stream) -> Result<Draft, String> {
    let kind = kind.unwrap_or_else(|| self::kind(stream));
    let (maneuver, desired) = kind(&Log { survey, speeds: survey.drive.speeds() }, stream)?;
    Ok(Draft { maneuver, future: survey.follow(&survey.logged, &desired) })
}

/// The logged drive of the AV.
pub(super) struct Log<'a> {
    survey: &'a Survey<'a>,
    /// Speeds from step 0 on, m/s.
    speeds: &'a [f64],
}

impl Log<'_> {
    /// Returns the logged speed at a time in seconds, m/s.
    fn at(&self, t: f64) -> f64 {
        let k = (t / DT).clamp(0.0, self.steps() as f64);
        let i = (k as usize).min(self.steps() - 1);
        self.speeds[i] + (self.speeds[i + 1] - self.speeds[i]) * (k - i as f64)
    }

    fn steps(&self) -> usize {
        self.speeds.len() - 1
    }

    /// Returns a target speed in the middle of every step.
    fn sampled(&self, target_speed: impl Fn(f64) -> f64) -> Vec<f64> {
        (1..=self.steps()).map(|k| target_speed((k as f64 - 0.5) * DT).max(0.0)).collect()
    }

    /// Returns the logged speed up to a time, and a target speed after it.
    fn until(&self, from: f64, target_speed: impl Fn(f64) -> f64) -> impl Fn(f64) -> f64 {
        move |t| if t < from { self.at(t) } else { target_speed(t) }
    }

    fn top(&self) -> f64 {
        self.speeds.iter().fold(0.0_f64, |a, &v| a.max(v))
    }

    /// Returns target speeds within bounds of acceleration and deceleration: braking begins in time.
    fn anticipated(&self, target_speed: impl Fn(f64) -> f64, gain: f64, loss: f64) -> Vec<f64> {
        let mut speeds = self.sampled(target_speed);
        speeds::bound(self.speeds[0], &mut speeds, gain, loss);
        speeds
    }

    /// Returns target speeds within bounds of acceleration and deceleration: braking begins when the target
    /// falls.
    fn unanticipated(&self, target_speed: impl Fn(f64) -> f64, gain: f64, loss: f64) -> Vec<f64> {
        let mut speeds = self.sampled(target_speed);
        speeds::bound_ahead(self.speeds[0], &mut speeds, gain, loss);
        speeds
    }

    /// Returns time (s) and speed (m/s) at which the logged AV begins to brake.
    fn braking(&self) -> Result<(f64, f64), String> {
        /// Number of steps over which the speed is compared.
        const STEPS: usize = 15;
        /// Smallest loss of speed, m/s.
        const LOSS: f64 = 1.5;
        let (steps, speeds) = (self.steps(), self.speeds);
        let brakes = (0..steps).find(|&k| k + STEPS <= steps && speeds[k] - speeds[k + STEPS] > LOSS);
        let brakes = brakes.ok_or("the AV does not brake")?;
        Ok((brakes as f64 * DT, self.speeds[brakes]))
    }
}

/// A stop at constant deceleration. Braking begins after the delay, not before.
fn stop(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const DELAY: Range<f64> = 0.0..3.0;
    const BRAKING: Range<f64> = 1.2..4.5;
    let (after, loss) = (stream.random_range(DELAY), stream.random_range(BRAKING));
    if log.top() < CRAWLING_SPEED {
        return Err("the AV hardly moves".into());
    }
    let now = log.speeds[0];
    let mut speed = now;
    let mut speeds = Vec::with_capacity(log.steps());
    for k in 1..=log.steps() {
        let t = (k as f64 - 0.5) * DT;
        speed = if t < after { log.at(t) } else { speed.min(log.at(t)).max(loss * DT) - loss * DT };
        speeds.push(speed);
    }
    speeds::bound_ahead(now, &mut speeds, MAX_PLANNED_ACCELERATION, MAX_PLANNED_DECELERATION);
    Ok((format!("stop: {loss:.1} m/s² after {after:.1} s"), speeds))
}

/// The log in slow motion.
fn slow(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const FACTOR: Range<f64> = 0.3..0.8;
    let factor = stream.random_range(FACTOR);
    Ok((format!("slow: {factor:.2} of the speed"), speeds::retime(log.speeds, factor, log.steps())))
}

/// The log in fast motion, within the speed limit.
fn faster(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const FACTOR: Range<f64> = 1.15..1.8;
    let factor = stream.random_range(FACTOR);
    let mut speeds = speeds::retime(log.speeds, factor, log.steps());
    speeds.iter_mut().for_each(|v| *v = v.min(log.survey.limit));
    speeds::bound(log.speeds[0], &mut speeds, ACCELERATION, DECELERATION);
    Ok((format!("faster: {factor:.2} of the speed"), speeds))
}

/// Sets off where the logged AV stands.
fn early_start(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const GAIN: Range<f64> = 1.2..2.5;
    /// Speed after setting off, m/s.
    const CRUISE: Range<f64> = 4.0..11.0;
    /// Time at which the AV sets off after the log has slowed down, s.
    const DELAY: Range<f64> = -1.0..2.5;
    let slow = (0..=log.steps()).find(|&k| log.speeds[k] < CRAWLING_SPEED).ok_or("the AV does not stand")?;
    let (gain, cruise) = (stream.random_range(GAIN), stream.random_range(CRUISE).min(log.survey.limit));
    let go = (slow as f64 * DT + stream.random_range(DELAY)).max(0.0);
    let target_speed = log.until(go, |t| cruise.max(log.at(t)));
    Ok((
        format!("early start: after {go:.1} s to {cruise:.0} m/s"),
        log.anticipated(target_speed, gain, DECELERATION),
    ))
}

/// Sets off later than the log.
fn late_start(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    /// Speed in m/s that is exceeded by setting off.
    const STARTED_SPEED: f64 = 0.3;
    /// Speed in m/s below which an AV can set off.
    const WAITING_SPEED: f64 = 2.0;
    const LATE: Range<f64> = 1.0..5.0;
    let sets_off = |k: &usize| {
        let (before, after) = (log.speeds[k - 1], log.speeds[*k]);
        after > before.max(STARTED_SPEED) && before < WAITING_SPEED
    };
    let starts = (1..=log.steps()).find(sets_off).ok_or("the AV does not set off")?;
    let (late, hold) = (stream.random_range(LATE), log.speeds[starts - 1]);
    let from = starts as f64 * DT;
    let target_speed = log.until(from, |t| if t < from + late { hold } else { log.at(t - late) });
    Ok((format!("late start: by {late:.1} s"), log.anticipated(target_speed, ACCELERATION, DECELERATION)))
}

/// Brakes later and harder than the log.
fn late_braking(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const LATE: Range<f64> = 0.7..2.5;
    const BRAKING: Range<f64> = 3.0..5.0;
    let (from, speed) = log.braking()?;
    let (late, loss) = (stream.random_range(LATE), stream.random_range(BRAKING));
    let target_speed = log.until(from, |t| if t < from + late { speed } else { log.at(t).min(speed) });
    Ok((format!("late braking: by {late:.1} s"), log.unanticipated(target_speed, ACCELERATION, loss)))
}

/// Slows down to a low speed and keeps it.
fn creep(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const DELAY: Range<f64> = 0.0..2.5;
    const BRAKING: Range<f64> = 1.2..3.5;
    /// Low speed, m/s.
    const CREEP: Range<f64> = 0.8..2.5;
    let (after, loss) = (stream.random_range(DELAY), stream.random_range(BRAKING));
    let creep = stream.random_range(CREEP);
    let target_speed = log.until(after, |_| creep);
    let speeds = log.unanticipated(target_speed, SLOWING_ACCELERATION, loss);
    Ok((format!("creep: {creep:.1} m/s after {after:.1} s"), speeds))
}

/// A stop as hard as possible, with a close follower.
fn hard_stop(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const DELAY: Range<f64> = 0.0..4.5;
    const BRAKING: Range<f64> = 4.3..5.6;
    let (after, loss) = (stream.random_range(DELAY), stream.random_range(BRAKING));
    if !log.survey.is_followed_closely(after) {
        return Err("nobody close behind the AV".into());
    }
    let speeds = log.unanticipated(log.until(after, |_| 0.0), SLOWING_ACCELERATION, loss);
    Ok((format!("hard stop: {loss:.1} m/s² after {after:.1} s"), speeds))
}

/// Faster than the log from some moment on.
fn accelerate(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const DELAY: Range<f64> = 0.0..3.5;
    const GAIN: Range<f64> = 1.2..3.0;
    /// Gain of speed, m/s.
    const MORE: Range<f64> = 2.0..8.0;
    let (after, gain) = (stream.random_range(DELAY), stream.random_range(GAIN));
    let more = stream.random_range(MORE);
    let target_speed = log.until(after, |_| (log.at(after) + more).min(log.survey.limit));
    let speeds = log.unanticipated(target_speed, gain, DECELERATION);
    Ok((format!("accelerate: {gain:.1} m/s² after {after:.1} s"), speeds))
}

/// Does not brake where the log does (for a light, a crossing, a queue).
fn go_through(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    const FACTOR: Range<f64> = 0.9..1.2;
    let (from, speed) = log.braking()?;
    let speed = speed * stream.random_range(FACTOR);
    let target_speed = log.until(from, |t| log.at(t).max(speed.min(log.survey.limit)));
    let speeds = log.unanticipated(target_speed, ACCELERATION, DECELERATION);
    Ok(("go through: does not brake".to_owned(), speeds))
}

/// Arrives first where another vehicle enters the logged path ahead of the logged AV.
fn go_first(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    /// Longest wait of a standing AV, s.
    const MAX_WAIT: f64 = 3.0;
    const GAIN: Range<f64> = 1.5..3.0;
    /// Largest cruise speed that is tried on roads of any limit, m/s.
    const MIN_LIMIT: f64 = 4.0;
    let survey = log.survey;
    let crossings = survey.entries_before_av();
    if crossings.is_empty() {
        return Err("nobody goes before the AV".into());
    }
    let PathEntry { s, time } = crossings[stream.random_range(0..crossings.len())];
    let stands = log.speeds[0] < CRAWLING_SPEED;
    let wait = if stands { stream.random_range(0.0..time.min(MAX_WAIT)) } else { 0.0 };
    let plan = SpeedPlan { gain: stream.random_range(GAIN), wait, halt: None };
    let arrival = time - stream.random_range(ARRIVAL_LEAD);
    let cruise = cruise_to_arrive(survey, &survey.logged, &plan, s, arrival, survey.limit.max(MIN_LIMIT));
    Ok((format!("go first: up to {cruise:.1} m/s"), desired_speeds(survey, &plan, cruise)))
}

/// Brakes for a while.
fn dip(log: &Log<'_>, stream: &mut Stream) -> Result<(String, Vec<f64>), String> {
    /// Smallest top speed of the log, m/s.
    const MIN_TOP_SPEED: f64 = 3.0;
    const DELAY: Range<f64> = 0.0..2.5;
    /// Duration at lower speed, s.
    const DURATION: Range<f64> = 1.5..4.0;
    /// Share of the logged speed that is kept.
    const SHARE: Range<f64> = 0.0..0.5;
    const BRAKING: Range<f64> = 1.5..4.5;
    /// Acceleration back to the logged speed, m/s².
    const GAIN: f64 = 2.0;
    if log.top() < MIN_TOP_SPEED {
        return Err("the AV hardly moves".into());
    }
    let (after, lasts) = (stream.random_range(DELAY), stream.random_range(DURATION));
    let (share, loss) = (stream.random_range(SHARE), stream.random_range(BRAKING));
    let target_speed = log.until(after, |t| if t > after + lasts { log.at(t) } else { share * log.at(t) });
    let speeds = log.unanticipated(target_speed, GAIN, loss);
    Ok((format!("brake and go on: {loss:.1} m/s² for {lasts:.1} s after {after:.1} s"), speeds))
}
