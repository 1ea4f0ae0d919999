//! Filters of pressure on the agents, and of its avoidability.

use crate::filter::{CandidateFilter, Verdict};

/// Requires pressure on at least one vehicle under log replay.
pub(super) const PRESSING: CandidateFilter = CandidateFilter {
    id: "pressure",
    rule: |settings| {
        format!(
            "under log replay a vehicle touches the AV or comes within {} s of it (time to collision)",
            settings.pressing_ttc
        )
    },
    judge: |trial| {
        let ttc = trial.smallest_ttc();
        Verdict::new(ttc, ttc.is_some_and(|t| t < trial.settings.pressing_ttc), || {
            "nobody has to react".to_owned()
        })
    },
};

/// Requires a certificate: every agent in conflict can avoid it.
pub(super) const AVOIDABLE: CandidateFilter = CandidateFilter {
    id: "avoidable",
    rule: |settings| {
        let a = &settings.avoidance;
        format!(
            "every agent in conflict has a response along its own path: \
             reaction after {} s, at most {} m/s² of braking, else a nudge of at most {} m",
            a.reaction, a.max_deceleration, a.max_nudge
        )
    },
    judge: |trial| match trial.certificate() {
        Ok(certificate) => Verdict { figure: Some(certificate.peak_deceleration()), rejected: None },
        Err(error) => Verdict { figure: None, rejected: Some(error.to_string()) },
    },
};
