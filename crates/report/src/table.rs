//! Common parts of all tables: columns in the paper's order, and formatted numbers.

use std::collections::BTreeMap;

use reactsim_evaluation::{
    CategorySummary, Condition, Estimate, Mark, Provenance, SettingsRecord, SimulatorSummary, Summary,
    SummaryProvenance, TableMarks, changed_options,
};
use reactsim_metrics as metrics;
use reactsim_metrics::{METRICS, MetricSpec, Scope, Unit};
use reactsim_scene::Difficulty;

/// A column of the tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Column {
    /// Id of the metric.
    pub metric: &'static str,
    /// Description of a metric that the benchmark does not have.
    own: Option<&'static MetricSpec>,
}

/// All columns: those of the paper (ReactSim-Bench, table 1) in its order, then additional ones.
pub const COLUMNS: &[Column] = &[
    Column::benchmark("aav-collision"),
    Column::benchmark("aav-ttc"),
    Column::benchmark("aa-collision"),
    Column::benchmark("offroad"),
    Column::benchmark("direction"),
    Column::benchmark("acceleration"),
    Column::benchmark("curvature"),
    Column::benchmark("curvature-velocity"),
    Column::benchmark("ade"),
    Column::benchmark("min-ade"),
    Column::benchmark("progress"),
    Column::benchmark("over-reaction"),
    Column::benchmark("undisturbed-loss"),
    Column::benchmark("kinematic-likelihood"),
];

/// The columns of the paper's main table.
pub const MAIN_COLUMNS: &[Column] = COLUMNS.split_at(7).0;

/// Test of the settings of a run.
type SettingsTest = fn(&SettingsRecord) -> bool;

/// Columns that apply only to runs with certain settings.
const CONDITIONS: &[(&str, SettingsTest)] = &[
    // The likelihood of the log is a measure of realism (the paper's second table).
    ("kinematic-likelihood", |settings| settings.protocol != "reactive"),
    ("min-ade", |settings| settings.rollouts != 1),
];

impl Column {
    /// Returns the column of a metric of the benchmark.
    pub(super) const fn benchmark(metric: &'static str) -> Self {
        Self { metric, own: None }
    }

    /// Returns the column of the metric of the benchmark with this id.
    pub fn of(metric: &str) -> Option<Self> {
        metrics::metric(metric).map(|m| Self::benchmark(m.spec().id))
    }

    /// Returns the column of a metric that the benchmark may not have.
    pub(super) fn of_spec(spec: &'static MetricSpec) -> Self {
        Self { metric: spec.id, own: Some(spec) }
    }

