//! Comparison of two results on the same scenarios, scenario by scenario.

use std::collections::BTreeMap;

use rand_chacha::rand_core::Rng;
use reactsim_metrics::{MetricSpec, Unit};
use reactsim_rollout::{Purpose, stream};
use serde::Serialize;

use crate::error::EvaluationError;
use crate::row::RowLength;
use crate::statistics::tally::{Entry, Tally};
use crate::statistics::{Estimate, mean};

/// Number of random sign assignments in a permutation test.
const PERMUTATIONS: u32 = 20_000;
/// Number of nonzero differences up to which all sign assignments are enumerated.
const MAX_ENUMERATED: usize = 14;
/// Difference of two sums, relative to the sum of magnitudes, up to which they are equal.
const RELATIVE_TOLERANCE: f64 = 1e-12;
/// p-value below which a difference is more than chance.
const SIGNIFICANT: f64 = 0.05;
/// Smallest number of differences with a p-value below [`SIGNIFICANT`]: with five of one sign it is 2/32.
const MIN_FOR_VERDICT: usize = 6;
/// Half the width of the 95 % interval in standard errors: a larger difference is significant.
const HALF_WIDTH: f64 = 1.96;
/// Difference that is found in four of five cases, in standard errors.
const SEEN: f64 = HALF_WIDTH + 0.84;

/// Whether the second simulator is better or worse in a metric. There is no correction for several metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// It is better, with p below 0.05.
    Better,
    /// It is worse, with p below 0.05.
    Worse,
    /// Any difference may be chance.
    NoDifferenceSeen,
}

impl Verdict {
    /// Returns the verdict in words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::Worse => "worse",
            Self::NoDifferenceSeen => "no difference seen",
        }
    }
}

/// The difference of one metric between two simulators.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairedDifference {
    /// The metric.
    #[serde(skip)]
    pub metric: &'static MetricSpec,
    /// Mean of the first simulator over the scenarios in which both have a value.
    pub first: f64,
    /// Mean of the second simulator over the same scenarios.
    pub second: f64,
    /// Number of groups of dependent scenarios, such as recordings; `None` if every scenario is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub groups: Option<usize>,
    /// Second minus first: mean over scenarios with its bootstrap interval. Groups are resampled as a whole.
    pub difference: Estimate,
    /// p-value: share of random sign assignments whose mean is at least as far from 0 (two-sided permutation
    /// test over scenarios; the scenarios of a group share their sign).
    pub p: f64,
    /// Whether the second simulator is better or worse.
    pub verdict: Verdict,
    /// Smallest difference of either sign that so many scenarios of this spread show in four of five cases,
    /// in the unit of the metric. `None` if they cannot tell: fewer than six scenarios or groups, or equal
    /// values in all, which of counts and shares only a share of 0 is.
    pub visible: Option<f64>,
    /// Ids of the scenarios in which the second simulator is better, largest change first, with the change.
    pub better: Vec<(String, f64)>,
    /// Ids of the scenarios in which the second simulator is worse, largest change first, with the change.
    pub worse: Vec<(String, f64)>,
}

/// Two simulators of two runs, or of one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Id of the first simulator.
    pub first: String,
    /// Id of the second one.
    pub second: String,
    /// Number of scenarios for which both have a result.
    pub scenarios: usize,
    /// Number of scenarios for which only one of them has a result.
    pub unpaired: usize,
    /// Differences by metric; metrics without a scenario in which both have a value are left out, and metrics
    /// that the runs define differently.
    pub metrics: BTreeMap<&'static str, PairedDifference>,
}

impl Comparison {
    /// Compares a simulator of one run with one of another run, or of the same run. Scenarios are paired by
    /// their ids. `seed` selects the random streams of resamplings and permutations.
    ///
    /// # Errors
    /// [`EvaluationError`] for a simulator that is not in its run, an id that names different scenarios in
    /// the two runs or scenarios of different length, and runs without a scenario in common.
    pub fn of(first: (&Tally, &str), second: (&Tally, &str), seed: u64) -> Result<Self, EvaluationError> {
        Self::of_metrics(first, second, seed, |_| true, None)
    }

