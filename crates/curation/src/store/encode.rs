//! Encodes records into columns.

use reactsim_formats::{
    certificates::{self, STATE_VALUES},
    table::{TableWriter, Value},
};

use super::columns::STATE;
use crate::{CandidateRecord, Figure, ScenarioRecord};

/// Adds the cells of one candidate. Only the first row of a scenario holds its scene.
pub(super) fn candidate(t: &mut TableWriter, of: &ScenarioRecord, record: &CandidateRecord, first: bool) {
    let CandidateRecord { candidate, taxonomy, pressure, offsets, review, .. } = record;
    t.column("scenario_id").push(Value::Text(&of.scenario_id));
    t.column("scenario_digest").push(Value::Text(&of.scenario_digest));
    t.column("origin_x").push(Value::Number(of.origin.x));
    t.column("origin_y").push(Value::Number(of.origin.y));
    t.column("source").push(Value::Text(&candidate.source));
    t.column("candidate").push(Value::Whole(candidate.number));
    t.column("seed").push(Value::Text(&record.seed.to_string()));
    t.column("maneuver").push(Value::Text(&candidate.maneuver));
    t.column("intent").push(Value::from(candidate.intent.map(|d| d.name())));
    t.column("category").push(Value::Text(taxonomy.category.name()));
    t.column("cue_heading_change").push(Value::Number(taxonomy.heading_change));
    t.column("cue_other_branch").push(Value::Flag(taxonomy.other_branch));
    t.column("cue_lateral_offset").push(Value::Number(taxonomy.lateral_offset));
    t.column("cue_longitudinal_offset").push(Value::Number(taxonomy.longitudinal_offset));
    t.column("cue_conflict_step").push(taxonomy.conflict_step.map_or(Value::Null, Value::Whole));
    for (name, value) in STATE.into_iter().zip(STATE_VALUES) {
        t.column(name).list(candidate.track.iter().map(|s| Value::Number(value(s))));
    }
    figures(t, &record.figures);
    t.column("rejected_by").push(Value::from(record.rejected_by.as_deref()));
    t.column("reason").push(Value::Text(&record.reason));
    t.column("score").push(Value::from(Some(record.score).filter(|s| !s.is_nan())));
    t.column("chosen").push(Value::Flag(record.chosen));
    t.column("pressure_at_fault").push(Value::Whole(pressure.at_fault));
    t.column("pressure_overlaps").push(Value::Whole(pressure.overlaps));
    t.column("pressure_risky").push(Value::Whole(pressure.risky));
    t.column("endpoint_longitudinal").push(Value::Number(offsets.endpoint_longitudinal));
    t.column("endpoint_lateral").push(Value::Number(offsets.endpoint_lateral));
    t.column("ade").push(Value::Number(offsets.ade));
    t.column("mean_speed_difference").push(Value::Number(offsets.mean_speed_difference));
    t.column("reviewer").push(Value::from(review.as_ref().map(|r| r.reviewer.as_str())));
    t.column("reviewed_at").push(Value::from(review.as_ref().map(|r| r.at.as_str())));
    t.column("decision").push(Value::from(review.as_ref().map(|r| r.decision.name())));
    certificates::encode(t, record.certificate.as_ref());
    t.column("scene").push(Value::from(of.scene.as_deref().filter(|_| first)));
}

fn figures(t: &mut TableWriter, figures: &[Figure]) {
    t.column("filter").list(figures.iter().map(|f| Value::Text(&f.filter)));
    t.column("figure").list(figures.iter().map(|f| Value::from(f.value)));
    t.column("passed").list(figures.iter().map(|f| f.passed.map_or(Value::Null, Value::Flag)));
}
