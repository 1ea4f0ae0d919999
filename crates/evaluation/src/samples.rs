//! The values behind the estimates of a summary.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::blocks::BlockEstimates;
use super::statistics::Estimate;
use super::tally::Entry;

/// Number of scenarios from which on values are not kept and intervals are those of
/// [`super::blocks`].
pub(super) const MANY: usize = 100_000;

/// A part of the scenarios, or of the differences between simulators.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Part {
    /// All scenarios.
    All,
    /// Differences to the reference of the pairing.
    Paired,
    /// Scenarios of one category of deviation.
    Category(String),
    /// Scenarios of one difficulty.
    Difficulty(String),
}

/// Values of all scenarios added so far, in their order.
#[derive(Debug)]
pub(super) struct Samples {
    seed: u64,
    metrics: Vec<&'static str>,
    layout: Layout,
    /// Parts by index; the first two are [`Part::All`] and [`Part::Paired`].
    parts: Vec<Part>,
    scenarios: usize,
    values: Values,
}

#[derive(Debug)]
enum Values {
    Kept(Kept),
    Passing(BlockEstimates),
}

/// Values in columns.
#[derive(Debug, Default)]
struct Kept {
    /// Parts of every scenario: category and difficulty.
    parts: Vec<[Option<usize>; 2]>,
    /// Per simulator and metric one value per scenario; NaN for none.
    columns: Vec<Vec<f64>>,
}

impl Samples {
    /// Creates empty samples for this number of simulators.
    pub(super) fn new(
        seed: u64,
        metrics: Vec<&'static str>,
        simulators: usize,
        reference: Option<usize>,
    ) -> Self {
        let layout = Layout { columns: simulators * metrics.len(), metrics: metrics.len(), reference };
        let values = Values::Kept(Kept { parts: Vec::new(), columns: vec![Vec::new(); layout.columns] });
        let parts = vec![Part::All, Part::Paired];
        Self { seed, metrics, layout, parts, scenarios: 0, values }
    }

    /// Returns whether there are so many scenarios that intervals are computed by blocks.
    pub(super) fn are_many(&self) -> bool {
        matches!(self.values, Values::Passing(_))
    }

    /// Adds the values of the next scenario.
    pub(super) fn add(&mut self, entry: &Entry) {
        if self.scenarios == MANY {
            self.let_pass();
        }
        let category = entry.category.clone().map(|name| self.part(Part::Category(name)));
        let difficulty = entry.difficulty.clone().map(|name| self.part(Part::Difficulty(name)));
        let of = |column: usize| {
            let cell = entry.cells[column / self.metrics.len()].as_ref();
            cell.and_then(|c| c.values[column % self.metrics.len()]).unwrap_or(f64::NAN)
        };
        let row: Vec<f64> = (0..self.layout.columns).map(of).collect();
        let parts = [category, difficulty];
        match &mut self.values {
            Values::Kept(kept) => {
                kept.parts.push(parts);
                kept.columns.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
            }
            Values::Passing(blocks) => self.layout.add(blocks, self.scenarios, &row, parts),
        }
        self.scenarios += 1;
    }

    fn part(&mut self, part: Part) -> usize {
        self.parts.iter().position(|p| *p == part).unwrap_or_else(|| {
            self.parts.push(part);
            self.parts.len() - 1
        })
    }

    /// Passes the values that were kept to estimates by blocks.
    fn let_pass(&mut self) {
        let Values::Kept(kept) = &self.values else { return };
        let mut blocks = BlockEstimates::new(self.seed);
        for (scenario, parts) in kept.parts.iter().enumerate() {
            let row: Vec<f64> = kept.columns.iter().map(|column| column[scenario]).collect();
            self.layout.add(&mut blocks, scenario, &row, *parts);
        }
        self.values = Values::Passing(blocks);
    }

    /// Returns the estimates by simulator, part and metric.
    pub(super) fn finish(self) -> Estimates {
        let layout = self.layout;
        let by_index = match self.values {
            Values::Passing(blocks) => blocks.finish(),
            Values::Kept(kept) => {
                let of_column = |column| kept.values(column, self.parts.len(), layout);
                let seed = self.seed;
                let columns: Vec<Vec<Estimate>> = (0..layout.columns)
                    .into_par_iter()
                    .map(|column| {
                        let metric = self.metrics[column % layout.metrics];
                        of_column(column).iter().map(|values| Estimate::of(values, seed, metric)).collect()
                    })
                    .collect();
                let part = |p: usize| columns.iter().map(move |estimates| estimates[p]);
                (0..self.parts.len()).flat_map(part).collect()
            }
        };
        Estimates { metrics: self.metrics, parts: self.parts, layout, by_index }
    }
}