    /// As [`Comparison::of`], where scenarios depend on each other if `group` returns the same for their ids,
    /// as the scenarios of one recording do.
    ///
    /// # Errors
    /// As for [`Comparison::of`].
    pub fn of_groups(
        first: (&Tally, &str),
        second: (&Tally, &str),
        seed: u64,
        group: &dyn Fn(&str) -> String,
    ) -> Result<Self, EvaluationError> {
        Self::of_metrics(first, second, seed, |_| true, Some(group))
    }

    /// As [`Comparison::of`], with the metrics for which `is_wanted` holds, and with groups if they are
    /// given.
    pub(crate) fn of_metrics(
        first: (&Tally, &str),
        second: (&Tally, &str),
        seed: u64,
        is_wanted: impl Fn(&MetricSpec) -> bool,
        group: Option<&dyn Fn(&str) -> String>,
    ) -> Result<Self, EvaluationError> {
        let (i, j) = (first.0.simulator(first.1)?, second.0.simulator(second.1)?);
        let (a, b) = (done(first.0, i), done(second.0, j));
        let mut pairs: Vec<(&str, [&[Option<f64>]; 2])> = Vec::new();
        for (id, (entry, values)) in &a {
            let Some((other, others)) = b.get(id) else { continue };
            if other.length != entry.length {
                let [a, b] = [entry.length, other.length];
                return Err(EvaluationError::Refused(format!(
                    "the scenario `{id}` has {} frames of history and {} steps in the first run, and {} and \
                     {} in the second: only runs on scenarios of the same length can be compared",
                    a.history, a.steps, b.history, b.steps
                )));
            }
            if other.digest != entry.digest {
                return Err(EvaluationError::Refused(format!(
                    "the scenario `{id}` is not the same in both runs: only runs on the same scenarios can \
                     be compared"
                )));
            }
            pairs.push((id, [values, others]));
        }
        if pairs.is_empty() {
            let [first, second] = [first.0, second.0].map(durations);
            let lengths = match first == second {
                true => String::new(),
                false => format!(
                    ": those of the first last {first}, those of the second {second}; run both with the same \
                     `history` and `future`"
                ),
            };
            return Err(EvaluationError::NothingInCommon { lengths });
        }
        let metrics = first.0.metrics.iter().enumerate().filter_map(|(m, &metric)| {
            let n = second.0.metrics.iter().position(|other| *other == metric && is_wanted(metric))?;
            let both: Vec<(&str, f64, f64)> =
                pairs.iter().filter_map(|(id, [a, b])| Some((*id, a[m]?, b[n]?))).collect();
            Some((metric.id, PairedDifference::of_groups(metric, &both, seed, group)?))
        });
        Ok(Self {
            first: first.1.to_owned(),
            second: second.1.to_owned(),
            scenarios: pairs.len(),
            unpaired: a.len() + b.len() - 2 * pairs.len(),
            metrics: metrics.collect(),
        })
    }
}

/// Returns the durations of the scenarios of a run.
fn durations(tally: &Tally) -> String {
    RowLength::duration(tally.entries.values().map(|entry| entry.length)).unwrap_or_default()
}

/// Returns the scenarios for which a simulator has a result, with its values, by id.
fn done(tally: &Tally, simulator: usize) -> BTreeMap<&str, (&Entry, &[Option<f64>])> {
    let entries = tally.entries.values();
    let with_result = entries.filter_map(|e| {
        let values = e.cells[simulator].as_ref()?.values.as_slice();
        Some((e.scenario.as_str(), (e, values)))
    });
    with_result.collect()
}

impl PairedDifference {
    /// Computes the difference from the values of both by scenario; `None` without scenarios.
    pub(crate) fn of(metric: &'static MetricSpec, values: &[(&str, f64, f64)], seed: u64) -> Option<Self> {
        Self::of_groups(metric, values, seed, None)
    }

