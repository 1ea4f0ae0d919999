//! The data of the page, as JSON.

use std::collections::BTreeSet;

use reactsim_scene::{AgentState, Difficulty};
use serde::Serialize;

use super::{Opinions, ReviewLine, candidate_digest};
use crate::store::ScenarioEntry;
use crate::{CandidateRecord, Certificate, ScenarioRecord};

/// The list of all scenarios. Filters are named once; candidates are flat numbers: number, category,
/// index of the filter that rejected it (-1 for survivors), 1 if it was chosen.
#[derive(Debug, Serialize)]
pub(super) struct Overview {
    pub(super) filters: Vec<String>,
    pub(super) scenarios: Vec<ScenarioItem>,
}

/// A scenario in the list.
#[derive(Debug, Serialize)]
pub(super) struct ScenarioItem {
    id: String,
    candidates: Vec<i64>,
}

impl Overview {
    pub(super) fn new(entries: &[ScenarioEntry]) -> Self {
        let named = entries.iter().flat_map(|e| &e.candidates).filter_map(|c| c.rejected_by.as_ref());
        let filters: Vec<String> = named.collect::<BTreeSet<_>>().into_iter().cloned().collect();
        let place = |filter: &Option<String>| {
            filter.as_ref().and_then(|f| filters.binary_search(f).ok()).map_or(-1, |i| i as i64)
        };
        let scenarios = entries.iter().map(|entry| ScenarioItem {
            id: entry.scenario_id.clone(),
            candidates: entry
                .candidates
                .iter()
                .flat_map(|c| {
                    let (number, chosen) = (i64::from(c.number), i64::from(c.chosen));
                    [number, c.category as i64, place(&c.rejected_by), chosen]
                })
                .collect(),
        });
        let scenarios = scenarios.collect();
        Self { filters, scenarios }
    }
}

/// Decisions about one scenario.
#[derive(Debug, Serialize)]
pub(super) struct DecisionStatus {
    /// Number of the scenario in the file.
    pub(super) index: usize,
    /// The decision that counts.
    verdict: Option<ReviewLine>,
    /// Decision of every reviewer.
    opinions: Vec<ReviewLine>,
    /// Whether reviewers decided differently.
    disagree: bool,
}

impl DecisionStatus {
    pub(super) fn new(index: usize, opinions: &Opinions, digest: &str) -> Self {
        Self {
            index,
            verdict: opinions.verdict(digest).cloned(),
            opinions: opinions.standing(digest).cloned().collect(),
            disagree: opinions.disagree(digest),
        }
    }

    /// Returns whether there are no decisions.
    pub(super) fn is_empty(&self) -> bool {
        self.opinions.is_empty()
    }
}

/// A scenario without its scene.
#[derive(Serialize)]
struct Detail<'a> {
    index: usize,
    id: &'a str,
    digest: &'a str,
    origin: [f64; 2],
    /// Whether the verdict refers to another trajectory than the current one of that number.
    stale: bool,
    candidates: Vec<CandidateDetail<'a>>,
}

#[derive(Serialize)]
struct CandidateDetail<'a> {
    number: u32,
    digest: String,
    source: &'a str,
    intent: Option<&'static str>,
    maneuver: &'a str,
    category: &'static str,
    heading_change: Option<f64>,
    other_branch: bool,
    lateral_offset: Option<f64>,
    longitudinal_offset: Option<f64>,
    conflict_step: Option<u32>,
    difficulty: Option<&'static str>,
    required_deceleration: Option<f64>,
    time_to_react: Option<f64>,
    needs_swerve: Option<bool>,
    figures: Vec<FigureDetail<'a>>,
    rejected_by: Option<&'a str>,
    reason: &'a str,
    score: Option<f64>,
    chosen: bool,
    at_fault: u32,
    overlaps: u32,
    risky: u32,
    ade: Option<f64>,
    speed_difference: Option<f64>,
    track: Track,
    certificate: Option<Vec<ResponseDetail<'a>>>,
}

#[derive(Serialize)]
struct FigureDetail<'a> {
    filter: &'a str,
    value: Option<f64>,
    passed: Option<bool>,
}

