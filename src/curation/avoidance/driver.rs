//! What one agent brings along when it begins to respond: its path, its motion, its limits.

use super::AvoidanceSettings;
use super::own_path::OwnPath;
use super::profile::{Limits, Motion};
use super::traffic::Traffic;
use crate::scene::{AgentKind, AgentState, CURRENT, DT, FUTURE, Frame};

/// An agent at its reaction step.
pub(super) struct Driver {
    pub(super) agent: usize,
    /// Step up to which it moves as in the log: it is there at this step.
    pub(super) reaction: usize,
    pub(super) path: OwnPath,
    pub(super) motion: Motion,
    pub(super) limits: Limits,
    /// Arc length in the log at the reaction step and every step after it.
    pub(super) logged: Vec<f64>,
    /// Speed in the log at the reaction step and every step after it, m/s; that of the last state where the log has ended.
    pub(super) speeds: Vec<f64>,
    /// The furthest that a response may go, metres of arc length: a little further than the log.
    pub(super) furthest: f64,
    /// The states of the log up to the reaction step.
    pub(super) before: Vec<AgentState>,
}

/// Steps over which the acceleration of a log is taken: speeds differ too much from step to step.
const WINDOW: usize = 3;
/// Speeds below this are noise: the agent stands, m/s.
const STANDING: f64 = 0.1;
/// Acceleration of a log that is still believed, m/s².
const BELIEVED: f64 = 3.5;
/// How much further than in its log an agent may go: so many metres ...
const FURTHER: f64 = 2.0;
/// ... and this share of what the last speed of its log covers from the reaction to the end. Who stops in its log (before a light, in a
/// queue) does not drive on, who drives on at the end may be one tenth further.
const FURTHER_SHARE: f64 = 0.1;

impl Driver {
    /// `None` where the agent is not in the log at `reaction` or later.
    pub(super) fn new(
        traffic: &Traffic<'_>,
        agent: usize,
        reaction: usize,
        settings: &AvoidanceSettings,
    ) -> Option<Self> {
        let who = &traffic.scenario.start.agents[agent];
        let present = |s: &AgentState| s.is_finite();
        let track: Vec<Frame> =
            traffic.scenario.logged(agent).into_iter().map(|f| f.filter(present)).collect();
        let reaction = (reaction..=FUTURE).find(|k| track[CURRENT + k].is_some())?;
        let start = track[CURRENT + reaction]?;
        let log = &track[CURRENT + reaction..];
        let path = OwnPath::new(who, &start, log)?;
        let speeds: Vec<Option<f64>> = (0..track.len()).map(|f| speed(&track, f)).collect();
        let gain = |f: usize| Some((speeds[f]? - speeds[f.checked_sub(WINDOW)?]?) / (WINDOW as f64 * DT));
        let now = CURRENT + reaction;
        let of_now = speeds[now].unwrap_or(0.0);
        let stands = of_now < STANDING;
        let motion = Motion {
            speed: if stands { 0.0 } else { of_now },
            acceleration: if stands { 0.0 } else { gain(now).unwrap_or(0.0) },
        };
        let fastest = speeds.iter().flatten().fold(0.0_f64, |a, v| a.max(*v));
        let strongest = (CURRENT..track.len()).filter_map(gain).fold(0.0_f64, f64::max).min(BELIEVED);
        let (share, least) = match who.kind {
            AgentKind::Pedestrian => (1.2, 2.0),
            AgentKind::Cyclist => (1.1, 4.0),
            _ => (1.1, 6.0),
        };
        let limits = Limits {
            brake: -settings.max_deceleration,
            accelerate: settings.max_acceleration.max(strongest),
            jerk: settings.max_jerk,
            speed: (share * fastest).max(least),
        };
        let motion = motion.within(&limits);
        let last_speed = speeds.iter().rev().flatten().next().copied().unwrap_or(0.0);
        let logged = path.arc_lengths(log, last_speed * DT);
        // Frames without a speed have that of the next one that has one.
        let mut next = last_speed;
        let mut speeds: Vec<f64> = speeds[now..]
            .iter()
            .rev()
            .map(|v| {
                next = v.unwrap_or(next);
                next
            })
            .collect();
        speeds.reverse();
        let remaining = (FUTURE - reaction) as f64 * DT;
        let furthest =
            logged.last().copied().unwrap_or(0.0) + FURTHER + FURTHER_SHARE * last_speed * remaining;
        let mut last = traffic.scenario.start.now(agent);
        let before = track[CURRENT..=now].iter().map(|f| {
            last = f.unwrap_or(last);
            last
        });
        let before = before.collect();
        Some(Self { agent, reaction, path, motion, limits, logged, speeds, furthest, before })
    }

    /// Steps after the reaction step.
    pub(super) fn steps(&self) -> usize {
        FUTURE - self.reaction
    }

    /// The speeds of the log at the reaction step and after it, m/s.
    pub(super) fn wanted(&self) -> Vec<f64> {
        let after = self.logged.windows(2).map(|w| (w[1] - w[0]) / DT);
        std::iter::once(self.motion.speed).chain(after).collect()
    }
}

/// The speed at a frame: as recorded, else by the position before.
fn speed(track: &[Frame], frame: usize) -> Option<f64> {
    let state = track[frame]?;
    state.velocity().map(|v| v.norm()).or_else(|| {
        let before = track[frame.checked_sub(1)?]?;
        Some((state.position() - before.position()).norm() / DT)
    })
}