    /// As [`Self::of`], with the groups of dependent scenarios by their ids.
    fn of_groups(
        metric: &'static MetricSpec,
        values: &[(&str, f64, f64)],
        seed: u64,
        group: Option<&dyn Fn(&str) -> String>,
    ) -> Option<Self> {
        if values.is_empty() {
            return None;
        }
        let n = values.len() as f64;
        let differences = match group {
            Some(group) => of_groups(values, group),
            None => values.iter().map(|(_, a, b)| b - a).collect(),
        };
        let less_is_better = metric.lower_is_better;
        let mut changed: Vec<(String, f64)> =
            values.iter().filter(|(_, a, b)| a != b).map(|(id, a, b)| ((*id).to_owned(), b - a)).collect();
        // Largest improvement first; equal changes stay in the order of the ids.
        changed.sort_by(|a, b| if less_is_better { a.1.total_cmp(&b.1) } else { b.1.total_cmp(&a.1) });
        let good = changed.partition_point(|c| (c.1 < 0.0) == less_is_better);
        let mut worse = changed.split_off(good);
        worse.reverse();
        let mut found = Self {
            metric,
            first: values.iter().map(|v| v.1).sum::<f64>() / n,
            second: values.iter().map(|v| v.2).sum::<f64>() / n,
            groups: group.map(|_| differences.len()),
            difference: Estimate {
                scenarios: values.len(),
                ..Estimate::of(&differences, seed, &format!("difference {}", metric.id))
            },
            p: permutation(&differences, seed, metric.id),
            verdict: Verdict::NoDifferenceSeen,
            visible: None,
            better: changed,
            worse,
        };
        found.verdict = match found.worsening() {
            _ if found.p >= SIGNIFICANT => Verdict::NoDifferenceSeen,
            worsening if worsening > 0.0 => Verdict::Worse,
            _ => Verdict::Better,
        };
        found.visible = found.smallest_visible(values, group);
        Some(found)
    }

    /// Returns the amount by which the second simulator is worse; negative if it is better.
    pub fn worsening(&self) -> f64 {
        let difference = self.second - self.first;
        if self.metric.lower_is_better { difference } else { -difference }
    }

    /// Returns whether the second simulator could have twice the value of the first, which would be worse,
    /// and the scenarios would not show it in four of five cases. Where a doubling is a rise of less than
    /// `least`, a rise of `least` is meant.
    pub fn may_hide_doubling(&self, least: f64) -> bool {
        let rise = self.first.max(least);
        // A share that is 0 in all scenarios does not tell how large one is.
        let is_unknown = || self.independent() < MIN_FOR_VERDICT || self.metric.unit == Unit::Rate;
        let is_hidden = || self.visible.map_or_else(is_unknown, |visible| visible > rise);
        self.metric.lower_is_better && rise > 0.0 && is_hidden()
    }

    /// Returns the number of groups, or of scenarios if every one is a group.
    pub fn independent(&self) -> usize {
        self.groups.unwrap_or(self.difference.scenarios)
    }

    fn smallest_visible(
        &self,
        values: &[(&str, f64, f64)],
        group: Option<&dyn Fn(&str) -> String>,
    ) -> Option<f64> {
        let (low, high) = self.difference.low.zip(self.difference.high)?;
        let changes = self.better.iter().chain(&self.worse).map(|(_, change)| change.abs());
        let size = mean(changes).or_else(|| match self.metric.unit {
            // A count changes by one, and a share by as much as it is where it is not 0.
            Unit::Count => Some(1.0),
            Unit::Rate => mean(values.iter().map(|v| v.1).filter(|value| *value != 0.0)),
            _ => None,
        })?;
        // The test needs six changes, of different groups, however narrow the interval of fewer is.
        let least = size * MIN_FOR_VERDICT as f64 / values.len() as f64;
        // Rare events are nearly all missing before a rise d, and spread more after it: events of a size that
        // come k at a time add d · size · k / n to the squared standard error. The smallest d that is seen
        // solves d² = 2.8² (SE² + d · size · k / n).
        let is_of_events = matches!(self.metric.unit, Unit::Count | Unit::Rate);
        let together = group.map_or(1.0, |group| self.changes_together(group));
        let added = if is_of_events { size * together / values.len() as f64 } else { 0.0 };
        let half = SEEN * SEEN * added / 2.0;
        let spread = SEEN / HALF_WIDTH * (high - low) / 2.0;
        let visible = half + (half * half + spread * spread).sqrt();
        (self.independent() >= MIN_FOR_VERDICT).then(|| least.max(visible))
    }

