//! Checks of given motion: states that another program made are compared with the recording that they
//! continue, and with what a road user can do, before they are judged.
//!
//! Every check is a statistic over the agents of one rollout with a threshold that all recorded logs and all
//! baselines keep with a margin (`docs/guides/external-simulators.md` lists them).

pub(crate) mod rollout_checks;
mod continuity;
mod headings;
pub(crate) mod kind;
mod later;
mod storage;
#[cfg(test)]
mod tests;
mod velocities;

use reactsim_geometry::Vec2;
use reactsim_rollout::Rollout;
use reactsim_scene::{Agent, AgentKind, AgentState, DT, Frame, Scenario};

use crate::motion::kind::RolloutCheck;

/// Largest distance of the first given position from the one that the current velocity leads to, metres:
/// an acceleration of 200 m/s².
pub(super) const JUMP: f64 = 1.0;

/// Distance up to which positions are the same, metres: rounding of a program that computes with `f32`.
const SAME: f64 = 1e-3;

/// An agent whose motion is given.
pub(super) struct CheckedMotion<'a> {
    pub(super) id: &'a str,
    pub(super) kind: AgentKind,
    /// Length of its box, metres.
    pub(super) length: f64,
    /// State at the current frame.
    pub(super) now: AgentState,
    /// Velocity at the current frame, m/s, if known.
    pub(super) velocity: Option<Vec2>,
    /// Recorded frames, the current one last.
    pub(super) history: &'a [Frame],
    /// State that the given motion has at the current frame, if it has one.
    pub(super) entry0: Option<AgentState>,
    /// Given frames from step 1 on, or, of an agent that entered, from the one after its first.
    pub(super) future: &'a [Frame],
}

/// The given motion of a scenario.
pub(super) struct CheckedScene<'a> {
    pub(super) agents: Vec<CheckedMotion<'a>>,
    /// Agents that entered, each with the step of its first state, which `now` is.
    pub(super) entered: Vec<(usize, CheckedMotion<'a>)>,
    /// Agents at their recorded positions, whose velocities are not the recorded ones. Recordings contain
    /// jumps and gaps: the motion of agents that move as recorded is not in doubt.
    pub(super) replayed: Vec<CheckedMotion<'a>>,
    /// World coordinates of the origin of the states, metres.
    pub(super) origin: Vec2,
    /// The AV at the current frame.
    pub(super) av: AgentState,
    pub(super) subject: Subject,
}

/// What the entries of a scene are, which decides how much evidence there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Subject {
    /// Agents of one rollout.
    Agents,
    /// A single agent.
    OneAgent,
    /// Successive plans of the AV in one rollout. It may be off its plans, which a tracker follows; the first
    /// plan begins where the recording leaves it.
    Plans,
}

/// The result of a check that fails.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Finding {
    pub(super) check: RolloutCheck,
    /// Likely mistake, and its mend.
    pub(super) text: String,
}

impl Finding {
    fn new(check: RolloutCheck, text: String) -> Self {
        Self { check, text }
    }
}

impl CheckedMotion<'_> {
    /// Position at step 1.
    fn first(&self) -> Option<Vec2> {
        Some(self.future.first()?.as_ref()?.position())
    }

    /// Whether step 1 is exactly where the agent is already.
    fn begins_here(&self) -> bool {
        self.first().is_some_and(|first| (first - self.now.position()).norm() <= SAME)
    }

    /// Displacement from step 1 to step 2.
    fn second(&self) -> Option<Vec2> {
        Some(self.future.get(1)?.as_ref()?.position() - self.first()?)
    }

    /// Whether the agent moves on after step 1, at half its present speed or faster.
    fn sets_off(&self) -> bool {
        self.second().is_some_and(|by| by.norm() >= 0.5 * self.speed() * DT)
    }

    fn speed(&self) -> f64 {
        self.velocity.map_or(0.0, |v| v.norm())
    }

    /// Position to which the current velocity leads at step 1.
    fn expected(&self) -> Vec2 {
        self.now.position() + self.velocity.unwrap_or(Vec2::zeros()) * DT
    }

    /// Difference of the position at step 1 from [`Self::expected`].
    fn residual(&self) -> Option<Vec2> {
        Some(self.first()? - self.expected())
    }
}

impl<'a> CheckedScene<'a> {
    /// Returns the given motion of a rollout: history, then the given steps. The AV is left out if
    /// `without_av`: its motion is not that of the simulator.
    pub(super) fn of_rollout(scenario: &'a Scenario, rollout: &'a Rollout, without_av: bool) -> Self {
        let mut scene = Self {
            agents: Vec::new(),
            entered: Vec::new(),
            replayed: Vec::new(),
            origin: scenario.origin,
            av: scenario.start.now(0),
            subject: Subject::Agents,
        };
        let current = scenario.start.current();
        let agents = scenario.start.agents.iter().zip(&rollout.tracks).enumerate();
        for (slot, (agent, track)) in agents.skip(usize::from(without_av)) {
            let (future, logged) = (&track[current + 1..], &scenario.log_future.tracks[slot]);
            let motion = CheckedMotion {
                id: &agent.id,
                kind: agent.kind,
                length: agent.length,
                now: scenario.start.now(slot),
                velocity: scenario.logged_velocity(slot, current),
                history: &scenario.start.history[slot],
                entry0: None,
                future,
            };
            match agent.kind {
                AgentKind::Other => {}
                _ if !is_replayed(future, logged) => scene.agents.push(motion),
                _ if !has_velocities(future, logged) => scene.replayed.push(motion),
                _ => {}
            }
        }
        let later = rollout.entered.iter().zip(&rollout.tracks[scenario.start.agents.len()..]);
        scene.entered.extend(later.filter_map(|(entered, track)| {
            let now = track.get(entered.frame).copied().flatten()?;
            let Agent { id, kind, length, .. } = &scenario.unselected[entered.logged].agent;
            let (velocity, future) = (now.velocity(), &track[entered.frame + 1..]);
            let motion = CheckedMotion {
                id,
                kind: *kind,
                length: *length,
                now,
                velocity,
                history: &[],
                entry0: None,
                future,
            };
            Some((entered.frame - current, motion))
        }));
        scene
    }

