//! Steps 1 to 3 for one scenario.

use std::collections::BTreeMap;

use super::filter::{Bench, FilterSettings, Trial};
use super::filters::FILTERS;
use super::rules::Rules;
use super::{
    Candidate, CandidateRecord, CandidateSource, Figure, Preselection, ScenarioRecord, choice, taxonomy,
};
use crate::rollout::{Purpose, Stream, stream};
use crate::scene::{AgentState, Scenario};

/// All sources of candidates.
pub const SOURCES: &[&dyn CandidateSource] = &[&Rules];

/// What decides a set of deviated AVs, besides scenarios and source.
#[derive(Clone, Debug, PartialEq)]
pub struct CurationSettings {
    /// Seed of all random streams.
    pub seed: u64,
    /// Candidates per scenario.
    pub candidates: u32,
    /// Whether the file holds what the review page draws.
    pub scenes: bool,
    /// Step 1.
    pub preselection: Preselection,
    /// Step 3.
    pub filters: FilterSettings,
}

impl Default for CurationSettings {
    fn default() -> Self {
        Self {
            seed: 0,
            candidates: 16,
            scenes: true,
            preselection: Preselection::default(),
            filters: FilterSettings::default(),
        }
    }
}

impl CurationSettings {
    /// All settings by name, as they stand in files; and beside them what every filter asks for, in words.
    pub fn named(&self) -> BTreeMap<String, String> {
        let mut named = BTreeMap::new();
        named.insert("seed".to_owned(), self.seed.to_string());
        named.insert("candidates".to_owned(), self.candidates.to_string());
        flatten("preselection", &serde_json::json!(self.preselection), &mut named);
        flatten("filters", &serde_json::json!(self.filters), &mut named);
        for filter in FILTERS {
            named.insert(format!("rule.{}", filter.id()), filter.rule(&self.filters));
        }
        named
    }
}

/// Puts the values of nested settings into a list, with their names joined by dots.
fn flatten(name: &str, value: &serde_json::Value, named: &mut BTreeMap<String, String>) {
    match value {
        serde_json::Value::Object(fields) => {
            fields.iter().for_each(|(field, value)| flatten(&format!("{name}.{field}"), value, named));
        }
        value => {
            named.insert(name.to_owned(), value.to_string());
        }
    }
}

/// What became of a scenario.
#[derive(Clone, Debug, PartialEq)]
pub enum Curated {
    /// It fell in step 1.
    Dropped {
        /// At which rule.
        rule: String,
    },
    /// It has candidates; none is chosen yet. Beside them, how many streams the source had nothing to propose for, by reason.
    Kept(Box<ScenarioRecord>, BTreeMap<String, u64>),
}

/// Carries out the steps 1 to 3 for one scenario. The result depends on scenario, source and settings only.
pub fn curate_scenario(
    scenario: &Scenario,
    source: &dyn CandidateSource,
    settings: &CurationSettings,
) -> Curated {
    if let Some(rule) = settings.preselection.falls(scenario) {
        return Curated::Dropped { rule: rule.to_owned() };
    }
    let bench = match Bench::new(scenario) {
        Ok(bench) => bench,
        Err(_) => return Curated::Dropped { rule: super::preselect::AV_ABSENT.to_owned() },
    };
    let name = |number| stream(settings.seed, &scenario.id, number, Purpose::Candidate);
    let mut streams: Vec<Stream> = (0..settings.candidates).map(name).collect();
    let (mut candidates, mut unproposed) = (Vec::new(), BTreeMap::new());
    for (number, proposal) in (0_u32..).zip(source.propose(scenario, &mut streams)) {
        match proposal {
            Ok(proposal) => {
                let mut track = vec![scenario.start.now(0)];
                track.extend(proposal.future);
                if candidates.iter().any(|c: &CandidateRecord| is_same(&c.candidate.track, &track)) {
                    *unproposed.entry(REPEATED.to_owned()).or_default() += 1;
                    continue;
                }
                let candidate = Candidate {
                    source: source.id().to_owned(),
                    number,
                    intent: proposal.intent,
                    maneuver: proposal.maneuver,
                    track,
                };
                candidates.push(judge(&bench, candidate, settings));
            }
            Err(reason) => *unproposed.entry(reason.0).or_default() += 1,
        }
    }
    let record = ScenarioRecord {
        scenario_id: scenario.id.clone(),
        scenario_digest: scenario.digest(),
        origin: scenario.origin,
        candidates,
        scene: settings.scenes.then(|| crate::web::sketch(scenario)),
    };
    Curated::Kept(Box::new(record), unproposed)
}

/// Why a proposal is no candidate.
const REPEATED: &str = "the same as an earlier candidate";
/// Two trajectories that are nowhere farther apart are the same, metres.
const SAME: f64 = 0.2;

fn is_same(a: &[AgentState], b: &[AgentState]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a.position() - b.position()).norm() <= SAME)
}

/// Asks all filters about one candidate.
fn judge(bench: &Bench<'_>, candidate: Candidate, settings: &CurationSettings) -> CandidateRecord {
    let trial = Trial::new(bench, &candidate, &settings.filters);
    let mut figures = Vec::with_capacity(FILTERS.len());
    let mut rejected: Option<(String, String)> = None;
    for filter in FILTERS {
        if filter.is_dear() && rejected.is_some() {
            figures.push(Figure { filter: filter.id().to_owned(), value: None, passed: None });
            continue;
        }
        let verdict = filter.judge(&trial);
        let passed = verdict.rejected.is_none();
        figures.push(Figure { filter: filter.id().to_owned(), value: verdict.figure, passed: Some(passed) });
        if let (Some(reason), None) = (verdict.rejected, &rejected) {
            rejected = Some((filter.id().to_owned(), reason));
        }
    }
    let taxonomy = taxonomy::classify(
        &bench.scenario.start.road(),
        &bench.way,
        &bench.log,
        &candidate.track,
        &bench.scenario.start.agents[0],
        trial.conflict(),
    );
    let (pressure, offsets) = (trial.pressure(), trial.offsets());
    let certificate = if rejected.is_none() { trial.certificate().as_ref().ok().cloned() } else { None };
    drop(trial);
    let (rejected_by, reason) = rejected.map_or((None, String::new()), |(by, why)| (Some(by), why));
    let mut record = CandidateRecord {
        candidate,
        seed: settings.seed,
        taxonomy,
        pressure,
        offsets,
        figures,
        rejected_by,
        reason,
        score: f64::NAN,
        chosen: false,
        review: None,
        certificate,
    };
    if record.rejected_by.is_none() {
        record.score = choice::score(&record);
    }
    record
}
