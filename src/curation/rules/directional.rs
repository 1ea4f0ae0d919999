//! Another way over the lane graph, at a speed that its bends allow.

use rand::RngExt;

use super::routes::{Branch, Meeting};
use super::survey::Survey;
use super::{Draft, between};
use crate::dynamics::{AxlePath, speeds};
use crate::rollout::Stream;
use crate::scene::{AgentState, DT, FUTURE};

/// Slowest and fastest cruising, m/s.
const CRUISE: (f64, f64) = (2.5, 16.0);
/// How long before somebody comes onto the way the AV wants to be there, seconds.
pub(super) const BEFORE: (f64, f64) = (-0.3, 1.2);
/// Where it stops who hesitates, against where others come onto the way, metres; and how hard it brakes, m/s².
const BESIDE: (f64, f64) = (-2.0, 2.0);
const CALM: f64 = 2.5;
/// Halvings of the range of speeds.
const HALVINGS: usize = 7;

/// When and how hard the AV sets off or speeds up.
pub(super) struct Manner {
    /// m/s².
    pub(super) gain: f64,
    /// Seconds during which it goes on as in the log.
    pub(super) wait: f64,
    /// Where it stops as one who hesitates, metres of the way, if anywhere.
    pub(super) halt: Option<f64>,
}

pub(super) fn draw(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    if survey.branches.is_empty() {
        return Err("no other way over the lane graph".into());
    }
    let branch = &survey.branches[stream.random_range(0..survey.branches.len())];
    let speed = survey.speed();
    let wait = if speed < 1.0 {
        between(stream, 0.0, 4.0)
    } else if stream.random_bool(0.3) {
        between(stream, 0.5, 2.5)
    } else {
        0.0
    };
    let mut manner = Manner { gain: between(stream, 1.2, 2.5), wait, halt: None };
    let most = survey.limit.clamp(4.0, CRUISE.1);
    // Cruise somewhere between walking and the limit, rather near the speed now; or so as to be where somebody comes.
    let free = (speed.max(4.0) * between(stream, 0.5, 1.5)).clamp(3.0, most);
    let cruise = if !branch.meetings.is_empty() && stream.random_bool(0.75) {
        let Meeting { s, time } = branch.meetings[stream.random_range(0..branch.meetings.len())];
        if stream.random_bool(0.3) {
            // One who hesitates in the way of others.
            manner.halt = Some(s + between(stream, BESIDE.0, BESIDE.1));
            free
        } else {
            meet(survey, &branch.path, &manner, s, time - between(stream, BEFORE.0, BEFORE.1), most)
        }
    } else {
        free
    };
    let waits = if wait > 0.0 { format!(" after {wait:.1} s") } else { String::new() };
    let future = drive(survey, branch, &manner, cruise);
    let fastest = future.iter().map(AgentState::speed).fold(0.0, f64::max);
    let stops = if manner.halt.is_some() { " and stop" } else { "" };
    let maneuver = format!("{}{stops}, up to {fastest:.1} m/s{waits}", branch.name());
    Ok(Draft { maneuver, future })
}

/// The cruising speed, up to `most`, with which the AV comes to `s` metres of the way at `time`, or nearly.
pub(super) fn meet(
    survey: &Survey<'_>,
    path: &AxlePath,
    manner: &Manner,
    s: f64,
    time: f64,
    most: f64,
) -> f64 {
    let allowed = path.allowed_speeds();
    // Nearly: what the way allows is taken, but not how the speed gets there.
    let arrival = |cruise: f64| {
        let mut way = 0.0;
        let reached = wanted(survey, manner, cruise).iter().position(|speed| {
            way += speed.min(allowed.at(way)) * DT;
            way >= s
        });
        reached.map_or(f64::INFINITY, |k| (k + 1) as f64 * DT)
    };
    let (mut slow, mut fast) = (CRUISE.0, most);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (slow + fast);
        if arrival(middle) > time { slow = middle } else { fast = middle }
    }
    0.5 * (slow + fast)
}

/// The speeds that are wanted at the steps, m/s.
pub(super) fn wanted(survey: &Survey<'_>, manner: &Manner, cruise: f64) -> Vec<f64> {
    let (log, speed) = (survey.drive.speeds(), survey.speed());
    let at = |k: usize| if (k as f64) * DT < manner.wait { log[k].min(speed) } else { cruise };
    let mut wanted: Vec<f64> = (1..=FUTURE).map(at).collect();
    speeds::bound(speed, &mut wanted, manner.gain, 3.0);
    if let Some(halt) = manner.halt {
        let (mut way, mut before) = (0.0, speed);
        for v in &mut wanted {
            // From where it takes a calm braking to stop in time.
            if way + before * before / (2.0 * CALM) >= halt {
                *v = (before - CALM * DT).max(0.0);
            }
            (way, before) = (way + *v * DT, *v);
        }
    }
    wanted
}

fn drive(survey: &Survey<'_>, branch: &Branch, manner: &Manner, cruise: f64) -> Vec<AgentState> {
    survey.follow(&branch.path, &wanted(survey, manner, cruise))
}
