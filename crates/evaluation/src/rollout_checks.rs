//! Checks of rollouts from other programs, whose numbers would otherwise look better than they are.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use reactsim_scene::{Frame, HISTORY, Scenario};

use super::motion::GivenScene;

/// Largest distance of a recorded AV from the prescribed trajectory, metres: more than rounding to `f32`.
const AV_TOLERANCE: f64 = 0.05;

/// A condition that given motion must meet unless the user allows otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RolloutCheck {
    /// The AV follows the deviated trajectory of the scenario.
    Av,
    /// Agents continue from their last recorded state.
    Continuity,
    /// Positions are in the frame of the states that they continue.
    Coordinates,
    /// Positions are box centres.
    RearAxle,
    /// Lengths, speeds and times are in metres, m/s and steps of 0.1 s.
    Units,
    /// Motion continues from the latest frame.
    Time,
    /// Agents are in the order of the scenario.
    Order,
    /// Headings are radians counter-clockwise from the x axis, along the motion.
    Headings,
    /// Velocities are those of the positions.
    Velocities,
    /// No agent moves further in 0.1 s than its class can.
    Teleports,
    /// Moving agents do not stop dead.
    Freeze,
    /// World coordinates in 32 bits resolve a centimetre.
    Float32,
    /// Coordinates resolve a centimetre, in any other format.
    Resolution,
    /// Agents that the log contains are present.
    Presence,
    /// Every simulator has rollouts of every scenario.
    Coverage,
}

impl RolloutCheck {
    /// All checks.
    pub const ALL: [Self; 15] = [
        Self::Av,
        Self::Continuity,
        Self::Coordinates,
        Self::RearAxle,
        Self::Units,
        Self::Time,
        Self::Order,
        Self::Headings,
        Self::Velocities,
        Self::Teleports,
        Self::Freeze,
        Self::Float32,
        Self::Resolution,
        Self::Presence,
        Self::Coverage,
    ];

    /// Returns the name of what the user allows if the condition need not be met.
    pub const fn allowance(self) -> &'static str {
        match self {
            Self::Av => "other-av",
            Self::Continuity => "jumps",
            Self::Coordinates => "coordinates",
            Self::RearAxle => "rear-axle",
            Self::Units => "units",
            Self::Time => "time",
            Self::Order => "agent-order",
            Self::Headings => "headings",
            Self::Velocities => "velocities",
            Self::Teleports => "teleports",
            Self::Freeze => "freeze",
            Self::Float32 => "float32",
            Self::Resolution => "resolution",
            Self::Presence => "missing-agents",
            Self::Coverage => "partial",
        }
    }

    /// Returns the outcome that marks a rollout in which the check failed and was allowed.
    pub const fn outcome(self) -> &'static str {
        match self {
            Self::Av => "allowed-other-av",
            Self::Continuity => "allowed-jumps",
            Self::Coordinates => "allowed-coordinates",
            Self::RearAxle => "allowed-rear-axle",
            Self::Units => "allowed-units",
            Self::Time => "allowed-time",
            Self::Order => "allowed-agent-order",
            Self::Headings => "allowed-headings",
            Self::Velocities => "allowed-velocities",
            Self::Teleports => "allowed-teleports",
            Self::Freeze => "allowed-freeze",
            Self::Float32 => "allowed-float32",
            Self::Resolution => "allowed-resolution",
            Self::Presence => "allowed-missing-agents",
            Self::Coverage => "allowed-partial",
        }
    }
}

impl fmt::Display for RolloutCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.allowance())
    }
}

impl FromStr for RolloutCheck {
    type Err = String;

    /// Returns the check with this allowance.
    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::allowance).join(", ");
        let found = Self::ALL.into_iter().find(|check| check.allowance() == name);
        found.ok_or_else(|| format!("expected one of {}", known()))
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
                let what = if check == RolloutCheck::Coverage { "scenario" } else { "rollout" };
                let plural = if count == 1 { "" } else { "s" };
                format!("\n  {count} {what}{plural}, the first: {text} (--allow {})", check.allowance())
            });
        let lines: String = lines.collect();
        (!lines.is_empty()).then_some(lines)
    }
}

/// Checks the tracks of a rollout, history included. Returns the checks that fail.
pub(super) fn check(
    scenario: &Scenario,
    place: &str,
    tracks: &[Vec<Frame>],
    findings: &mut Findings,
) -> Vec<RolloutCheck> {
    let mut failed = Vec::new();
    let mut add = |check, text: String| {
        findings.add(check, || format!("{place}: {text}"));
        failed.push(check);
    };
    if let Some(text) = other_av(scenario, tracks) {
        add(RolloutCheck::Av, text);
    }
    for finding in GivenScene::of_rollout(scenario, tracks, scenario.deviation.is_some()).findings() {
        add(finding.check, finding.text);
    }
    if let Some(text) = missing(scenario, tracks) {
        add(RolloutCheck::Presence, text);
    }
    failed
}

/// Returns how the AV differs from the deviated AV of the scenario, if it does.
pub(super) fn other_av(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Option<String> {
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