impl Kept {
    /// Returns the values of a column in every part, in the order of the scenarios.
    fn values(&self, column: usize, parts: usize, layout: Layout) -> Vec<Vec<f64>> {
        let mut values = vec![Vec::new(); parts];
        let paired = layout.paired(column).map(|other| &self.columns[other]);
        for (scenario, &value) in self.columns[column].iter().enumerate() {
            let other = paired.map(|other| other[scenario]);
            for (part, value) in in_parts(value, other, self.parts[scenario]) {
                values[part].push(value);
            }
        }
        values
    }
}

/// Returns the values that a value of a scenario adds to, each with the index of its part; none if it is NaN.
/// `other` is that of the simulator to which differences are computed.
fn in_parts(value: f64, other: Option<f64>, parts: [Option<usize>; 2]) -> impl Iterator<Item = (usize, f64)> {
    let paired = other.filter(|other| !other.is_nan()).map(|other| (1, value - other));
    let named = parts.into_iter().flatten().map(move |part| (part, value));
    std::iter::once((0, value)).chain(paired).chain(named).filter(move |_| !value.is_nan())
}

/// Indices of estimates: by part, simulator and metric.
#[derive(Clone, Copy, Debug)]
struct Layout {
    /// Number of simulators times number of metrics.
    columns: usize,
    metrics: usize,
    /// Index of the simulator to which differences are computed.
    reference: Option<usize>,
}

impl Layout {
    /// Returns the column of the same metric of the simulator to which differences are computed.
    fn paired(self, column: usize) -> Option<usize> {
        self.reference.map(|simulator| simulator * self.metrics + column % self.metrics)
    }

    /// Adds the values of a scenario, one per column.
    fn add(self, blocks: &mut BlockEstimates, scenario: usize, row: &[f64], parts: [Option<usize>; 2]) {
        for (column, &value) in row.iter().enumerate() {
            let other = self.paired(column).map(|other| row[other]);
            for (part, value) in in_parts(value, other, parts) {
                blocks.add(scenario, part * self.columns + column, value);
            }
        }
    }
}

/// Finished estimates.
#[derive(Debug)]
pub(super) struct Estimates {
    metrics: Vec<&'static str>,
    parts: Vec<Part>,
    layout: Layout,
    by_index: Vec<Estimate>,
}

impl Estimates {
    /// Returns one estimate per metric, by id.
    pub(super) fn of(&self, simulator: usize, part: &Part) -> BTreeMap<String, Estimate> {
        let part = self.parts.iter().position(|p| p == part);
        let estimate = |metric: usize| {
            let index = part? * self.layout.columns + simulator * self.layout.metrics + metric;
            self.by_index.get(index).copied()
        };
        let named = self.metrics.iter().enumerate();
        named.map(|(metric, id)| ((*id).to_owned(), estimate(metric).unwrap_or_default())).collect()
    }
}

/// Values by name of which every scenario has some, such as the statistics of the AV.
#[derive(Debug)]
pub(super) struct NamedSamples {
    seed: u64,
    scenarios: usize,
    names: BTreeMap<String, usize>,
    values: NamedValues,
}

#[derive(Debug)]
enum NamedValues {
    Kept(Vec<(usize, usize, f64)>),
    Passing(BlockEstimates),
}

impl NamedSamples {
    /// Creates empty samples.
    pub(super) fn new(seed: u64) -> Self {
        Self { seed, scenarios: 0, names: BTreeMap::new(), values: NamedValues::Kept(Vec::new()) }
    }

    /// Adds the values of the next scenario.
    pub(super) fn add(&mut self, values: &BTreeMap<String, f64>) {
        if self.scenarios == MANY
            && let NamedValues::Kept(kept) = &self.values
        {
            let mut blocks = BlockEstimates::new(self.seed);
            kept.iter().for_each(|&(scenario, name, value)| blocks.add(scenario, name, value));
            self.values = NamedValues::Passing(blocks);
        }
        for (name, &value) in values {
            let next = self.names.len();
            let index = *self.names.entry(name.clone()).or_insert(next);
            match &mut self.values {
                NamedValues::Kept(kept) => kept.push((self.scenarios, index, value)),
                NamedValues::Passing(blocks) => blocks.add(self.scenarios, index, value),
            }
        }
        self.scenarios += 1;
    }

