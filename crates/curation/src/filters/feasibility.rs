//! Filters of the distance from the log, the drivable area and the kinematic limits.

use reactsim_scene::dynamics::{MAX_ACCELERATION, MAX_CURVATURE};

use crate::filter::{CandidateFilter, Verdict};
use crate::ground::lateral_acceleration;

/// Requires a minimum distance from the log.
pub(super) const LOG_DISTANCE: CandidateFilter = CandidateFilter {
    id: "log-distance",
    rule: |settings| format!("the ADE to the log is at least {} m", settings.min_ade),
    judge: |trial| {
        let ade = trial.offsets().ade;
        Verdict::new(Some(ade), ade >= trial.settings.min_ade, || {
            format!("only {ade:.2} m from the log on average")
        })
    },
};

/// Requires that the AV stays on the drivable area.
pub(super) const DRIVABLE_AREA: CandidateFilter = CandidateFilter {
    id: "drivable-area",
    rule: |settings| {
        format!(
            "no corner leaves the drivable ground by more than {} m, and the centre does not leave it",
            settings.drivable_tolerance
        )
    },
    judge: |trial| {
        let depth = trial.context.ground.depth(trial.candidate.future(), f64::INFINITY);
        let off = trial.own.agent_scores(0).off_road.hits > 0;
        let passes = depth.is_none_or(|d| d <= trial.settings.drivable_tolerance) && !off;
        Verdict::new(depth, passes, || match depth {
            Some(d) if d > trial.settings.drivable_tolerance => format!("a corner is {d:.2} m off the road"),
            _ => "the centre is off the road".to_owned(),
        })
    },
};

/// Requires the bounds of acceleration and curvature that agents are judged by, at every transition.
pub(super) const KINEMATICS: CandidateFilter = CandidateFilter {
    id: "kinematics",
    rule: |_| format!("no transition beyond {MAX_ACCELERATION} m/s² or {MAX_CURVATURE} 1/m"),
    judge: |trial| {
        let found = trial.own.agent_scores(0).infeasible;
        let hits = found.acceleration.hits + found.curvature.hits;
        Verdict::new(Some(hits as f64), hits == 0, || {
            let (a, c) = (found.acceleration.hits, found.curvature.hits);
            format!("{a} infeasible accelerations, {c} infeasible curvatures")
        })
    },
};

/// Requires a lateral acceleration that a driver would accept.
pub(super) const LATERAL_ACCELERATION: CandidateFilter = CandidateFilter {
    id: "lateral-acceleration",
    rule: |settings| {
        format!("the lateral acceleration is at most {} m/s²", settings.max_lateral_acceleration)
    },
    judge: |trial| {
        let largest = lateral_acceleration(&trial.candidate.track[0], trial.candidate.future());
        let passes = largest <= trial.settings.max_lateral_acceleration;
        Verdict::new(Some(largest), passes, || format!("lateral acceleration of {largest:.1} m/s²"))
    },
};