    /// Returns the columns of the metrics of runs that the benchmark does not have, each id once.
    pub(super) fn own<'a>(summaries: impl IntoIterator<Item = &'a Summary>) -> Vec<Self> {
        let records = summaries.into_iter().flat_map(|summary| &summary.provenance.run.own_metrics);
        let columns: Vec<Self> = records.map(|record| Self::of_spec(record.spec())).collect();
        Self::with(Vec::new(), &columns)
    }

    fn spec(&self) -> Option<&'static MetricSpec> {
        self.own.or_else(|| metrics::metric(self.metric).map(|m| m.spec()))
    }

    /// Appends the columns of `also` that are not yet among these.
    pub(super) fn with(mut columns: Vec<Self>, also: &[Self]) -> Vec<Self> {
        for column in also {
            if !columns.iter().any(|known| known.metric == column.metric) {
                columns.push(*column);
            }
        }
        columns
    }

    /// Returns the title of the column.
    pub(super) fn title(&self) -> &'static str {
        self.spec().map_or(self.metric, |spec| spec.title)
    }

    /// Returns the unit of the metric, and whether lower is better.
    pub(super) fn kind(&self) -> (Unit, bool) {
        self.spec().map_or((Unit::Plain, true), |s| (s.unit, s.lower_is_better))
    }

    /// Returns the unit to print in the head of the column.
    pub(super) fn unit(&self) -> Option<&'static str> {
        match self.kind().0 {
            Unit::Rate => Some("%"),
            Unit::Count | Unit::Plain => None,
            unit => Some(unit.name()),
        }
    }

    /// Returns the head of the column: title, unit, and an arrow towards better values.
    pub(super) fn head(&self) -> String {
        let arrow = if self.kind().1 { '↓' } else { '↑' };
        format!("{}{} {arrow}", self.title(), self.unit().map(|u| format!(" ({u})")).unwrap_or_default())
    }

    /// Formats a number of this column: rates in percent; two or three decimals.
    pub fn number(&self, value: f64) -> String {
        match self.kind().0 {
            Unit::Rate => format!("{:.2}", 100.0 * value),
            Unit::Metres | Unit::MetresPerSecondSquared => format!("{value:.2}"),
            Unit::Count | Unit::Plain | Unit::Other(_) => format!("{value:.3}"),
        }
    }

    /// Returns whether at least one simulator has a number.
    pub(super) fn has_numbers<'a>(&self, summaries: impl IntoIterator<Item = &'a Summary>) -> bool {
        let simulators = summaries.into_iter().flat_map(|summary| summary.simulators.values());
        simulators.flat_map(|s| s.metrics.get(self.metric)).any(|estimate| estimate.mean.is_some())
    }

    /// Returns the columns of the metrics of the AV that the benchmark has.
    pub(super) fn av_of_benchmark() -> impl Iterator<Item = Self> {
        let all = METRICS.iter().map(|metric| Self::benchmark(metric.spec().id));
        all.filter(Self::is_of_av)
    }

    fn is_of_av(&self) -> bool {
        self.spec().is_some_and(|spec| spec.scope == Scope::Av)
    }

    /// Returns the columns of the metrics of the AV for which at least one simulator has a number.
    pub(super) fn of_av(runs: &[super::Run<'_>]) -> Vec<Self> {
        let summaries = || runs.iter().map(|run| run.summary);
        let own = Self::own(summaries()).into_iter().filter(Self::is_of_av);
        Self::av_of_benchmark().chain(own).filter(|column| column.has_numbers(summaries())).collect()
    }

    /// Returns the columns for which at least one simulator has a number, and those of `also`.
    pub(super) fn used(summaries: &[&Summary], also: &[Self]) -> Vec<Self> {
        let any =
            |holds: fn(&SettingsRecord) -> bool| summaries.iter().any(|s| holds(&s.provenance.run.settings));
        let has = |c: &Self| {
            let applies = CONDITIONS.iter().filter(|(id, _)| *id == c.metric).all(|(_, holds)| any(*holds));
            applies && c.has_numbers(summaries.iter().copied())
        };
        let own = Self::own(summaries.iter().copied()).into_iter().filter(|column| !column.is_of_av());
        Self::with(COLUMNS.iter().copied().chain(own).filter(has).collect(), also)
    }
}

/// Returns the title of the table of the AV, which names the planner if all runs have the same.
pub(super) fn av_title(runs: &[super::Run<'_>]) -> String {
    let mut planners: Vec<&str> = runs.iter().filter_map(planner).collect();
    planners.dedup();
    let by = match planners.as_slice() {
        [one] => format!("planner {one}"),
        _ => "a planner".to_owned(),
    };
    format!("The AV, driven by {by} and judged by nuPlan's closed-loop metrics")
}

fn planner<'a>(run: &super::Run<'a>) -> Option<&'a str> {
    run.summary.provenance.run.settings.planner()
}

/// Returns what drives the AV of each run, if a planner drives that of at least one of several runs.
fn avs<'a>(runs: &[super::Run<'a>]) -> Vec<Option<&'a str>> {
    let are_shown = runs.len() > 1 && runs.iter().any(|run| planner(run).is_some());
    let av = |run: &super::Run<'a>| planner(run).unwrap_or(&run.summary.provenance.run.settings.av);
    runs.iter().map(|run| are_shown.then(|| av(run))).collect()
}

/// Returns the lines of a table over runs whose AV a planner drives.
pub(super) fn av_lines<'a>(runs: &'a [super::Run<'a>]) -> Vec<Line<'a>> {
    lines_of(runs, None, |run| planner(run).is_some())
}

/// A line of a table: a simulator and its numbers.
pub(super) struct Line<'a> {
    /// Name of the run, if the table has several runs.
    pub(super) run: Option<&'a str>,
    /// What drives the AV, if the table has several runs of which at least one has a planner.
    pub(super) av: Option<&'a str>,
    /// Number of the group of runs with which its numbers can be compared.
    pub(super) group: usize,
    pub(super) title: &'a str,
    pub(super) marks: TableMarks,
    pub(super) scenarios: usize,
    pub(super) failed: usize,
    pub(super) metrics: &'a BTreeMap<String, Estimate>,
}