    /// Returns the estimates by name.
    pub(super) fn finish(self) -> BTreeMap<String, Estimate> {
        match self.values {
            NamedValues::Kept(kept) => {
                let mut values = vec![Vec::new(); self.names.len()];
                kept.into_iter().for_each(|(_, name, value)| values[name].push(value));
                let estimate = |(name, i): (String, usize)| {
                    let estimate = Estimate::of(&values[i], self.seed, &name);
                    (name, estimate)
                };
                self.names.into_iter().map(estimate).collect()
            }
            NamedValues::Passing(blocks) => {
                let all = blocks.finish();
                self.names.into_iter().map(|(name, i)| (name, all[i])).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::{RecordPosition, Row, Value};
    use crate::tally::Tally;

    /// Returns the entry of a scenario with two simulators, of which the second has no value in every tenth.
    fn entry(i: usize) -> Entry {
        let mut tally = Tally::new(vec!["log-replay".to_owned(), "idm".to_owned()], 1);
        for (s, simulator) in tally.simulators.clone().into_iter().enumerate() {
            let value = (s == 0 || !i.is_multiple_of(10))
                .then(|| Value::Value(((i * 7919) % 1000) as f64 + s as f64));
            tally.add(&[Row {
                input: 0,
                record: i,
                scenario: format!("scenario-{i}"),
                digest: String::new(),
                simulator,
                rollout: Some(0),
                category: Some(["lateral", "longitudinal"][i % 2].to_owned()),
                difficulty: None,
                direction_tracking: None,
                metrics: [("ade".to_owned(), value)].into(),
                deviation: [("ade".to_owned(), i as f64)].into(),
                outcomes: BTreeMap::new(),
                notes: BTreeMap::new(),
            }]);
        }
        tally.entries.remove(&RecordPosition { input: 0, record: i }).unwrap()
    }

    #[test]
    fn very_many_values_have_the_same_means_and_intervals_by_blocks() {
        let metrics = Tally::new(Vec::new(), 1).metrics;
        let estimates = |n: usize| {
            let mut samples = Samples::new(0, metrics.clone(), 2, Some(0));
            let mut named = NamedSamples::new(0);
            for entry in (0..n).map(entry) {
                samples.add(&entry);
                named.add(&entry.deviation);
            }
            (samples.are_many(), samples.finish(), named.finish())
        };
        let few = 2000;
        let (is_many, exact, _) = estimates(few);
        assert!(!is_many);
        let lateral = Part::Category("lateral".to_owned());
        let value = |i: usize| ((i * 7919) % 1000) as f64;
        let mean = |n: usize, of: &dyn Fn(usize) -> bool| {
            let chosen: Vec<f64> = (0..n).filter(|i| of(*i)).map(|i| value(i) + 1.0).collect();
            (chosen.iter().sum::<f64>() / chosen.len() as f64, chosen.len())
        };
        let many = MANY + 3;
        let (is_many, by_blocks, named) = estimates(many);
        assert!(is_many);
        for (n, found) in [(few, &exact), (many, &by_blocks)] {
            for (part, of) in [
                (&Part::All, &(|i: usize| !i.is_multiple_of(10)) as &dyn Fn(usize) -> bool),
                (&lateral, &|i: usize| i.is_multiple_of(2) && !i.is_multiple_of(10)),
            ] {
                let estimate = found.of(1, part)["ade"];
                let (mean, count) = mean(n, of);
                assert_eq!((estimate.mean, estimate.scenarios), (Some(mean), count));
                assert!(estimate.low < Some(mean) && Some(mean) < estimate.high, "{estimate:?}");
            }
            // The difference is 1 in every scenario.
            let paired = found.of(1, &Part::Paired)["ade"];
            assert_eq!((paired.mean, paired.low, paired.high), (Some(1.0), Some(1.0), Some(1.0)));
            assert_eq!(found.of(1, &Part::All)["progress"], Estimate::default());
            assert_eq!(found.of(1, &Part::Difficulty("hard".to_owned()))["ade"], Estimate::default());
        }
        assert_eq!(named["ade"].mean, Some((many - 1) as f64 / 2.0));
    }
}
