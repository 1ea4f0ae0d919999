//! The numbers of a page, as JSON.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_evaluation::{Entry, Mark, Summary, TableMarks, program_commit, program_version};
use reactsim_metrics::{EVENT_UNITS, METRICS, MetricSpec, Scope, metric};
use serde::Serialize;
use serde_json::value::RawValue;

use super::PageError;
use super::choice::{Lead, reacts};
use super::gallery::{Gallery, GalleryScenario};
use crate::paper::PaperTable;
use crate::table::{self, Column, Division};
use crate::wosac_tables::{AGGREGATES, Aggregate};
use crate::{Run, TableStyle, exporter, study_tables};

/// Formats and file names of the results that the page offers for download.
const DOWNLOADS: [(&str, &str); 3] =
    [("csv", "results.csv"), ("json", "results.json"), ("latex", "results.tex")];

/// All numbers of a page.
#[derive(Serialize)]
pub(super) struct Data<'a> {
    version: &'static str,
    commit: &'static str,
    /// Whether scenes are requested from a server; otherwise they are embedded in the page.
    live: bool,
    /// The scenario of the first screen; `None` if no scene fits.
    lead: Option<Lead>,
    /// Reasons why scenes are unavailable.
    lacks: Vec<String>,
    metrics: Vec<MetricData>,
    /// Metrics of the main table.
    columns: Vec<&'static str>,
    /// Metrics of the table of the AV; empty if no planner drives.
    av_columns: Vec<&'static str>,
    /// Which means of the tables are of fewer scenarios, by part of the scenarios: `all`, a category or a
    /// difficulty.
    fewer: BTreeMap<String, String>,
    /// Columns of the realism metrics of the Sim Agents challenge.
    aggregates: [Aggregate; AGGREGATES.len()],
    /// Units of the values of events, by name.
    event_units: BTreeMap<&'static str, &'static str>,
    runs: Vec<RunData<'a>>,
    subjects: Vec<SubjectData<'a>>,
    scenarios: ScenarioData<'a>,
    studies: Vec<StudyData<'a>>,
    /// The paper's rows, if a run may be comparable with them: deviated AVs on logs of nuPlan.
    paper: Option<PaperTable>,
    downloads: Vec<Download>,
}

#[derive(Serialize)]
struct StudyData<'a> {
    name: &'a str,
    /// Numbers of its tables ([`study_tables::write_json`]).
    numbers: Box<RawValue>,
}

#[derive(Serialize)]
struct MetricData {
    id: &'static str,
    title: &'static str,
    unit: &'static str,
    lower_is_better: bool,
    source: &'static str,
    /// Whether it judges the AV.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    av: bool,
    /// Whether the benchmark does not have the metric.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    own: bool,
}

#[derive(Serialize)]
struct RunData<'a> {
    name: &'a str,
    /// Name of its study, and its label there.
    study: &'a Option<(String, String)>,
    /// Number of the group of runs with which its numbers can be compared.
    group: usize,
    /// Provenance in one line.
    about: String,
    /// Notes of the scenarios, one text per kind.
    notes: Vec<String>,
    summary: &'a Summary,
}

#[derive(Serialize)]
struct SubjectData<'a> {
    run: usize,
    id: &'a str,
    title: &'a str,
    oracle: bool,
    /// Whether its agents can react to the AV.
    reacts: bool,
    mark: String,
    meaning: String,
}

/// The scenarios, column by column.
#[derive(Serialize)]
struct ScenarioData<'a> {
    id: Vec<&'a str>,
    /// Category of the deviation in the first run that states one.
    category: Vec<Option<&'a str>>,
    difficulty: Vec<Option<&'a str>>,
    /// Per run: category of the deviation.
    categories: Vec<Vec<Option<&'a str>>>,
    /// Per run: difficulty of the conflict.
    difficulties: Vec<Vec<Option<&'a str>>>,
    /// Whether there is a scene, as 0 or 1.
    scene: Vec<u8>,
    /// Per run: statistics of the deviation from the log, by name.
    deviation: Vec<BTreeMap<&'a str, Vec<Option<f64>>>>,
    /// Per subject and metric, in order; empty for a metric without any value.
    values: Vec<Vec<Vec<Option<f64>>>>,
    /// Per subject and metric: number of counted events in all rollouts; empty if there are none.
    events: Vec<Vec<Vec<u32>>>,
}

