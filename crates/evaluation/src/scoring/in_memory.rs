//! Scores of rollouts in memory, as [`Scoring`](crate::scoring::Scoring) computes them for files.

use std::sync::{Arc, OnceLock};

use reactsim_formats::rollouts::RolloutRecord;
use reactsim_metrics::{Event, Metrics, Options};
use reactsim_planning::PlanningMap;
use reactsim_rollout::{Entering, Rollout};
use reactsim_scene::Scenario;

use crate::deviation::labels::DeviationLabels;
use crate::deviation::pose::Pose;
use crate::error::EvaluationError;
use crate::judge::judge;
use crate::motion::kind::RolloutCheck;
use crate::row::{RecordPosition, Row};
use crate::scoring::recorded_rollouts::{RecordedRollouts, ScoredPair};

/// Scores rollouts of one scenario and one simulator. Returns one row per rollout and a last one over all
/// rollouts, and the events of each rollout. `digest`: digest of the scenario; `pose`: the point of vehicles
/// whose poses the rollouts have. Checks that need not be met are `allowed`; rows of rollouts that fail them
/// are marked.
///
/// # Errors
/// [`EvaluationError`] if there are no rollouts, they do not match the scenario, or one fails a check that is
/// not allowed.
pub fn score_in_memory(
    scenario: &Scenario,
    digest: &str,
    rollouts: Vec<RolloutRecord>,
    options: Options,
    pose: Pose,
    allowed: &[RolloutCheck],
) -> Result<(Vec<Row>, Vec<Vec<Event>>), EvaluationError> {
    let mut recorded = RecordedRollouts::new(rollouts, options, pose, Entering::Off);
    let place = RecordPosition { input: 0, record: 0 };
    let scored = recorded.score(place, scenario, || digest.to_owned()).pop();
    let unfit = |error: String| EvaluationError::Refused(format!("scenario `{}`: {error}", scenario.id));
    let scored = scored.ok_or_else(|| unfit("no rollout is given".to_owned()))?;
    let ScoredPair { rows, events, .. } = scored.map_err(|(_, error)| unfit(error))?;
    recorded.findings().check(allowed)?;
    Ok((rows, events))
}

/// Judges one rollout of the reactive protocol. Returns the row of the rollout and the row over all rollouts,
/// without the digest of the scenario, and the events. `deviation`: how the AV deviates from the log, if
/// known; `av_map`: planning map of the scenario, if the AV is judged, too, as in a run in which a planner
/// drives it.
pub fn judge_in_memory(
    scenario: &Scenario,
    simulator: &str,
    rollout: Rollout,
    deviation: &DeviationLabels,
    options: Options,
    av_map: Option<Arc<PlanningMap>>,
) -> (Vec<Row>, Vec<Vec<Event>>) {
    let place = RecordPosition { input: 0, record: 0 };
    let template = Row::about(place, scenario, String::new(), simulator).with_deviation(deviation);
    let (rollouts, certificate) = ([rollout], deviation.certificate.as_ref());
    let how = (&Metrics::default(), options);
    let av_map = av_map.map(OnceLock::from);
    judge(scenario, certificate, &rollouts, how, av_map.as_ref()).rows(template, &rollouts)
}
