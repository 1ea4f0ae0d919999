//! Steps 1 to 3 for one scenario.

use std::collections::BTreeMap;

use reactsim_rollout::{AvError, Purpose, Stream, stream};
use reactsim_scene::{AgentState, Scenario};

use super::filter::{FilterContext, FilterSettings, Trial};
use super::filters::{EXPENSIVE, FILTERS};
use super::rules::Rules;
use super::{
    Candidate, CandidateRecord, CandidateSource, Figure, Preselection, Proposal, ScenarioRecord, Taxonomy,
    choice, taxonomy,
};

/// All sources of candidates apart from files ([`super::CandidateFile`]).
pub const SOURCES: &[&dyn CandidateSource] = &[&Rules];

/// Settings that determine a set of deviated AVs, apart from scenarios and source.
#[derive(Clone, Debug, PartialEq)]
pub struct CurationSettings {
    /// Seed of all random streams.
    pub seed: u64,
    /// Candidates per scenario.
    pub candidates: u32,
    /// Whether the file holds the scenes that the review page draws.
    pub scenes: bool,
    /// Criteria of step 1.
    pub preselection: Preselection,
    /// Limits of step 3.
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
    /// Returns all settings by name, as stored in files, together with the requirement of every filter
    /// in words.
    pub fn named(&self) -> BTreeMap<String, String> {
        let mut named = BTreeMap::new();
        named.insert("seed".to_owned(), self.seed.to_string());
        named.insert("candidates".to_owned(), self.candidates.to_string());
        flatten("preselection", &serde_json::json!(self.preselection), &mut named);
        flatten("filters", &serde_json::json!(self.filters), &mut named);
        for filter in FILTERS {
            named.insert(format!("rule.{}", filter.id), (filter.rule)(&self.filters));
        }
        named
    }
}

/// Adds the values of nested settings to a map, with their names joined by dots.
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

/// Outcome of steps 1 to 3 for a scenario.
#[derive(Clone, Debug, PartialEq)]
pub enum CurationOutcome {
    /// Rejected in step 1.
    Rejected {
        /// The rule that rejected it.
        rule: String,
    },
    /// The candidates, none of which is chosen yet, and the number of streams without a proposal, by
    /// reason.
    Retained(Box<ScenarioRecord>, BTreeMap<String, u64>),
}

/// Runs steps 1 to 3 for one scenario. The result depends on scenario, source and settings only. The scene of
/// the record is left out.
pub fn curate_scenario(
    scenario: &Scenario,
    source: &dyn CandidateSource,
    settings: &CurationSettings,
) -> CurationOutcome {
    if let Some(rule) = settings.preselection.failed_rule(scenario) {
        return CurationOutcome::Rejected { rule: rule.to_owned() };
    }
    let context = match FilterContext::new(scenario) {
        Ok(context) => context,
        Err(_) => return CurationOutcome::Rejected { rule: super::preselect::AV_ABSENT.to_owned() },
    };
    let name = |number| stream(settings.seed, &scenario.id, number, Purpose::Candidate);
    let mut streams: Vec<Stream> = (0..settings.candidates).map(name).collect();
    let steps = scenario.length().future;
    let (mut candidates, mut unproposed) = (Vec::new(), BTreeMap::new());
    for (number, proposal) in (0_u32..).zip(source.propose(scenario, &mut streams)) {
        match proposal {
            Ok(Proposal { future, .. }) if future.len() != steps => {
                let reason = format!("{} steps where the scenario has {steps}", future.len());
                *unproposed.entry(reason).or_default() += 1;
            }
            Ok(proposal) => {
                let mut track = vec![scenario.start.now(0)];
                track.extend(proposal.future);
                if candidates.iter().any(|c: &CandidateRecord| is_same(&c.candidate.track, &track)) {
                    *unproposed.entry(REPEATED_PROPOSAL.to_owned()).or_default() += 1;
                    continue;
                }
                let candidate = Candidate {
                    source: source.id().to_owned(),
                    number,
                    intent: proposal.intent,
                    maneuver: proposal.maneuver,
                    track,
                };
                candidates.push(judge(&context, candidate, settings));
            }
            Err(reason) => *unproposed.entry(reason.0).or_default() += 1,
        }
    }
    let record = ScenarioRecord {
        scenario_id: scenario.id.clone(),
        scenario_digest: scenario.digest(),
        origin: scenario.origin,
        candidates,
        scene: None,
    };
    CurationOutcome::Retained(Box::new(record), unproposed)
}

/// Reason for dropping a proposal that repeats an earlier one.
const REPEATED_PROPOSAL: &str = "the same as an earlier candidate";
/// Largest distance between two trajectories that count as the same, metres.
const SAME_TRAJECTORY_DISTANCE: f64 = 0.2;

fn is_same(a: &[AgentState], b: &[AgentState]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a.position() - b.position()).norm() <= SAME_TRAJECTORY_DISTANCE)
}

/// Determines the category of a trajectory that another program made.
///
/// # Errors
/// [`AvError`] when the trajectory does not have a state for each step of the scenario, and when the logged
/// AV is absent at a step, or jumps.
pub fn taxonomy_of(scenario: &Scenario, future: &[AgentState]) -> Result<Taxonomy, AvError> {
    let (found, expected) = (future.len(), scenario.length().future);
    if found != expected {
        return Err(AvError::length(found, expected));
    }
    let context = FilterContext::new(scenario)?;
    let track = std::iter::once(scenario.start.now(0)).chain(future.iter().copied()).collect();
    let (source, maneuver) = (String::new(), String::new());
    let candidate = Candidate { source, number: 0, intent: None, maneuver, track };
    Ok(classified(&Trial::new(&context, &candidate, &FilterSettings::default())))
}

fn classified(trial: &Trial<'_>) -> Taxonomy {
    let context = trial.context;
    taxonomy::classify(
        &context.scenario.start.road(),
        &context.logged_path,
        &context.log,
        &trial.candidate.track,
        &context.scenario.start.agents[0],
        trial.conflict(),
    )
}

/// Applies all filters to one candidate.
fn judge(context: &FilterContext<'_>, candidate: Candidate, settings: &CurationSettings) -> CandidateRecord {
    let trial = Trial::new(context, &candidate, &settings.filters);
    let mut figures = Vec::with_capacity(FILTERS.len());
    let mut rejected: Option<(String, String)> = None;
    for filter in FILTERS {
        if filter.id == EXPENSIVE && rejected.is_some() {
            figures.push(Figure { filter: filter.id.to_owned(), value: None, passed: None });
            continue;
        }
        let verdict = (filter.judge)(&trial);
        let passed = verdict.rejected.is_none();
        figures.push(Figure { filter: filter.id.to_owned(), value: verdict.figure, passed: Some(passed) });
        if let (Some(reason), None) = (verdict.rejected, &rejected) {
            rejected = Some((filter.id.to_owned(), reason));
        }
    }
    let taxonomy = classified(&trial);
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