    /// Returns how many scenarios change in the group of a changed one, on average over these; 1 if none has
    /// changed.
    fn changes_together(&self, group: &dyn Fn(&str) -> String) -> f64 {
        let mut of_group: BTreeMap<String, usize> = BTreeMap::new();
        for (id, _) in self.better.iter().chain(&self.worse) {
            *of_group.entry(group(id)).or_default() += 1;
        }
        let changes = of_group.values().flat_map(|&count| std::iter::repeat_n(count as f64, count));
        mean(changes).unwrap_or(1.0)
    }
}

/// Returns a difference per group, in the order of their first scenarios: the sum over its scenarios, scaled
/// so that the mean over groups is that over scenarios.
fn of_groups(values: &[(&str, f64, f64)], group: &dyn Fn(&str) -> String) -> Vec<f64> {
    let (mut places, mut sums) = (BTreeMap::new(), Vec::new());
    for (id, a, b) in values {
        let place = *places.entry(group(id)).or_insert(sums.len());
        if place == sums.len() {
            sums.push(0.0);
        }
        sums[place] += b - a;
    }
    let scale = sums.len() as f64 / values.len() as f64;
    sums.iter_mut().for_each(|sum| *sum *= scale);
    sums
}

/// Returns the share of sign assignments to the differences whose sum is at least as far from 0 as the
/// observed sum. Few differences: all assignments are enumerated; else random assignments and the observed
/// one are counted.
fn permutation(differences: &[f64], seed: u64, metric: &str) -> f64 {
    let nonzero: Vec<f64> = differences.iter().copied().filter(|d| *d != 0.0).collect();
    let observed = nonzero.iter().sum::<f64>().abs();
    let least = observed - RELATIVE_TOLERANCE * nonzero.iter().map(|d| d.abs()).sum::<f64>();
    let signed = |signs: &mut dyn FnMut(usize) -> bool| {
        let sum: f64 = nonzero.iter().enumerate().map(|(i, d)| if signs(i) { *d } else { -d }).sum();
        sum.abs() >= least
    };
    if nonzero.len() <= MAX_ENUMERATED {
        let all = 1_u32 << nonzero.len();
        let far = (0..all).filter(|bits| signed(&mut |i| bits >> i & 1 == 1)).count();
        return far as f64 / f64::from(all);
    }
    let mut random = stream(seed, &format!("permutation {metric}"), 0, Purpose::Bootstrap);
    let mut bits = 0_u64;
    let mut draw = |i: usize| {
        if i.is_multiple_of(64) {
            bits = random.next_u64();
        }
        bits >> (i % 64) & 1 == 1
    };
    let far = (0..PERMUTATIONS).filter(|_| signed(&mut draw)).count();
    (far + 1) as f64 / f64::from(PERMUTATIONS + 1)
}

#[cfg(test)]
mod tests {
    use reactsim_metrics::{METRICS, Score, metric};

    use super::*;
    use crate::row::Row;

    /// A run of one scenario with this digest and number of steps.
    fn tally(digest: &str, steps: usize) -> Tally {
        tally_of("s", digest, steps)
    }

    fn tally_of(scenario: &str, digest: &str, steps: usize) -> Tally {
        let metrics = METRICS.iter().map(|metric| metric.spec()).collect();
        let simulators = vec!["idm".to_owned()];
        let mut tally = Tally { metrics, simulators, rollouts: 1, entries: BTreeMap::new() };
        tally.add(&[Row {
            scenario: scenario.to_owned(),
            digest: digest.to_owned(),
            simulator: "idm".to_owned(),
            rollout: Some(0),
            metrics: [("ade".to_owned(), Some(Score::Value(1.0)))].into(),
            length: (steps != 80).then_some(RowLength { history: 11, steps }),
            ..Row::default()
        }]);
        tally
    }

