//! PDMS and EPDMS of the AV: the drives to which NAVSIM compares a planner, and the two scores.

use std::sync::Arc;

use reactsim_models::log_replay::LogReplay;
use reactsim_planning::av::{PlannerAv, PlannerChoice};
use reactsim_planning::from_scene::SceneHistory;
use reactsim_planning::metrics::{
    HistoryError, NavsimMetric, NavsimScore, NavsimScores, NavsimVersion, PlannerScores, UndefinedReason,
};
use reactsim_planning::tracking::Controller;
use reactsim_rollout::{self as rollout, Replan, Request, Settings, roll_out};
use reactsim_scene::{Frame, Scenario};

/// The id of a score, and its value or the reason why it is undefined.
pub(super) type NamedScore = (&'static str, Result<f64, UndefinedReason>);

/// The drives of other drivers in one scenario, among recorded traffic.
pub(super) struct ReferenceDrives {
    /// PDM-Closed; `None` if it cannot drive in the scenario.
    pdm_closed: Option<NavsimScores>,
    /// The recorded driver; `None` if its recording has gaps.
    human: Option<NavsimScores>,
}

impl ReferenceDrives {
    /// Drives PDM-Closed through the scenario, which plans at every step, and judges both drives.
    pub(super) fn of(scenario: &Scenario) -> Self {
        let judged = |tracks: &[Vec<Frame>]| -> Option<NavsimScores> {
            let history = SceneHistory::of_rollout(scenario, tracks).ok()?;
            history.judge_navsim(scenario, &history.judge().ok()?).ok()
        };
        let logged: Vec<Vec<Frame>> =
            (0..scenario.start.agents.len()).map(|agent| scenario.logged(agent)).collect();
        Self { pdm_closed: pdm_closed(scenario).and_then(|tracks| judged(&tracks)), human: judged(&logged) }
    }

    /// Judges the AV of a rollout. `history`: its history. `scores`: its metrics of nuPlan.
    ///
    /// # Errors
    /// [`HistoryError`] if the history cannot be judged.
    pub(super) fn judge(
        &self,
        scenario: &Scenario,
        history: &SceneHistory,
        scores: &PlannerScores,
    ) -> Result<[NamedScore; 2], HistoryError> {
        let drive = history.judge_navsim(scenario, scores)?;
        let reference = |version| self.pdm_closed.as_ref().and_then(|pdm| pdm.masked_progress(version));
        let pdms = complete(&drive.pdms(reference(NavsimVersion::V1)));
        let epdms = match &self.human {
            Some(human) => complete(&drive.epdms(reference(NavsimVersion::V2), Some(human))),
            // Without the recorded driver it is unknown which metrics count as 1.
            None => Err(UndefinedReason::IncompleteExpert),
        };
        Ok([("av-pdms", pdms), ("av-epdms", epdms)])
    }
}

/// Returns a score if all of its metrics are defined but extended comfort, which NAVSIM leaves out of the
/// scores of single plans, too.
fn complete(score: &NavsimScore) -> Result<f64, UndefinedReason> {
    let mut missing = score.undefined().filter(|(metric, _)| *metric != NavsimMetric::ExtendedComfort);
    missing.next().map_or(Ok(score.value), |(_, reason)| Err(reason))
}

/// Drives PDM-Closed through a scenario; it plans at every step. Returns the tracks; `None` if it cannot
/// drive.
fn pdm_closed(scenario: &Scenario) -> Option<Vec<Vec<Frame>>> {
    let controller = Controller::LqrBicycle;
    let av = PlannerAv::new(scenario, PlannerChoice::PdmClosed, controller, Replan::EVERY_STEP).ok()?;
    let request = Request { scenario, av: Some(Arc::new(av)), rollout: 0 };
    let traffic = rollout::Controller::Oracle(Box::new(LogReplay));
    Some(roll_out(vec![request], &traffic, &Settings::default()).pop()?.ok()?.tracks)
}