    /// Returns the given trajectory of an AV, with its state at the current frame if it has one.
    pub(super) fn of_av(scenario: &'a Scenario, entry0: Option<AgentState>, future: &'a [Frame]) -> Self {
        let (now, velocity) = (scenario.start.now(0), scenario.logged_velocity(0, scenario.start.current()));
        let av = CheckedMotion { entry0, ..Self::av_from(scenario, now, velocity, future) };
        Self {
            replayed: Vec::new(),
            entered: Vec::new(),
            agents: vec![av],
            origin: scenario.origin,
            av: now,
            subject: Subject::OneAgent,
        }
    }

    /// Returns the plans of the AV in one rollout, each with the state in which it was made.
    pub(super) fn of_plans(scenario: &'a Scenario, plans: &'a [(AgentState, Vec<Frame>)]) -> Self {
        let plan =
            |(now, poses): &'a (AgentState, Vec<Frame>)| Self::av_from(scenario, *now, now.velocity(), poses);
        let (agents, av) = (plans.iter().map(plan).collect(), scenario.start.now(0));
        let (entered, replayed) = (Vec::new(), Vec::new());
        Self { agents, entered, replayed, origin: scenario.origin, av, subject: Subject::Plans }
    }

    fn av_from(
        scenario: &'a Scenario,
        now: AgentState,
        velocity: Option<Vec2>,
        future: &'a [Frame],
    ) -> CheckedMotion<'a> {
        let Agent { id, kind, length, .. } = &scenario.start.agents[0];
        let history = &scenario.start.history[0];
        CheckedMotion { id, kind: *kind, length: *length, now, velocity, history, entry0: None, future }
    }

    /// Smallest number of agents that are evidence.
    fn least(&self, several: usize) -> usize {
        match self.subject {
            Subject::Agents => several,
            Subject::OneAgent => 1,
            Subject::Plans => several.min(self.agents.len()),
        }
    }

    /// Returns what messages call some of its entries.
    fn noun(&self) -> &'static str {
        if self.subject == Subject::Plans { "plans" } else { "agents" }
    }

    /// Checks the beginnings of plans: a tracker makes motion of them that hides mistakes.
    pub(super) fn plan_findings(&self) -> Vec<Finding> {
        let mut found: Vec<Finding> = continuity::of_plans(self).into_iter().collect();
        found.extend(headings::finding(self));
        if found.is_empty() {
            found.extend(headings::against_motion(self));
        }
        found
    }

    /// Checks the motion. Findings that follow from another one are left out.
    pub(super) fn findings(&self) -> Vec<Finding> {
        if self.agents.is_empty() {
            return velocities::finding(self).into_iter().collect();
        }
        let mut found: Vec<Finding> = Vec::new();
        let freeze = later::freeze(self);
        // Agents that stop dead at once are not where their velocity leads.
        let first_step = continuity::finding(self)
            .filter(|finding| finding.check != RolloutCheck::Continuity || freeze.is_none());
        let is_continuous = first_step.is_none();
        found.extend(first_step);
        found.extend(headings::finding(self));
        found.extend(later::repeated(self));
        found.extend(freeze);
        if is_continuous && found.is_empty() {
            found.extend(headings::against_motion(self));
            found.extend(velocities::finding(self));
            found.extend(later::teleports(self));
        }
        found.extend(storage::float32(self).or_else(|| storage::resolution(self)));
        found
    }
}

/// Returns whether all given positions are those of the log, within 1 cm.
fn is_replayed(given: &[Frame], logged: &[Frame]) -> bool {
    given.iter().zip(logged).all(|pair| match pair {
        (Some(given), Some(logged)) => (given.position() - logged.position()).norm() <= 0.01,
        (given, logged) => given.is_none() && logged.is_none(),
    })
}

/// Returns whether all given velocities that are known are those of the log, within 1 cm/s.
fn has_velocities(given: &[Frame], logged: &[Frame]) -> bool {
    let velocity = |frame: &Frame| frame.and_then(|state| state.velocity());
    given.iter().zip(logged).all(|(given, logged)| match (velocity(given), velocity(logged)) {
        (Some(given), Some(logged)) => (given - logged).norm() <= 0.01,
        (given, _) => given.is_none(),
    })
}

/// Returns the median of numbers; `None` if there are none.
fn median(numbers: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut all: Vec<f64> = numbers.into_iter().collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied()
}

/// Returns the share of numbers that meet a condition; 0 if there are none.
fn share(numbers: &[f64], condition: impl Fn(f64) -> bool) -> f64 {
    if numbers.is_empty() {
        return 0.0;
    }
    numbers.iter().filter(|n| condition(**n)).count() as f64 / numbers.len() as f64
}