    #[test]
    fn scenarios_of_different_length_are_not_compared() {
        let compare = |a: &Tally, b: &Tally| {
            Comparison::of((a, "idm"), (b, "idm"), 0).map(|found| found.scenarios).map_err(|e| e.to_string())
        };
        let usual = tally("x", 80);
        assert_eq!(compare(&usual, &tally("x", 80)), Ok(1));
        assert_eq!(compare(&tally("x", 150), &tally("x", 150)), Ok(1));
        assert_eq!(
            compare(&usual, &tally("y", 150)).unwrap_err(),
            "the scenario `s` has 11 frames of history and 80 steps in the first run, and 11 and 150 in the \
             second: only runs on scenarios of the same length can be compared"
        );
        assert!(compare(&usual, &tally("y", 80)).unwrap_err().contains("is not the same in both runs"));
        // Windows of other length have other ids.
        let nothing = "the runs have no scenario in common for which both have a result";
        assert_eq!(compare(&usual, &tally_of("t", "y", 80)).unwrap_err(), nothing);
        assert_eq!(
            compare(&usual, &tally_of("t", "y", 150)).unwrap_err(),
            format!(
                "{nothing}: those of the first last 8 s (80 steps), those of the second 15 s (150 steps); run both \
                 with the same `history` and `future`"
            )
        );
    }

    #[test]
    fn no_difference_is_never_significant() {
        assert_eq!(permutation(&[0.0; 30], 0, "ade"), 1.0);
        assert_eq!(permutation(&[], 0, "ade"), 1.0);
    }

    #[test]
    fn few_differences_are_judged_exactly() {
        // Ten of one sign: two of 1024 assignments are as far from 0.
        assert_eq!(permutation(&[1.0; 10], 0, "ade"), 2.0 / 1024.0);
        // One against one of equal size: every assignment is at least as far.
        assert_eq!(permutation(&[1.0, -1.0], 0, "ade"), 1.0);
        assert_eq!(permutation(&[3.0, -1.0], 0, "ade"), 1.0);
        assert_eq!(permutation(&[3.0, 1.0], 0, "ade"), 0.5);
    }

    #[test]
    fn many_differences_agree_with_the_normal_distribution() {
        // A mean of 2 standard errors: 4.6 % of a normal distribution are as far from 0.
        let n = 400;
        let differences: Vec<f64> = (0..n).map(|i| if i % 2 == 0 { 1.1 } else { -0.9 }).collect();
        let p = permutation(&differences, 0, "ade");
        assert!((p - 0.046).abs() < 0.01, "{p}");
        assert_eq!(p, permutation(&differences, 0, "ade"));
        let shifted: Vec<f64> = differences.iter().map(|d| d + 1.0).collect();
        assert!(permutation(&shifted, 0, "ade") < 1e-4);
    }

    #[test]
    fn the_metric_decides_which_changes_are_better() {
        let spec = |id| metric(id).unwrap().spec();
        let values = [("a", 1.0, 0.0), ("b", 0.0, 2.0), ("c", 1.0, 1.0), ("d", 3.0, 0.5), ("e", 0.0, 1.0)];
        let less = PairedDifference::of(spec("aav-collision"), &values, 0).unwrap();
        assert_eq!(less.better, [("d".to_owned(), -2.5), ("a".to_owned(), -1.0)]);
        assert_eq!(less.worse, [("b".to_owned(), 2.0), ("e".to_owned(), 1.0)]);
        assert!((less.worsening() + 0.1).abs() < 1e-12);
        let more = PairedDifference::of(spec("progress"), &values, 0).unwrap();
        assert_eq!(more.better, [("b".to_owned(), 2.0), ("e".to_owned(), 1.0)]);
        assert_eq!(more.worse, [("d".to_owned(), -2.5), ("a".to_owned(), -1.0)]);
        assert_eq!((more.first, more.second), (1.0, 0.9));
    }

