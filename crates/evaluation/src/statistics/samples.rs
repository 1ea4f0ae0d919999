//! The values behind the estimates of a summary.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::statistics::Estimate;
use crate::statistics::tally::Entry;

/// A part of the scenarios, or of the differences between simulators.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part {
    /// All scenarios.
    All,
    /// Differences to the reference of the pairing.
    Paired,
    /// Scenarios of one category of deviation.
    Category(String),
    /// Scenarios of one difficulty.
    Difficulty(String),
}

/// Values of all scenarios added so far, in their order, in columns.
#[derive(Debug)]
pub(crate) struct Samples {
    seed: u64,
    metrics: Vec<&'static str>,
    /// Index of the simulator to which differences are computed.
    reference: Option<usize>,
    /// Parts by index; the first two are [`Part::All`] and [`Part::Paired`].
    parts: Vec<Part>,
    /// Parts of every scenario: category and difficulty.
    parts_of: Vec<[Option<usize>; 2]>,
    /// Per simulator and metric one value per scenario; NaN for none.
    columns: Vec<Vec<f64>>,
}

impl Samples {
    /// Creates empty samples for this number of simulators.
    pub(crate) fn new(
        seed: u64,
        metrics: Vec<&'static str>,
        simulators: usize,
        reference: Option<usize>,
    ) -> Self {
        let columns = vec![Vec::new(); simulators * metrics.len()];
        let parts = vec![Part::All, Part::Paired];
        Self { seed, metrics, reference, parts, parts_of: Vec::new(), columns }
    }

    /// Adds the values of the next scenario.
    pub(crate) fn add(&mut self, entry: &Entry) {
        let category = entry.category.clone().map(|name| self.part(Part::Category(name)));
        let difficulty = entry.difficulty.clone().map(|name| self.part(Part::Difficulty(name)));
        self.parts_of.push([category, difficulty]);
        for (i, column) in self.columns.iter_mut().enumerate() {
            let cell = entry.cells[i / self.metrics.len()].as_ref();
            column.push(cell.and_then(|c| c.values[i % self.metrics.len()]).unwrap_or(f64::NAN));
        }
    }

    fn part(&mut self, part: Part) -> usize {
        self.parts.iter().position(|p| *p == part).unwrap_or_else(|| {
            self.parts.push(part);
            self.parts.len() - 1
        })
    }

    /// Returns the estimates by simulator, part and metric.
    pub(crate) fn finish(self) -> Estimates {
        let of_column = |column: usize| {
            let metric = self.metrics[column % self.metrics.len()];
            let values = self.values(column);
            values.iter().map(|values| Estimate::of(values, self.seed, metric)).collect()
        };
        let by_column = (0..self.columns.len()).into_par_iter().map(of_column).collect();
        Estimates { metrics: self.metrics, parts: self.parts, by_column }
    }

    /// Returns the values of a column in every part, in the order of the scenarios.
    fn values(&self, column: usize) -> Vec<Vec<f64>> {
        let mut values = vec![Vec::new(); self.parts.len()];
        let metrics = self.metrics.len();
        let paired = self.reference.map(|simulator| &self.columns[simulator * metrics + column % metrics]);
        for (scenario, &value) in self.columns[column].iter().enumerate().filter(|(_, value)| !value.is_nan())
        {
            values[0].push(value);
            if let Some(other) = paired.map(|other| other[scenario]).filter(|other| !other.is_nan()) {
                values[1].push(value - other);
            }
            self.parts_of[scenario].iter().flatten().for_each(|&part| values[part].push(value));
        }
        values
    }
}

/// Finished estimates.
#[derive(Debug)]
pub(crate) struct Estimates {
    metrics: Vec<&'static str>,
    parts: Vec<Part>,
    /// Per simulator and metric one estimate per part.
    by_column: Vec<Vec<Estimate>>,
}

impl Estimates {
    /// Returns one estimate per metric, by id.
    pub(crate) fn of(&self, simulator: usize, part: &Part) -> BTreeMap<String, Estimate> {
        let part = self.parts.iter().position(|p| p == part);
        let estimate = |metric: usize| {
            let column = &self.by_column[simulator * self.metrics.len() + metric];
            part.map(|part| column[part]).unwrap_or_default()
        };
        let named = self.metrics.iter().enumerate();
        named.map(|(metric, id)| ((*id).to_owned(), estimate(metric))).collect()
    }
}

/// Values by name of which every scenario has some, such as the statistics of the AV.
#[derive(Debug)]
pub(crate) struct NamedSamples {
    seed: u64,
    values: BTreeMap<String, Vec<f64>>,
}

impl NamedSamples {
    /// Creates empty samples.
    pub(crate) fn new(seed: u64) -> Self {
        Self { seed, values: BTreeMap::new() }
    }

    /// Adds the values of the next scenario.
    pub(crate) fn add(&mut self, values: &BTreeMap<String, f64>) {
        for (name, &value) in values {
            self.values.entry(name.clone()).or_default().push(value);
        }
    }

    pub(crate) fn finish(self) -> BTreeMap<String, Estimate> {
        let estimate = |(name, values): (String, Vec<f64>)| {
            let estimate = Estimate::of(&values, self.seed, &name);
            (name, estimate)
        };
        self.values.into_iter().map(estimate).collect()
    }
}

#[cfg(test)]
mod tests {
    use reactsim_metrics::{METRICS, Score};

    use super::*;
    use crate::row::{RecordPosition, Row};
    use crate::statistics::tally::Tally;

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
        let metrics = tally().metrics.iter().map(|metric| metric.id).collect();
        let mut samples = Samples::new(0, metrics, 2, Some(0));
        let mut named = NamedSamples::new(0);
        for entry in (0..2000).map(entry) {
            samples.add(&entry);
            named.add(&entry.deviation);
        }
        let found = samples.finish();
        for (part, of) in [
            (Part::All, &(|i: usize| !i.is_multiple_of(10)) as &dyn Fn(usize) -> bool),
            (Part::Category("lateral".to_owned()), &|i: usize| i.is_multiple_of(2) && !i.is_multiple_of(10)),
        ] {
            let value = |i: usize| ((i * 7919) % 1000) as f64 + 1.0;
            let chosen: Vec<f64> = (0..2000).filter(|i| of(*i)).map(value).collect();
            let mean = chosen.iter().sum::<f64>() / chosen.len() as f64;
            let estimate = found.of(1, &part)["ade"];
            assert_eq!((estimate.mean, estimate.scenarios), (Some(mean), chosen.len()));
            assert!(estimate.low < Some(mean) && Some(mean) < estimate.high, "{estimate:?}");
        }
        // The difference is 1 in every scenario.
        let paired = found.of(1, &Part::Paired)["ade"];
        assert_eq!((paired.mean, paired.low, paired.high), (Some(1.0), Some(1.0), Some(1.0)));
        assert_eq!(found.of(1, &Part::All)["progress"], Estimate::default());
        assert_eq!(found.of(1, &Part::Difficulty("hard".to_owned()))["ade"], Estimate::default());
        assert_eq!(named.finish()["ade"].mean, Some(1999.0 / 2.0));
    }
}
