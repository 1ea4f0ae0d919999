//! Checks of rollouts from other programs, whose numbers would otherwise look better than they are.

use std::collections::BTreeMap;

use reactsim_geometry::Vec2;
use reactsim_scene::{CURRENT, DT, Frame, HISTORY, Scenario};

/// Largest distance of a recorded AV from the prescribed trajectory, metres: more than rounding to `f32`.
const AV_TOLERANCE: f64 = 0.05;

/// Largest distance of the first recorded position from the one that the current velocity leads to, metres:
/// an acceleration of 200 m/s².
const JUMP: f64 = 1.0;

/// Smallest distance of an origin from the world's origin at which the two frames can be told apart, metres.
const FAR_ORIGIN: f64 = 10.0;

/// A condition that recorded rollouts must meet unless the user allows otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RolloutCheck {
    /// The AV follows the deviated trajectory of the scenario.
    Av,
    /// Agents continue from their last recorded state.
    Continuity,
    /// Agents that the log contains are present.
    Presence,
    /// Every simulator has rollouts of every scenario.
    Coverage,
}

impl RolloutCheck {
    /// All checks.
    pub const ALL: [Self; 4] = [Self::Av, Self::Continuity, Self::Presence, Self::Coverage];

    /// Returns the name of what the user allows if the condition need not be met.
    pub const fn allowance(self) -> &'static str {
        match self {
            Self::Av => "other-av",
            Self::Continuity => "jumps",
            Self::Presence => "missing-agents",
            Self::Coverage => "partial",
        }
    }

    /// Returns the check with this allowance.
    pub fn from_allowance(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|check| check.allowance() == name)
    }
}

/// Rollouts that fail checks: how many, and the first of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings(BTreeMap<RolloutCheck, (usize, String)>);

impl Findings {
    /// Adds a finding; the text of the first one is kept.
    pub fn add(&mut self, check: RolloutCheck, text: impl FnOnce() -> String) {
        self.0.entry(check).or_insert_with(|| (0, text())).0 += 1;
    }

    /// Returns check, number of rollouts (of scenarios for coverage) and first example.
    pub fn iter(&self) -> impl Iterator<Item = (RolloutCheck, usize, &str)> {
        self.0.iter().map(|(check, (count, text))| (*check, *count, text.as_str()))
    }

    /// Returns the findings that are not allowed, one per line with what allows them; `None` if there is
    /// none.
    pub(super) fn refused(&self, allowed: &[RolloutCheck]) -> Option<String> {
        let lines =
            self.iter().filter(|(check, _, _)| !allowed.contains(check)).map(|(check, count, text)| {
                let what = if check == RolloutCheck::Coverage { "scenarios" } else { "rollouts" };
                format!("\n  {count} {what}, the first: {text} (--allow {})", check.allowance())
            });
        let lines: String = lines.collect();
        (!lines.is_empty()).then_some(lines)
    }
}

/// Checks the tracks of a rollout, history included.
pub(super) fn check(scenario: &Scenario, place: &str, tracks: &[Vec<Frame>], findings: &mut Findings) {
    if let Some(text) = other_av(scenario, tracks) {
        findings.add(RolloutCheck::Av, || format!("{place}: {text}"));
    }
    if let Some(text) = jump(scenario, tracks) {
        findings.add(RolloutCheck::Continuity, || format!("{place}: {text}"));
    }
    if let Some(text) = missing(scenario, tracks) {
        findings.add(RolloutCheck::Presence, || format!("{place}: {text}"));
    }
}

fn other_av(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Option<String> {
    let prescribed = &scenario.deviation.as_ref()?.track;
    let recorded = &tracks.first()?[HISTORY..];
    for (k, (wanted, found)) in prescribed.iter().zip(recorded).enumerate() {
        let step = k + 1;
        match found {
            None => return Some(format!("the AV is absent at step {step}")),
            Some(found) => {
                let distance = (found.position() - wanted.position()).norm();
                // NaN is not within the tolerance either.
                let is_same = distance <= AV_TOLERANCE;
                if !is_same {
                    return Some(format!(
                        "the AV is {distance:.2} m from the prescribed trajectory at step {step}"
                    ));
                }
            }
        }
    }
    None
}

fn jump(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Option<String> {
    let mut first = None;
    let (mut jumps, mut displacements) = (0, Vec::new());
    for (slot, track) in tracks.iter().enumerate() {
        let (now, next) = (scenario.start.now(slot), track.get(HISTORY).copied().flatten());
        let Some(next) = next else { continue };
        let velocity = scenario.logged_velocity(slot, CURRENT).unwrap_or(Vec2::zeros());
        let displacement = next.position() - now.position() - velocity * DT;
        displacements.push(displacement);
        let is_continuous = displacement.norm() <= JUMP;
        if !is_continuous {
            jumps += 1;
            let id = &scenario.start.agents[slot].id;
            let distance = displacement.norm();
            first.get_or_insert_with(|| {
                format!("agent `{id}` is {distance:.1} m from where its velocity leads at step 1")
            });
        }
    }
    let first = first?;
    // All agents by the same distance: another origin.
    let origin = scenario.origin;
    let is_shifted = |by: Vec2| displacements.iter().all(|d| (d - by).norm() <= JUMP.max(1e-3 * by.norm()));
    if jumps > 1 && origin.norm() > FAR_ORIGIN && (is_shifted(origin) || is_shifted(-origin)) {
        return Some(format!(
            "{first}; all agents are, by the origin of the scenario: the coordinates are in the other frame \
             (the column `origin` states which)"
        ));
    }
    Some(first)
}

fn missing(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Option<String> {
    let mut agents = 0;
    let mut first = None;
    for (slot, track) in tracks.iter().enumerate() {
        let logged = &scenario.log_future.tracks[slot];
        let gone = track[HISTORY..].iter().zip(logged).position(|(own, log)| own.is_none() && log.is_some());
        if let Some(k) = gone {
            agents += 1;
            let id = &scenario.start.agents[slot].id;
            first.get_or_insert_with(|| {
                format!("agent `{id}` is absent at step {}, but not in the log", k + 1)
            });
        }
    }
    let first = first?;
    Some(if agents > 1 { format!("{first}; {agents} agents are") } else { first })
}
