//! Conditions under which the numbers of two runs can be compared.

use reactsim_metrics::Options;
use reactsim_rollout::Entering;

use crate::provenance::Provenance;

/// A setting that must be equal in two runs for their numbers to be comparable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Condition {
    /// The protocol.
    Protocol,
    /// The AV policy.
    Av,
    /// Whether agents at t+1 observe the AV at t+1.
    AvLookahead,
    /// Whether agents of the log that appear later enter.
    Entering,
    /// The file of deviated AVs.
    Deviations,
    /// The replan interval.
    Replan,
    /// The number of rollouts.
    Rollouts,
    /// Variants of the metrics.
    MetricOptions,
}

/// A condition in which two runs differ, with its value in each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConditionDifference {
    /// The condition.
    pub condition: Condition,
    /// Value in the first run.
    pub first: String,
    /// Value in the second run.
    pub second: String,
}

impl Condition {
    /// All conditions.
    pub const ALL: [Self; 8] = [
        Self::Protocol,
        Self::Av,
        Self::AvLookahead,
        Self::Entering,
        Self::Deviations,
        Self::Replan,
        Self::Rollouts,
        Self::MetricOptions,
    ];

    /// Returns the name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Protocol => "protocol",
            Self::Av => "av",
            Self::AvLookahead => "av-lookahead",
            Self::Entering => "entering",
            Self::Deviations => "deviations",
            Self::Replan => "replan",
            Self::Rollouts => "rollouts",
            Self::MetricOptions => "metric-options",
        }
    }

    /// Returns the condition with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|condition| condition.name() == name)
    }

    /// Returns the value of the condition in a run; `None` if it is unknown.
    pub fn value(self, run: &Provenance) -> Option<String> {
        let settings = &run.settings;
        if run.is_recorded() && !matches!(self, Self::Rollouts | Self::MetricOptions) {
            return None;
        }
        Some(match self {
            Self::Protocol => settings.protocol.clone(),
            Self::Av => settings.av.clone(),
            Self::AvLookahead => u8::from(settings.av_lookahead).to_string(),
            Self::Entering => settings.entering.clone().unwrap_or_else(|| Entering::Off.to_string()),
            Self::Deviations => match &run.deviations {
                Some(file) => format!("{} ({:.12})", file.name, file.blake3),
                None => "those of the scenarios".to_owned(),
            },
            Self::Replan => format!("{} steps", settings.replan_steps),
            Self::Rollouts => settings.rollouts.to_string(),
            Self::MetricOptions => match changed_options(run).as_slice() {
                [] => "none".to_owned(),
                changed => changed.join(" "),
            },
        })
    }

    /// Returns the conditions in which two runs differ.
    pub fn differences(first: &Provenance, second: &Provenance) -> Vec<ConditionDifference> {
        let of = |condition: Self| {
            let (a, b) = (condition.value(first)?, condition.value(second)?);
            (a != b).then_some(ConditionDifference { condition, first: a, second: b })
        };
        Self::ALL.into_iter().filter_map(of).collect()
    }
}

/// Returns the metric options of a run that are not the default, as `name=value`; last the options that only
/// other versions of the program have.
pub fn changed_options(run: &Provenance) -> Vec<String> {
    let text = |(name, value): (&str, &String)| format!("{name}={value}");
    let changed = |(name, default): (&'static str, String)| {
        let value = run.metric_options.get(name)?;
        (*value != default).then(|| text((name, value)))
    };
    let known = Options::default().named().into_iter().filter_map(changed);
    let others = run.metric_options.iter().map(|(name, value)| (name.as_str(), value));
    known.chain(others.filter(|(name, _)| !Options::NAMES.contains(name)).map(text)).collect()
}
