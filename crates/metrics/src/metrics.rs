//! The metrics of a run: those of the benchmark and those of the calling program.

use reactsim_scene::Frame;

use super::scores::{METRICS, REMOVED_METRICS, RolloutScores, Scores, metric};
use super::{Case, Event, Metric, MetricSpec, Scope, ade, likelihood};

/// Names of columns that tables of rows have next to the metrics.
const RESERVED: [&str; 8] =
    ["input", "record", "scenario", "digest", "simulator", "rollout", "category", "difficulty"];
/// Largest number of characters of an id or a title.
const LONGEST: usize = 60;
/// Largest number of characters of a unit.
const LONGEST_UNIT: usize = 12;

/// The metrics of a run: those of the benchmark ([`METRICS`]), then metrics of the calling program.
#[derive(Default)]
pub struct Metrics {
    own: Vec<Box<dyn Metric>>,
}

impl Metrics {
    /// Adds metrics of the calling program to those of the benchmark.
    ///
    /// # Errors
    /// [`MetricError`] if an id is taken or malformed, or if tables cannot print a title or a unit.
    pub fn with(own: Vec<Box<dyn Metric>>) -> Result<Self, MetricError> {
        let metrics = Self { own };
        check_own(&metrics.own_specs())?;
        Ok(metrics)
    }

    /// Returns the descriptions of the metrics of the calling program.
    pub fn own_specs(&self) -> Vec<&'static MetricSpec> {
        self.own.iter().map(|metric| metric.spec()).collect()
    }

    /// Returns all metrics, those of the benchmark first.
    fn all(&self) -> impl Iterator<Item = &dyn Metric> {
        METRICS.iter().copied().chain(self.own.iter().map(Box::as_ref))
    }

    /// Computes every metric for one case. Events of a metric have its id.
    pub fn score_case(&self, case: &Case<'_>) -> Scores {
        let mut events: Vec<Event> = Vec::new();
        let score = |metric: &dyn Metric| {
            let first = events.len();
            let score = metric.score(case, &mut events);
            events[first..].iter_mut().for_each(|event| event.metric = metric.spec().id);
            (metric.spec(), score)
        };
        Scores {
            values: self.all().map(score).collect(),
            events,
            deviation: case.deviation(),
            displacement: ade::displacement(case).cloned(),
            likelihood: likelihood::likelihood(case),
            dir_tracking: case.options.dir_tracking,
        }
    }

    /// Computes the metrics over several rollouts of a scenario: minADE, the kinematic likelihood, and metrics
    /// of the calling program with [`Scope::Scenario`].
    ///
    /// `case`: the case of one of the rollouts; presence is decided at the current frame, which all share.
    /// `rollouts`: the frames of each agent per rollout, in the order of the scenario.
    pub fn score_rollouts<'a>(&self, case: Case<'a>, rollouts: &[&'a [Vec<Frame>]]) -> RolloutScores {
        let history = case.current + 1;
        let future = |track: &'a Vec<Frame>| &track[history.min(track.len())..];
        let case = case.with_rollouts(rollouts.iter().map(|r| r.iter().map(future).collect()).collect());
        let score = |metric: &dyn Metric| (metric.spec(), metric.score(&case, &mut Vec::new()));
        RolloutScores {
            values: self.all().filter(|m| m.spec().scope == Scope::Scenario).map(score).collect(),
            displacement: ade::displacement(&case).cloned(),
            likelihood: likelihood::likelihood(&case),
        }
    }
}

/// The reason why a metric of the calling program is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct MetricError(pub String);

/// Checks the descriptions of metrics that the benchmark does not have.
///
/// # Errors
/// [`MetricError`] if an id is taken or malformed, or if tables cannot print a title or a unit.
pub fn check_own(specs: &[&'static MetricSpec]) -> Result<(), MetricError> {
    for (i, spec) in specs.iter().enumerate() {
        let refused = |text: &str| Err(MetricError(format!("metric `{}`: {text}", spec.id)));
        let is_lower = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        let is_formed =
            spec.id.starts_with(|c: char| c.is_ascii_lowercase()) && spec.id.chars().all(is_lower);
        if !is_formed || spec.id.len() > LONGEST {
            return refused(&format!(
                "an id has lower-case letters, digits and hyphens, begins with a letter and has at most \
                 {LONGEST} characters, such as `mean-headway`"
            ));
        }
        let is_taken = metric(spec.id).is_some() || specs[..i].iter().any(|earlier| earlier.id == spec.id);
        if is_taken || RESERVED.contains(&spec.id) || REMOVED_METRICS.contains(&spec.id) {
            return refused("the id is taken; choose one that the benchmark does not have");
        }
        let is_plain = |c: char| c.is_alphanumeric() || " -.,:()/+²³°·".contains(c);
        for (part, text, most) in [("title", spec.title, LONGEST), ("unit", spec.unit.name(), LONGEST_UNIT)] {
            let is_empty = part == "title" && text.trim().is_empty();
            if is_empty || !text.chars().all(is_plain) || text.chars().count() > most {
                return refused(&format!(
                    "{part} is `{text}`, expected letters, digits, spaces and `-.,:()/+` in one line of at most \
                     {most} characters"
                ));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Unit;

    fn refusal(id: &'static str, title: &'static str, unit: &'static str) -> String {
        check(id, title, unit).unwrap_err().to_string()
    }

    fn check(id: &'static str, title: &'static str, unit: &'static str) -> Result<(), MetricError> {
        let (unit, scope) = (Unit::from_name(unit), Scope::Rollout);
        let spec = MetricSpec { id, title, unit, scope, lower_is_better: false, source: "" };
        check_own(&[Box::leak(Box::new(spec))])
    }

    #[test]
    fn ids_titles_and_units_are_checked() {
        check("mean-headway", "Headway (mean)", "s").unwrap();
        for id in ["", "Headway", "2-s", "a b", "a_b", "a=b", "é"] {
            assert!(
                refusal(id, "a", "").starts_with(&format!("metric `{id}`: an id has lower-case letters"))
            );
        }
        for id in ["ade", "av-score", "av-pdms", "rollout"] {
            assert!(refusal(id, "a", "").starts_with(&format!("metric `{id}`: the id is taken")));
        }
        for (title, unit, part) in
            [(" ", "s", "title"), ("<b>", "s", "title"), ("a|b", "s", "title"), ("a", "s\n", "unit")]
        {
            assert!(refusal("a", title, unit).starts_with(&format!("metric `a`: {part} is")));
        }
        let same = MetricSpec {
            id: "a",
            title: "a",
            unit: Unit::Plain,
            scope: Scope::Rollout,
            lower_is_better: true,
            source: "",
        };
        let same: &'static MetricSpec = Box::leak(Box::new(same));
        assert!(check_own(&[same, same]).unwrap_err().to_string().contains("the id is taken"));
    }

    #[test]
    fn units_are_found_by_name() {
        for unit in [Unit::Count, Unit::Rate, Unit::Metres, Unit::Plain, Unit::Other("s")] {
            assert_eq!(Unit::from_name(unit.name()), unit);
        }
    }
}
