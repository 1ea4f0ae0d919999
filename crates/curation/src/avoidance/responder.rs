//! The state of one agent when it begins to respond: its path, its motion, its limits.

use reactsim_scene::dynamics::STANDSTILL_SPEED;
use reactsim_scene::{AgentKind, AgentState, DT, Frame};

use super::AvoidanceSettings;
use super::own_path::OwnPath;
use super::profile::{Limits, Motion};
use super::traffic::Traffic;

/// An agent at its reaction step.
pub(super) struct Responder {
    pub(super) agent: usize,
    /// Last step up to which it moves as in the log; it is present at this step.
    pub(super) reaction: usize,
    /// Number of steps after the reaction step.
    pub(super) steps: usize,
    pub(super) path: OwnPath,
    pub(super) motion: Motion,
    pub(super) limits: Limits,
    /// Logged arc length at the reaction step and every step after it.
    pub(super) logged: Vec<f64>,
    /// Logged speed at the reaction step and every step after it, m/s; that of the last state after the
    /// end of the log.
    pub(super) speeds: Vec<f64>,
    /// Largest arc length of a response, metres: slightly more than in the log.
    pub(super) furthest: f64,
    /// Logged states up to the reaction step.
    pub(super) before: Vec<AgentState>,
}

/// Number of steps over which a logged acceleration is measured: speeds are too noisy from step to step.
const ACCELERATION_WINDOW: usize = 3;
/// Largest logged acceleration that is considered plausible, m/s².
const MAX_LOGGED_ACCELERATION: f64 = 3.5;
/// Distance that an agent may travel beyond its log, metres.
const EXTRA_DISTANCE: f64 = 2.0;
/// Additional distance, as a share of what its last logged speed covers from the reaction to the end.
///
/// An agent that stops in its log (for a light, in a queue) does not drive on; one that still moves at
/// the end may get a tenth farther.
const EXTRA_DISTANCE_SHARE: f64 = 0.1;

impl Responder {
    /// Returns the responder, or `None` if the agent is not in the log at `reaction` or later.
    pub(super) fn new(
        traffic: &Traffic<'_>,
        agent: usize,
        reaction: usize,
        settings: &AvoidanceSettings,
    ) -> Option<Self> {
        let info = &traffic.scenario.start.agents[agent];
        let present = |s: &AgentState| s.is_finite();
        let track: Vec<Frame> =
            traffic.scenario.logged(agent).into_iter().map(|f| f.filter(present)).collect();
        let (current, steps) = (traffic.scenario.start.current(), traffic.steps());
        let reaction = (reaction..=steps).find(|k| track[current + k].is_some())?;
        let now = current + reaction;
        let start = track[now]?;
        let log = &track[now..];
        let path = OwnPath::new(info, &start, log)?;
        let speeds: Vec<Option<f64>> = (0..track.len()).map(|f| speed(&track, f)).collect();
        let gain = |f: usize| {
            Some(
                (speeds[f]? - speeds[f.checked_sub(ACCELERATION_WINDOW)?]?)
                    / (ACCELERATION_WINDOW as f64 * DT),
            )
        };
        let of_now = speeds[now].unwrap_or(0.0);
        let stationary = of_now < STANDSTILL_SPEED;
        let motion = Motion {
            speed: if stationary { 0.0 } else { of_now },
            acceleration: if stationary { 0.0 } else { gain(now).unwrap_or(0.0) },
        };
        let fastest = speeds.iter().flatten().fold(0.0_f64, |a, v| a.max(*v));
        let strongest =
            (current..track.len()).filter_map(gain).fold(0.0_f64, f64::max).min(MAX_LOGGED_ACCELERATION);
        let (share, least) = match info.kind {
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
        // Frames without a speed take that of the next frame with one.
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
        let remaining = (steps - reaction) as f64 * DT;
        let furthest = logged.last().copied().unwrap_or(0.0)
            + EXTRA_DISTANCE
            + EXTRA_DISTANCE_SHARE * last_speed * remaining;
        let mut last = traffic.scenario.start.now(agent);
        let before = track[current..=now].iter().map(|f| {
            last = f.unwrap_or(last);
            last
        });
        let before = before.collect();
        let steps = steps - reaction;
        Some(Self { agent, reaction, steps, path, motion, limits, logged, speeds, furthest, before })
    }

    /// Returns the logged speeds at the reaction step and after it, m/s.
    pub(super) fn desired_speeds(&self) -> Vec<f64> {
        let after = self.logged.windows(2).map(|w| (w[1] - w[0]) / DT);
        std::iter::once(self.motion.speed).chain(after).collect()
    }
}

/// Returns the speed at a frame: the recorded one, else from the previous position.
fn speed(track: &[Frame], frame: usize) -> Option<f64> {
    let state = track[frame]?;
    state.velocity().map(|v| v.norm()).or_else(|| {
        let before = track[frame.checked_sub(1)?]?;
        Some((state.position() - before.position()).norm() / DT)
    })
}
