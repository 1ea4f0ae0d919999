//! The values behind the estimates of a summary.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::statistics::Estimate;
use crate::statistics::tally::{Entry, Tally};
use crate::summary::CategorySummary;

/// The values of all scenarios, in canonical order.
pub(crate) struct Samples<'a> {
    entries: Vec<&'a Entry>,
    /// Index and id of each metric that is estimated.
    pub(crate) metrics: Vec<(usize, &'static str)>,
    seed: u64,
}

impl<'a> Samples<'a> {
    /// Creates the samples of all metrics of a tally.
    pub(crate) fn new(tally: &'a Tally, seed: u64) -> Self {
        let metrics = tally.metrics.iter().map(|metric| metric.id).enumerate().collect();
        Self { entries: tally.entries.values().collect(), metrics, seed }
    }

    /// Estimates the metrics of a simulator over all scenarios.
    pub(crate) fn of(&self, simulator: usize) -> BTreeMap<String, Estimate> {
        self.estimates(|entry, metric| value(entry, simulator, metric))
    }

    /// Estimates the differences of a simulator to another over the scenarios in which both have a value.
    pub(crate) fn paired(&self, simulator: usize, other: usize) -> BTreeMap<String, Estimate> {
        self.estimates(|entry, metric| Some(value(entry, simulator, metric)? - value(entry, other, metric)?))
    }

    /// Estimates the metrics of a simulator over each part of the scenarios, by name. `part` returns the name
    /// of the part of a scenario.
    pub(crate) fn by_part(
        &self,
        simulator: usize,
        part: fn(&Entry) -> Option<&str>,
    ) -> BTreeMap<String, CategorySummary> {
        let mut parts: BTreeMap<&str, usize> = BTreeMap::new();
        let with_result = self.entries.iter().filter(|entry| entry.cells[simulator].is_some());
        for name in with_result.filter_map(|entry| part(entry)) {
            *parts.entry(name).or_default() += 1;
        }
        let summary = |(name, scenarios): (&str, usize)| {
            let metrics = self.estimates(|entry, metric| {
                (part(entry) == Some(name)).then(|| value(entry, simulator, metric)).flatten()
            });
            (name.to_owned(), CategorySummary { scenarios, metrics })
        };
        parts.into_iter().map(summary).collect()
    }

    /// Estimates the statistics of the AV against the logged AV, by name.
    pub(crate) fn deviation(&self) -> BTreeMap<String, Estimate> {
        let mut values: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (name, &value) in self.entries.iter().flat_map(|entry| &entry.deviation) {
            values.entry(name).or_default().push(value);
        }
        let estimate =
            |(name, values): (&str, Vec<f64>)| (name.to_owned(), Estimate::of(&values, self.seed, name));
        values.into_iter().map(estimate).collect()
    }

    /// Estimates each metric from its values in the scenarios that have one.
    fn estimates(&self, value: impl Fn(&Entry, usize) -> Option<f64> + Sync) -> BTreeMap<String, Estimate> {
        let estimate = |&(metric, id): &(usize, &'static str)| {
            let values: Vec<f64> = self.entries.iter().filter_map(|entry| value(entry, metric)).collect();
            (id.to_owned(), Estimate::of(&values, self.seed, id))
        };
        self.metrics.par_iter().map(estimate).collect()
    }
}

/// Returns the value of a simulator in a scenario.
fn value(entry: &Entry, simulator: usize, metric: usize) -> Option<f64> {
    entry.cells[simulator].as_ref()?.values[metric].filter(|value| !value.is_nan())
}

#[cfg(test)]
mod tests {
    use reactsim_metrics::{METRICS, Score};

    use super::*;
    use crate::row::{RecordPosition, Row};

    fn tally() -> Tally {
        let simulators = ["log-replay", "idm"].map(str::to_owned).to_vec();
        let metrics = METRICS.iter().map(|metric| metric.spec()).collect();
        Tally { metrics, simulators, rollouts: 1, entries: BTreeMap::new() }
    }

    /// Returns the entry of a scenario with two simulators, of which the second has no value in every tenth.
    fn entry(i: usize) -> Entry {
        let mut tally = tally();
        for (s, simulator) in tally.simulators.clone().into_iter().enumerate() {
            let value = (s == 0 || !i.is_multiple_of(10))
                .then(|| Score::Value(((i * 7919) % 1000) as f64 + s as f64));
            tally.add(&[Row {
                record: i,
                scenario: format!("scenario-{i}"),
                simulator,
                rollout: Some(0),
                category: Some(["lateral", "longitudinal"][i % 2].to_owned()),
                metrics: [("ade".to_owned(), value)].into(),
                deviation: [("ade".to_owned(), i as f64)].into(),
                ..Row::default()
            }]);
        }
        tally.entries.remove(&RecordPosition { input: 0, record: i }).unwrap()
    }

    #[test]
    fn estimates_are_those_of_the_parts() {
        let mut tally = tally();
        tally.entries = (0..2000).map(|i| (RecordPosition { input: 0, record: i }, entry(i))).collect();
        let samples = Samples::new(&tally, 0);
        let (all, categories) = (samples.of(1), samples.by_part(1, |entry| entry.category.as_deref()));
        for (found, of) in [
            (&all, &(|i: usize| !i.is_multiple_of(10)) as &dyn Fn(usize) -> bool),
            (&categories["lateral"].metrics, &|i: usize| i.is_multiple_of(2) && !i.is_multiple_of(10)),
        ] {
            let value = |i: usize| ((i * 7919) % 1000) as f64 + 1.0;
            let chosen: Vec<f64> = (0..2000).filter(|i| of(*i)).map(value).collect();
            let mean = chosen.iter().sum::<f64>() / chosen.len() as f64;
            let estimate = found["ade"];
            assert_eq!((estimate.mean, estimate.scenarios), (Some(mean), chosen.len()));
            assert!(estimate.low < Some(mean) && Some(mean) < estimate.high, "{estimate:?}");
        }
        // The difference is 1 in every scenario.
        let paired = samples.paired(1, 0)["ade"];
        assert_eq!((paired.mean, paired.low, paired.high), (Some(1.0), Some(1.0), Some(1.0)));
        assert_eq!(all["progress"], Estimate::default());
        assert!(samples.by_part(1, |entry| entry.difficulty.as_deref()).is_empty());
        assert_eq!(samples.deviation()["ade"].mean, Some(1999.0 / 2.0));
    }
}
