//! The page on which people verify candidates by hand (ReactSim-Bench, "Data Collection Pipeline", step 4).
//! The browser keeps their decisions and exports them.

use std::io::Write;
use std::path::Path;

use reactsim_curation::{CandidateRecord, ScenarioRecord, candidate_digest, store};
use reactsim_evaluation::FileRecord;
use reactsim_scene::{AgentState, Certificate, Deviation, Difficulty, Frame, Response};
use serde_json::{Value, json};

use super::PageError;
use super::document::{assemble, packed, script};
use super::tracks::spans;
use crate::web::Asset;

pub(super) const PAGE: &str = include_str!("assets/review/page.html");
const STYLE: &str = include_str!("assets/review/style.css");

/// The scripts of the page, each after those that it imports.
pub(super) const SCRIPTS: &[Asset] = &[
    script!("dom.js"),
    script!("review/", "decisions.js"),
    script!("review/", "queue.js"),
    script!("review/", "scenario.js"),
    script!("review/", "draw.js"),
    script!("review/", "scrub.js"),
    script!("review/", "panel.js"),
    script!("review/", "keys.js"),
    script!("review/", "main.js"),
];

/// Writes the page of a file of candidates as one self-contained file, with at most `count` scenarios from
/// number `from` on, which counts from 1. Returns the number of scenarios in the file.
///
/// # Errors
/// [`PageError`] if the file cannot be read, has no such scenario, or `out` cannot be written.
pub fn write_review(file: &Path, from: usize, count: usize, out: &mut dyn Write) -> Result<usize, PageError> {
    let records = store::read(file)?;
    let FileRecord { name, blake3: digest, .. } = FileRecord::of(file, "")?;
    let (mut total, mut scenarios, mut scenes) = (0, Vec::new(), String::new());
    for record in records {
        let record = record?;
        total += 1;
        if total >= from && scenarios.len() < count {
            scenes.push_str(&packed(scenarios.len(), &scene(&record)?)?);
            scenarios.push(overview(&record));
        }
    }
    if scenarios.is_empty() {
        return Err(PageError::Refused(format!(
            "{} has {total} scenarios with candidates: there is none to review from number {from} on",
            file.display()
        )));
    }
    let data = json!({
        "file": name, "digest": digest, "from": from, "total": total, "scenarios": scenarios,
    });
    let document = assemble((PAGE, STYLE), SCRIPTS, &data.to_string(), &scenes, "'none'");
    out.write_all(document.text.as_bytes())?;
    Ok(total)
}

/// Returns what the list of scenarios needs.
fn overview(record: &ScenarioRecord) -> Value {
    let candidates = record
        .candidates
        .iter()
        .map(|c| json!([c.candidate.number, c.taxonomy.category.name(), c.rejected_by, c.chosen]));
    json!({
        "id": record.scenario_id,
        "digest": record.scenario_digest,
        "candidates": candidates.collect::<Vec<_>>(),
    })
}

/// Returns the JSON of a scenario. Its sketch is already JSON and is inserted unchanged.
fn scene(record: &ScenarioRecord) -> serde_json::Result<String> {
    let candidates: Vec<Value> = record.candidates.iter().map(candidate).collect();
    let sketch = record.scene.as_deref().unwrap_or("null");
    Ok(format!("{{\"sketch\":{sketch},\"candidates\":{}}}", serde_json::to_string(&candidates)?))
}

/// Returns the JSON of a candidate; numbers that are not finite are null.
fn candidate(record: &CandidateRecord) -> Value {
    let CandidateRecord { candidate, taxonomy, pressure, offsets, .. } = record;
    let certificate = record.certificate.as_ref();
    let figures =
        record.figures.iter().map(|f| json!({"filter": f.filter, "value": f.value, "passed": f.passed}));
    json!({
        "number": candidate.number,
        "digest": candidate_digest(candidate),
        "source": candidate.source,
        "intent": candidate.intent.map(Deviation::name),
        "maneuver": candidate.maneuver,
        "category": taxonomy.category.name(),
        "heading_change": taxonomy.heading_change,
        "other_branch": taxonomy.other_branch,
        "lateral_offset": taxonomy.lateral_offset,
        "longitudinal_offset": taxonomy.longitudinal_offset,
        "conflict_step": taxonomy.conflict_step,
        "difficulty": record.difficulty().map(Difficulty::name),
        "required_deceleration": certificate.and_then(Certificate::required_deceleration),
        "time_to_react": certificate.and_then(Certificate::time_to_react),
        "needs_swerve": certificate.map(Certificate::needs_swerve),
        "figures": figures.collect::<Vec<_>>(),
        "rejected_by": record.rejected_by,
        "reason": record.reason,
        "score": record.score,
        "chosen": record.chosen,
        "at_fault": pressure.at_fault,
        "overlaps": pressure.overlaps,
        "risky": pressure.risky,
        "ade": offsets.ade,
        "speed_difference": offsets.mean_speed_difference,
        "track": track(&candidate.track),
        "certificate": certificate.map(|c| c.responses.iter().map(response).collect::<Vec<_>>()),
    })
}

fn response(response: &Response) -> Value {
    json!({
        "agent": response.agent,
        "reaction_step": response.reaction_step,
        "nudge": response.nudge,
        "peak_deceleration": response.peak_deceleration,
        "clearance": response.clearance,
        "track": track(&response.track),
    })
}

/// Encodes states from step 0 on ([`spans`]).
fn track(states: &[AgentState]) -> Vec<Vec<i64>> {
    let frames: Vec<Frame> = states.iter().copied().map(Some).collect();
    spans(&frames, 0)
}
