//! Filters of pressure on the agents, and of its avoidability.

use crate::filter::{CandidateFilter, FilterSettings, Trial, Verdict};

/// Requires pressure on at least one vehicle under log replay.
pub(super) struct Pressing;

impl CandidateFilter for Pressing {
    fn id(&self) -> &'static str {
        "pressure"
    }

    fn rule(&self, settings: &FilterSettings) -> String {
        format!(
            "under log replay a vehicle touches the AV or comes within {} s of it (time to collision)",
            settings.pressing_ttc
        )
    }

    fn judge(&self, trial: &Trial<'_>) -> Verdict {
        let ttc = trial.smallest_ttc();
        Verdict::new(ttc, ttc.is_some_and(|t| t < trial.settings.pressing_ttc), || {
            "nobody has to react".to_owned()
        })
    }
}

/// Requires a certificate: every agent in conflict can avoid it.
pub(super) struct Avoidable;

impl CandidateFilter for Avoidable {
    fn id(&self) -> &'static str {
        "avoidable"
    }

    fn rule(&self, settings: &FilterSettings) -> String {
        let a = &settings.avoidance;
        format!(
            "every agent in conflict has a response along its own path: \
             reaction after {} s, at most {} m/s² of braking, else a nudge of at most {} m",
            a.reaction, a.max_deceleration, a.max_nudge
        )
    }

    fn judge(&self, trial: &Trial<'_>) -> Verdict {
        match trial.certificate() {
            Ok(certificate) => Verdict { figure: Some(certificate.peak_deceleration()), rejected: None },
            Err(error) => Verdict { figure: None, rejected: Some(error.to_string()) },
        }
    }

    fn is_expensive(&self) -> bool {
        true
    }
}
