//! Filters of driving against the lane and of running red lights.

use reactsim_scene::DT;

use crate::filter::{CandidateFilter, Verdict};

/// Requires driving in the direction of the lane, as the benchmark judges agents (metric `direction`).
pub(super) const WRONG_WAY: CandidateFilter = CandidateFilter {
    id: "wrong-way",
    rule: |_| "the AV does not drive against its lane by the rule that agents are judged by".to_owned(),
    judge: |trial| {
        let wrong = !trial.own.agent_scores(0).direction.intervals.is_empty();
        Verdict::new(Some(f64::from(u8::from(wrong))), !wrong, || "drives against its lane".to_owned())
    },
};

/// Requires that the AV runs no red light, unless the logged AV runs it too.
pub(super) const RED_LIGHT: CandidateFilter = CandidateFilter {
    id: "red-light",
    rule: |_| "the AV crosses no stopping point on red, but where the logged AV does".to_owned(),
    judge: |trial| {
        let step = trial.context.signals.red_light_step(&trial.candidate.track[0], trial.candidate.future());
        let time = step.map(|s| s as f64 * DT);
        Verdict::new(time, time.is_none(), || {
            format!("runs a red light after {:.1} s", time.unwrap_or_default())
        })
    },
};