/// Returns the lines of a table over runs, or over one part of their scenarios, in the order of their
/// simulators.
pub(super) fn lines<'a>(runs: &'a [super::Run<'a>], part: Option<(Division, &str)>) -> Vec<Line<'a>> {
    lines_of(runs, part, |_| true)
}

/// As [`lines`], of the runs for which `is_shown` holds.
fn lines_of<'a>(
    runs: &'a [super::Run<'a>],
    part: Option<(Division, &str)>,
    is_shown: fn(&super::Run<'a>) -> bool,
) -> Vec<Line<'a>> {
    let several = runs.len() > 1;
    let shown = runs.iter().zip(groups(runs)).zip(avs(runs)).filter(|((run, _), _)| is_shown(run));
    let mut lines = Vec::new();
    for ((run, group), av) in shown {
        for (_, title, simulator) in run.summary.order() {
            let (scenarios, failed, metrics) = match part {
                None => (simulator.scenarios, simulator.failed, &simulator.metrics),
                Some((division, part)) => match division.of(simulator).get(part) {
                    Some(part) => (part.scenarios, 0, &part.metrics),
                    None => continue,
                },
            };
            let (run, marks) = (several.then_some(run.name), simulator.marks());
            lines.push(Line { run, av, group, title, marks, scenarios, failed, metrics });
        }
    }
    lines
}