    /// The difference of a metric from 1 in these scenarios.
    fn judged(id: &str, changes: &[f64]) -> PairedDifference {
        let ids: Vec<String> = (0..changes.len()).map(|i| format!("{i:03}")).collect();
        let values: Vec<(&str, f64, f64)> =
            ids.iter().zip(changes).map(|(id, change)| (id.as_str(), 1.0, 1.0 + change)).collect();
        PairedDifference::of(metric(id).unwrap().spec(), &values, 0).unwrap()
    }

    #[test]
    fn a_verdict_needs_more_than_chance() {
        let verdict = |id, changes: &[f64]| judged(id, changes).verdict;
        assert_eq!(verdict("progress", &[-0.1; 6]), Verdict::Worse);
        assert_eq!(verdict("progress", &[0.1; 6]), Verdict::Better);
        assert_eq!(verdict("over-reaction", &[1.0; 6]), Verdict::Worse);
        assert_eq!(verdict("over-reaction", &[-1.0; 6]), Verdict::Better);
        // p is 1/16, and 1.
        assert_eq!(verdict("progress", &[-0.1; 5]), Verdict::NoDifferenceSeen);
        assert_eq!(verdict("ade", &[1.0, -1.0, 1.0, -1.0, 1.0, -1.0]), Verdict::NoDifferenceSeen);
        assert_eq!(verdict("ade", &[0.0; 40]), Verdict::NoDifferenceSeen);
        assert_eq!(serde_json::to_value(Verdict::NoDifferenceSeen).unwrap(), "no-difference-seen");
    }