#[derive(Serialize)]
struct Download {
    name: &'static str,
    text: String,
}

/// Rounds a value to six significant digits; the summary has all of them.
fn short(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

impl Gallery {
    /// Returns the data of the page. `scenes`: numbers of the scenarios that have a scene.
    pub(super) fn data(&self, scenes: &BTreeSet<usize>, live: bool) -> Result<Data<'_>, PageError> {
        let runs: Vec<Run<'_>> =
            self.runs.iter().map(|r| Run { name: &r.name, summary: r.finished.summary() }).collect();
        let summaries: Vec<&Summary> = runs.iter().map(|r| r.summary).collect();
        let mut downloads = Vec::new();
        for (form, name) in DOWNLOADS {
            let mut text = Vec::new();
            if let Some(exporter) = exporter(form) {
                exporter.export(&runs, TableStyle::default(), &mut text)?;
            }
            downloads.push(Download { name, text: String::from_utf8_lossy(&text).into_owned() });
        }
        let columns = Column::used(&summaries, &[]);
        let mut fewer: BTreeMap<String, String> = BTreeMap::new();
        fewer.extend(table::fewer(&runs, &columns, None).map(|text| ("all".to_owned(), text)));
        for division in Division::ALL {
            for part in division.parts(&runs) {
                fewer.extend(table::fewer(&runs, &columns, Some((division, &part))).map(|text| (part, text)));
            }
        }
        Ok(Data {
            version: program_version(),
            commit: program_commit(),
            live,
            lead: self.lead()?.filter(|lead| scenes.contains(&lead.scenario)),
            lacks: self.missing_for_scenes(),
            metrics: self
                .metrics()
                .into_iter()
                .map(|spec| MetricData {
                    id: spec.id,
                    title: spec.title,
                    unit: spec.unit.name(),
                    lower_is_better: spec.lower_is_better,
                    source: spec.source,
                    av: spec.scope == Scope::Av,
                    own: metric(spec.id).is_none(),
                })
                .collect(),
            columns: columns.iter().map(|c| c.metric).collect(),
            av_columns: Column::of_av(&runs).iter().map(|c| c.metric).collect(),
            fewer,
            aggregates: AGGREGATES,
            event_units: EVENT_UNITS.iter().copied().collect(),
            runs: self
                .runs
                .iter()
                .zip(&runs)
                .zip(table::groups(&runs))
                .map(|((member, run), group)| RunData {
                    name: &member.name,
                    study: &member.study,
                    group,
                    about: table::provenance(run),
                    notes: run.summary.provenance.notes.iter().map(|(id, note)| note.text(id)).collect(),
                    summary: run.summary,
                })
                .collect(),
            subjects: self
                .subjects
                .iter()
                .map(|s| SubjectData {
                    run: s.run,
                    id: &s.id,
                    title: &s.title,
                    oracle: s.marks.is_oracle(),
                    reacts: reacts(&s.id),
                    mark: s.marks.signs(),
                    meaning: meaning(s.marks),
                })
                .collect(),
            scenarios: self.scenario_data(scenes),
            studies: self.study_data()?,
            paper: summaries.iter().any(|summary| is_like_paper(summary)).then(PaperTable::new),
            downloads,
        })
    }

    fn study_data(&self) -> Result<Vec<StudyData<'_>>, PageError> {
        let numbers = self.studies.iter().map(|(name, results)| {
            let mut text = Vec::new();
            study_tables::write_json(results, TableStyle::default(), &mut text)?;
            let text = String::from_utf8_lossy(&text).trim().to_owned();
            Ok(StudyData { name, numbers: RawValue::from_string(text)? })
        });
        numbers.collect()
    }

    /// Returns the metrics of the benchmark, then others of any run, each id once.
    fn metrics(&self) -> Vec<&'static MetricSpec> {
        let mut all: Vec<&'static MetricSpec> = METRICS.iter().map(|metric| metric.spec()).collect();
        for spec in self.runs.iter().flat_map(|run| &run.finished.tally().metrics) {
            if !all.iter().any(|known| known.id == spec.id) {
                all.push(spec);
            }
        }
        all
    }

    fn scenario_data(&self, scenes: &BTreeSet<usize>) -> ScenarioData<'_> {
        let entry = |run: usize, place| self.runs[run].finished.tally().entries.get(&place);
        let deviation = (0..self.runs.len()).map(|run| {
            let mut columns: BTreeMap<&str, Vec<Option<f64>>> = BTreeMap::new();
            for (i, scenario) in self.scenarios.iter().enumerate() {
                let Some(entry) = scenario.places[run].and_then(|place| entry(run, place)) else { continue };
                for (name, value) in &entry.deviation {
                    let column = columns.entry(name).or_insert_with(|| vec![None; self.scenarios.len()]);
                    column[i] = Some(short(*value));
                }
            }
            columns
        });
        let specs = self.metrics();
        let values = self.subjects.iter().map(|subject| {
            let metrics = specs.iter().map(|spec| {
                let Some(m) = self.runs[subject.run].finished.tally().metric(spec.id) else {
                    return Vec::new();
                };
                let column: Vec<Option<f64>> = self
                    .scenarios
                    .iter()
                    .map(|scenario| {
                        let entry = entry(subject.run, scenario.places[subject.run]?)?;
                        entry.cells[subject.simulator].as_ref()?.values[m].map(short)
                    })
                    .collect();
                if column.iter().all(Option::is_none) { Vec::new() } else { column }
            });
            metrics.collect()
        });
        let events = self.subjects.iter().map(|subject| {
            let finished = &self.runs[subject.run].finished;
            let metrics = specs.iter().map(|spec| {
                let count = |place| finished.counted(place, subject.simulator, spec.id);
                let column: Vec<u32> =
                    self.scenarios.iter().map(|s| s.places[subject.run].map_or(0, count)).collect();
                if column.iter().all(|n| *n == 0) { Vec::new() } else { column }
            });
            metrics.collect()
        });
        let per_run = |of: fn(&Entry) -> Option<&str>| -> Vec<Vec<Option<&str>>> {
            let column = |run: usize| {
                let own =
                    |s: &GalleryScenario| s.places[run].and_then(|place| entry(run, place)).and_then(of);
                self.scenarios.iter().map(own).collect()
            };
            (0..self.runs.len()).map(column).collect()
        };
        ScenarioData {
            categories: per_run(|entry| entry.category.as_deref()),
            difficulties: per_run(|entry| entry.difficulty.as_deref()),
            id: self.scenarios.iter().map(|s| s.id.as_str()).collect(),
            category: self.scenarios.iter().map(|s| s.category.as_deref()).collect(),
            difficulty: self.scenarios.iter().map(|s| s.difficulty.as_deref()).collect(),
            scene: (0..self.scenarios.len()).map(|i| u8::from(scenes.contains(&i))).collect(),
            deviation: deviation.collect(),
            values: values.collect(),
            events: events.collect(),
        }
    }
}

/// Returns whether a run has deviated AVs on logs of nuPlan, as the paper.
fn is_like_paper(summary: &Summary) -> bool {
    let run = &summary.provenance.run;
    run.deviations.is_some() && run.inputs.iter().any(|input| input.format == "nuplan")
}

/// Returns the explanation of the marks of a simulator.
fn meaning(marks: TableMarks) -> String {
    marks.marks().map(Mark::meaning).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_digits_are_kept() {
        assert_eq!(short(0.123_456_789), 0.123_457);
        assert_eq!(short(-1_234_567.0), -1_234_570.0);
        assert_eq!(short(0.0), 0.0);
    }
}