/// Returns the provenance of every run, behind its name if there are several, and before that why they cannot
/// be compared.
pub(super) fn provenances(runs: &[super::Run<'_>]) -> Vec<String> {
    let name = |run: &super::Run<'_>| if runs.len() > 1 { format!("{}: ", run.name) } else { String::new() };
    let own = runs.iter().map(|run| format!("{}{}", name(run), provenance(run)));
    incomparable(runs).into_iter().chain(own).collect()
}

/// Returns in what runs differ whose rows cannot be compared; `None` if all are of one group ([`groups`]).
fn incomparable(runs: &[super::Run<'_>]) -> Option<String> {
    let mut differences: Vec<String> = Vec::new();
    let first = &runs.first()?.summary.provenance;
    for (run, _) in runs.iter().zip(groups(runs)).filter(|(_, group)| *group > 0) {
        let other = &run.summary.provenance;
        let lengths = [first.stated_duration(), other.stated_duration()];
        let scenarios = if lengths[0] != lengths[1] {
            Some(format!("length ({})", lengths.join(", ")))
        } else {
            (first.scenarios_blake3 != other.scenarios_blake3).then(|| "scenarios".to_owned())
        };
        let conditions = Condition::differences(&first.run, &other.run);
        let conditions = conditions.into_iter().map(|difference| difference.condition.name().to_owned());
        for difference in scenarios.into_iter().chain(conditions) {
            if !differences.contains(&difference) {
                differences.push(difference);
            }
        }
    }
    let text =
        || format!("Not all runs can be compared with each other: they differ in {}", differences.join(", "));
    (!differences.is_empty()).then(text)
}

/// Returns the text of [`unequal`] for the tables of runs with these columns, and for that of the AV: over
/// all scenarios or one part of them.
pub(super) fn fewer(
    runs: &[super::Run<'_>],
    columns: &[Column],
    part: Option<(Division, &str)>,
) -> Option<String> {
    let planned: Vec<super::Run<'_>> = runs.iter().copied().filter(|run| planner(run).is_some()).collect();
    let of_av = Column::of_av(runs);
    let of_av = of_av.iter().map(|column| (column, lines(&planned, part)));
    unequal(columns.iter().map(|column| (column, lines(runs, part))).chain(of_av))
}

/// Returns the numbers of scenarios of columns that could not be judged in all of them, if there are such:
/// the means of two lines may then be of different scenarios.
fn unequal<'a>(columns: impl IntoIterator<Item = (&'a Column, Vec<Line<'a>>)>) -> Option<String> {
    let counted = |(column, lines): (&Column, Vec<Line<'_>>)| {
        let of = |line: &Line<'_>| {
            let estimate = line.metrics.get(column.metric).filter(|e| e.mean.is_some())?;
            Some((estimate.scenarios, line.scenarios))
        };
        let judged: Vec<(usize, usize)> = lines.iter().filter_map(of).collect();
        let counts = || judged.iter().map(|(judged, _)| *judged);
        let (least, most) = (counts().min()?, counts().max()?);
        let is_less = judged.iter().any(|(judged, all)| judged < all);
        let range = if least == most { least.to_string() } else { format!("{least} to {most}") };
        is_less.then(|| format!("{} {range}", column.title()))
    };
    let counts: Vec<String> = columns.into_iter().filter_map(counted).collect();
    (!counts.is_empty()).then(|| {
        format!(
            "Means of fewer scenarios: {}; `reactsim compare` takes those that both rows have",
            counts.join(", ")
        )
    })
}

/// Returns the marks that these simulators have.
pub(super) fn marked(of: impl IntoIterator<Item = TableMarks>) -> impl Iterator<Item = Mark> {
    let found: Vec<Mark> = of.into_iter().flat_map(TableMarks::marks).collect();
    Mark::ALL.into_iter().filter(move |mark| found.contains(mark))
}

/// Returns for every column whether the number of each line is the best of its group.
pub(super) fn best_of_columns(columns: &[Column], lines: &[Line<'_>]) -> Vec<Vec<bool>> {
    columns.iter().map(|column| best(column, lines)).collect()
}

/// Returns the number of the group of every run: runs of one group have the same scenarios and differ in no
/// [`Condition`].
pub(super) fn groups(runs: &[super::Run<'_>]) -> Vec<usize> {
    let same = |a: &super::Run<'_>, b: &super::Run<'_>| {
        let (a, b) = (&a.summary.provenance, &b.summary.provenance);
        a.scenarios_blake3 == b.scenarios_blake3 && Condition::differences(&a.run, &b.run).is_empty()
    };
    let first = |run| runs.iter().position(|earlier| same(earlier, run)).unwrap_or_default();
    runs.iter().map(first).collect()
}

/// Returns for every line whether its number in a column is the best of its group, as printed, so that equal
/// numbers tie. Oracles are not ranked, and one simulator alone is not the best.
pub(super) fn best(column: &Column, lines: &[Line<'_>]) -> Vec<bool> {
    let value = |line: &Line<'_>| line.metrics.get(column.metric).and_then(|estimate| estimate.mean);
    let of = |line: &Line<'_>| {
        let ranked = lines.iter().filter(|l| l.group == line.group && !l.marks.is_oracle());
        let ranked: Vec<f64> = ranked.filter_map(value).collect();
        let own = value(line).filter(|_| !line.marks.is_oracle()).map(|value| column.number(value));
        own.is_some() && own == best_number(column, &ranked)
    };
    lines.iter().map(of).collect()
}

/// Returns the best of the numbers of a column, as printed; `None` if there are fewer than two.
pub(super) fn best_number(column: &Column, numbers: &[f64]) -> Option<String> {
    let better = if column.kind().1 { f64::min } else { f64::max };
    numbers.iter().copied().reduce(better).filter(|_| numbers.len() > 1).map(|best| column.number(best))
}

/// A division of the scenarios into parts with separate tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Division {
    /// Division by category of deviation.
    Category,
    /// Division by difficulty of the deviation.
    Difficulty,
}

impl Division {
    /// All divisions, in the order of their tables.
    pub const ALL: [Self; 2] = [Self::Category, Self::Difficulty];

    /// Returns the results of a simulator by part.
    pub(super) fn of(self, simulator: &SimulatorSummary) -> &BTreeMap<String, CategorySummary> {
        match self {
            Self::Category => &simulator.by_category,
            Self::Difficulty => &simulator.by_difficulty,
        }
    }

    /// Returns the parts that occur in the runs: categories by name, difficulties from easy to hard.
    pub(super) fn parts(self, runs: &[super::Run<'_>]) -> Vec<String> {
        let simulators = runs.iter().flat_map(|r| r.summary.simulators.values());
        let mut names: Vec<String> = simulators.flat_map(|s| self.of(s).keys().cloned()).collect();
        names.sort_by_cached_key(|name| (Difficulty::from_name(name), name.clone()));
        names.dedup();
        names
    }

    /// Returns the name of the scenarios of a part, such as `lateral deviations`.
    pub(super) fn title(self, part: &str) -> String {
        match self {
            Self::Category => format!("{part} deviations"),
            Self::Difficulty => format!("{part} conflicts"),
        }
    }
}

/// Describes the provenance of a run in one line.
pub(super) fn provenance(run: &super::Run<'_>) -> String {
    let p = &run.summary.provenance;
    let s = &p.run.settings;
    let mut parts: Vec<String> = p.run.benchmark.iter().map(ToString::to_string).collect();
    parts.push(scenarios(p));
    if !p.failures.is_empty() {
        parts.push(count(p.failures.len(), "failure"));
    }
    if p.passed_over > 0 {
        parts.push(format!("{} passed over", p.passed_over));
    }
    if p.unselected > 0 {
        parts.push(format!("{} not selected", p.unselected));
    }
    if p.run.is_recorded() {
        parts.push("recorded elsewhere".to_owned());
        parts.push(count(s.rollouts as usize, "rollout"));
    } else {
        protocol(s, &mut parts);
    }
    parts.extend(s.pose.iter().map(|pose| format!("poses of {pose}")));
    let allowed = p.allowed.iter().map(|(name, n)| format!("{} allowed as {name}", count(*n, "exception")));
    parts.extend(allowed);
    let changed = changed_options(&p.run);
    if !changed.is_empty() {
        parts.push(format!("metric options {}", changed.join(" ")));
    }
    for simulator in p.run.simulators.iter().flat_map(|simulator| simulator.parts()) {
        let mut details = Vec::new();
        if let Some(weights) = &simulator.weights {
            // A prefix of the digest suffices to identify files; the provenance has all of it.
            details.push(format!("{} ({:.12})", weights.name, weights.sha256));
        }
        details.extend(simulator.parameters.iter().map(|(key, value)| format!("{key}={value}")));
        let text = format!("{} with {}", simulator.id, details.join(" "));
        // A simulator may also be a member of a mix.
        if !details.is_empty() && !parts.contains(&text) {
            parts.push(text);
        }
    }
    parts.push(program(&p.run));
    parts.join(", ")
}

/// Returns the number of scenarios of a run, with their duration unless it is that of the benchmark.
pub(super) fn scenarios(run: &SummaryProvenance) -> String {
    let duration = run.duration().map(|duration| format!(" of {duration}")).unwrap_or_default();
    format!("{}{duration}", count(run.scenarios, "scenario"))
}

/// Returns version and commit of the program.
pub(super) fn program(run: &Provenance) -> String {
    let commit = if run.commit == "unknown" { "" } else { &run.commit };
    let plus = if commit.ends_with('+') { "+" } else { "" };
    let short: String = commit.chars().take(9).collect();
    let version = &run.version;
    match short.is_empty() {
        true => format!("reactsim {version}"),
        false => format!("reactsim {version} ({}{plus})", short.trim_end_matches('+')),
    }
}

/// Adds the settings of the rollouts to `parts`.
pub(super) fn protocol(s: &SettingsRecord, parts: &mut Vec<String>) {
    parts.push(format!("{} protocol", s.protocol));
    if s.protocol == "reactive" {
        parts.push(format!("AV {}", s.av));
        if !s.av_lookahead {
            parts.push("AV lookahead 0".to_owned());
        }
    }
    parts.extend(s.entering.iter().map(|entering| format!("entering {entering}")));
    parts.push(format!("replan every {}", count(s.replan_steps, "step")));
    parts.push(count(s.rollouts as usize, "rollout"));
    parts.push(format!("seed {}", s.seed));
}

/// Returns a count with its noun in singular or plural.
pub(super) fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use reactsim_evaluation::Access;

    use super::*;

    #[test]
    fn means_of_fewer_scenarios_are_named() {
        let estimate = |scenarios| Estimate {
            mean: Some(1.0).filter(|_| scenarios > 0),
            scenarios,
            ..Estimate::default()
        };
        let metrics = |ade, progress, over_reaction| {
            [("ade", ade), ("progress", progress), ("over-reaction", over_reaction)]
                .map(|(id, scenarios)| (id.to_owned(), estimate(scenarios)))
                .into()
        };
        // Nothing could be judged in the first one.
        let all: [BTreeMap<String, Estimate>; 3] =
            [metrics(30, 28, 0), metrics(30, 28, 29), metrics(30, 28, 27)];
        let line = |metrics| Line {
            run: None,
            av: None,
            group: 0,
            title: "",
            marks: TableMarks { access: Access::Blind, is_allowed: false },
            scenarios: 30,
            failed: 0,
            metrics,
        };
        let columns = ["ade", "progress", "over-reaction"].map(|id| Column::of(id).unwrap());
        let note = unequal(columns.iter().map(|column| (column, all.iter().map(line).collect())));
        let expected = "Means of fewer scenarios: Progress 28, Over-r. 27 to 29; `reactsim compare` takes those that both \
                        rows have";
        assert_eq!(note.as_deref(), Some(expected));
        assert_eq!(unequal([(&columns[0], all.iter().map(line).collect())]), None);
    }
}