    #[test]
    fn what_could_be_seen_follows_from_spread_and_number() {
        // 400 changes of standard error 0.05 are seen from 2.8 standard errors on.
        let many: Vec<f64> = (0..400).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let found = judged("ade", &many);
        assert!((found.visible.unwrap() - 0.14).abs() < 0.01, "{:?}", found.visible);
        assert!(!found.may_hide_doubling(0.0));
        // Counts that are equal in all of twelve scenarios: d² = 2.8² d / 12.
        let none = judged("aav-collision", &[0.0; 12]);
        assert!((none.visible.unwrap() - 7.84 / 12.0).abs() < 1e-12, "{:?}", none.visible);
        assert!(!none.may_hide_doubling(0.0));
        let few = judged("aav-collision", &[0.0; 5]);
        assert_eq!((few.visible, few.may_hide_doubling(0.0)), (None, true));
        // One change of 2 in twelve, of which six would be needed.
        let one = judged("aav-collision", &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(one.visible >= Some(1.0), "{:?}", one.visible);
        // A doubling of little is little: a larger rise is enough from there on.
        let rare = PairedDifference { first: 0.2, ..none };
        assert_eq!(
            [0.0, 0.4, 0.6, 0.7].map(|least| rare.may_hide_doubling(least)),
            [true, true, true, false]
        );
        // Equal results say nothing about how far others would be apart.
        let equal = judged("ade", &[0.0; 12]);
        assert_eq!((equal.visible, equal.may_hide_doubling(0.0)), (None, false));
        // Twice the progress would not be worse.
        assert!(!judged("progress", &[0.1; 3]).may_hide_doubling(0.0));
    }

    #[test]
    fn rare_events_are_seen_with_the_spread_after_their_rise() {
        // 4 % of 400 scenarios have a collision more: a standard error of √(0.04 · 0.96 / 400) = 0.0098, whose
        // 2.8 fold is 0.027; d² = 2.8² (0.0098² + d / 400) has the root 0.0389.
        let some: Vec<f64> = (0..400).map(|i| if i < 16 { 1.0 } else { 0.0 }).collect();
        let visible = judged("aav-collision", &some).visible.unwrap();
        assert!((visible - 0.0389).abs() < 0.002, "{visible}");
        // Without any collision in 100 scenarios: after a rise by 0.0784 there are, by the distribution of
        // Poisson, six or more of them, which have a verdict, with a probability of four fifths.
        let visible = judged("aav-collision", &[0.0; 100]).visible.unwrap();
        assert!((visible - 0.0784).abs() < 1e-12, "{visible}");
        let expected = 100.0 * visible;
        let terms = (1..MIN_FOR_VERDICT).scan(1.0, |term, k| {
            *term *= expected / k as f64;
            Some(*term)
        });
        let fewer = (1.0 + terms.sum::<f64>()) / reactsim_geometry::math::exp(expected);
        assert!((1.0 - fewer - 0.8).abs() < 0.01, "{fewer}");
    }

    #[test]
    fn a_share_of_zero_does_not_tell_how_large_one_is() {
        let shares = |values: [f64; 12]| {
            let ids: Vec<String> = (0..12).map(|i| format!("{i:02}")).collect();
            let values: Vec<_> = ids.iter().zip(values).map(|(id, v)| (id.as_str(), v, v)).collect();
            PairedDifference::of(metric("offroad").unwrap().spec(), &values, 0).unwrap()
        };
        let none = shares([0.0; 12]);
        assert_eq!(
            (none.visible, none.may_hide_doubling(0.0), none.may_hide_doubling(0.005)),
            (None, false, true)
        );
        // Equal shares of 0.02 in some are as large as others would be: d² = 2.8² · 0.02 d / 12.
        let some = shares([0.02, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!((some.visible.unwrap() - 7.84 * 0.02 / 12.0).abs() < 1e-12, "{:?}", some.visible);
        assert!(some.may_hide_doubling(0.013) && !some.may_hide_doubling(0.0131));
    }

    #[test]
    fn scenarios_of_one_group_are_one_observation() {
        let spec = metric("aav-collision").unwrap().spec();
        let ids: Vec<String> = (0..48).map(|i| format!("{:02}+av{}", i / 4, i % 4)).collect();
        let recording = |id: &str| id.split('+').next().unwrap_or(id).to_owned();
        // Six of twelve recordings have a collision more with each of their four AVs.
        let values: Vec<(&str, f64, f64)> =
            ids.iter().enumerate().map(|(i, id)| (id.as_str(), 0.0, f64::from(u8::from(i < 24)))).collect();
        let alone = PairedDifference::of(spec, &values, 0).unwrap();
        let grouped = PairedDifference::of_groups(spec, &values, 0, Some(&recording)).unwrap();
        assert_eq!((grouped.groups, grouped.difference.scenarios, alone.groups), (Some(12), 48, None));
        assert_eq!((grouped.second, grouped.difference.mean), (0.5, Some(0.5)));
        // Six of one sign: two of 64 assignments are as far from 0.
        assert_eq!((grouped.p, grouped.worse.len()), (2.0 / 64.0, 24));
        assert!(alone.p < 1e-4);
        let width = |of: &PairedDifference| of.difference.high.unwrap() - of.difference.low.unwrap();
        // Four equal AVs are no more than one: the interval is that of twelve scenarios.
        assert!((1.5..2.5).contains(&(width(&grouped) / width(&alone))), "{grouped:?}");
        assert!(grouped.visible.unwrap() > 1.5 * alone.visible.unwrap());
        // The four of a recording change together: d² = 2.8² (SE² + 4 d / 48).
        let spread = width(&grouped) / 2.0 / 1.96;
        let d = grouped.visible.unwrap();
        assert!((d * d - 7.84 * (spread * spread + 4.0 * d / 48.0)).abs() < 1e-9, "{d}");
        // One AV at a time would change by one, as far as is known: d² = 2.8² d / 48.
        let same: Vec<(&str, f64, f64)> = ids.iter().map(|id| (id.as_str(), 0.0, 0.0)).collect();
        let same = PairedDifference::of_groups(spec, &same, 0, Some(&recording)).unwrap();
        assert!((same.visible.unwrap() - 7.84 / 48.0).abs() < 1e-12, "{:?}", same.visible);
        // Five recordings cannot tell, however many AVs they have.
        let five = PairedDifference::of_groups(spec, &values[..20], 0, Some(&recording)).unwrap();
        assert_eq!((five.visible, five.verdict), (None, Verdict::NoDifferenceSeen));
        // Groups of one scenario change nothing.
        let own = PairedDifference::of_groups(spec, &values, 0, Some(&str::to_owned)).unwrap();
        assert_eq!(PairedDifference { groups: None, ..own }, alone);
    }
}
