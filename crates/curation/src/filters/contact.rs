//! Filters of contacts that the AV itself causes, or that come too early for any response.

use reactsim_scene::{AgentKind, DT};

use crate::filter::{CandidateFilter, Verdict};

/// Requires that nothing is touched in the first moments.
pub(super) const EARLY_CONTACT: CandidateFilter = CandidateFilter {
    id: "early-contact",
    rule: |settings| format!("no contact within the first {} s", settings.earliest_contact),
    judge: |trial| {
        let first = trial.touches.iter().map(|t| t.step as f64 * DT).reduce(f64::min);
        // The tolerance covers the rounding of k * 0.1.
        let passes = first.is_none_or(|t| t > trial.settings.earliest_contact + 1e-9);
        Verdict::new(first, passes, || format!("contact after {:.1} s", first.unwrap_or_default()))
    },
};

/// Requires that the AV does not hit bodies at rest or slow ones, pedestrians, cyclists, or the rear of
/// a vehicle ahead.
pub(super) const ACTIVE_COLLISION: CandidateFilter = CandidateFilter {
    id: "active-collision",
    rule: |settings| {
        format!(
            "the AV touches no pedestrian, cyclist, obstacle, or vehicle that stands or crawls, \
             and its front drives into no vehicle that is slower than {} m/s and than the AV, \
             that goes ahead of it or comes towards it, or that the metrics would not blame",
            settings.slow
        )
    },
    judge: |trial| {
        let why = |touch: &crate::replay::Touch| match touch.kind {
            None => Some("drives into an obstacle".to_owned()),
            Some(AgentKind::Vehicle) if touch.is_standing() => Some("touches a standing vehicle".to_owned()),
            Some(AgentKind::Vehicle) if touch.is_crawling() => {
                Some(format!("touches a vehicle at {:.1} m/s", touch.speed))
            }
            Some(AgentKind::Vehicle) if touch.is_head_on() => {
                Some("drives head on into a vehicle".to_owned())
            }
            Some(AgentKind::Vehicle) if touch.is_rear_end() => Some("drives into a vehicle ahead".to_owned()),
            Some(AgentKind::Vehicle) if touch.is_driven_into(trial.settings.slow) => {
                Some(format!("drives into a vehicle at {:.1} m/s", touch.speed))
            }
            Some(AgentKind::Vehicle) => None,
            Some(kind) => Some(format!("touches a {kind}")),
        };
        let found = trial.touches.iter().find_map(|t| Some((t.step as f64 * DT, why(t)?)));
        match found {
            None => Verdict { figure: None, rejected: None },
            Some((time, why)) => {
                Verdict { figure: Some(time), rejected: Some(format!("{why} after {time:.1} s")) }
            }
        }
    },
};