#[derive(Serialize)]
struct ResponseDetail<'a> {
    agent: &'a str,
    reaction_step: usize,
    nudge: Option<f64>,
    peak_deceleration: Option<f64>,
    clearance: Option<f64>,
    track: Track,
}

/// States as columns: metres, radians, m/s.
#[derive(Serialize)]
struct Track {
    x: Vec<f64>,
    y: Vec<f64>,
    h: Vec<f64>,
    v: Vec<Option<f64>>,
}

/// Returns the value if it is finite; JSON has no other numbers.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Rounds to millimetres (or thousandths), which halves the size of the text.
fn short(value: f64) -> f64 {
    (value * 1000.0).round() / 1000.0
}

impl Track {
    fn new(states: &[AgentState]) -> Self {
        Self {
            x: states.iter().map(|s| short(s.x)).collect(),
            y: states.iter().map(|s| short(s.y)).collect(),
            h: states.iter().map(|s| (s.heading * 1e4).round() / 1e4).collect(),
            v: states.iter().map(|s| finite(s.speed()).map(short)).collect(),
        }
    }
}

fn responses(certificate: &Certificate) -> Vec<ResponseDetail<'_>> {
    let detail = certificate.responses.iter().map(|r| ResponseDetail {
        agent: &r.agent,
        reaction_step: r.reaction_step,
        nudge: finite(r.nudge),
        peak_deceleration: finite(r.peak_deceleration),
        clearance: finite(r.clearance),
        track: Track::new(&r.track),
    });
    detail.collect()
}

fn candidate(c: &CandidateRecord) -> CandidateDetail<'_> {
    let (candidate, taxonomy) = (&c.candidate, &c.taxonomy);
    let figures =
        c.figures.iter().map(|f| FigureDetail { filter: &f.filter, value: f.value, passed: f.passed });
    CandidateDetail {
        number: candidate.number,
        digest: candidate_digest(candidate),
        source: &candidate.source,
        intent: candidate.intent.map(|d| d.name()),
        maneuver: &candidate.maneuver,
        category: taxonomy.category.name(),
        heading_change: finite(taxonomy.heading_change),
        other_branch: taxonomy.other_branch,
        lateral_offset: finite(taxonomy.lateral_offset),
        longitudinal_offset: finite(taxonomy.longitudinal_offset),
        conflict_step: taxonomy.conflict_step,
        difficulty: c.difficulty().map(Difficulty::name),
        required_deceleration: c.certificate.as_ref().and_then(Certificate::required_deceleration),
        time_to_react: c.certificate.as_ref().and_then(Certificate::time_to_react),
        needs_swerve: c.certificate.as_ref().map(Certificate::needs_swerve),
        figures: figures.collect(),
        rejected_by: c.rejected_by.as_deref(),
        reason: &c.reason,
        score: finite(c.score),
        chosen: c.chosen,
        at_fault: c.pressure.at_fault,
        overlaps: c.pressure.overlaps,
        risky: c.pressure.risky,
        ade: finite(c.offsets.ade),
        speed_difference: finite(c.offsets.mean_speed_difference),
        track: Track::new(&candidate.track),
        certificate: c.certificate.as_ref().map(responses),
    }
}

/// Returns a whole scenario as JSON. Its scene is already JSON and is inserted unchanged; if it is
/// damaged, the page reports that.
pub(super) fn scenario_json(
    index: usize,
    record: &ScenarioRecord,
    opinions: &Opinions,
) -> serde_json::Result<String> {
    let detail = Detail {
        index,
        id: &record.scenario_id,
        digest: &record.scenario_digest,
        origin: [record.origin.x, record.origin.y],
        stale: opinions.verdict_for(record, false).is_some_and(|(_, fits)| !fits),
        candidates: record.candidates.iter().map(candidate).collect(),
    };
    let mut text = serde_json::to_string(&detail)?;
    text.pop();
    text.push_str(",\"scene\":");
    text.push_str(record.scene.as_deref().unwrap_or("null"));
    text.push('}');
    Ok(text)
}
