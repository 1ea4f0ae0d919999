//! The scores of NAVSIM for rollouts.

use reactsim_scene::{CURRENT, Scenario};

use crate::metrics::{HistoryError, NavsimInput, NavsimScores, PlannerScores, judge_navsim};
use crate::pdm;
use crate::planner::{self, PlannerInput, Route, Sample};
use crate::{EgoState, Path};

use super::{AV, LightLanes, SceneHistory, ego_states_until_now, logged_route};

impl SceneHistory {
    /// Computes the sub-metrics of NAVSIM. `scenario`: the scenario of the rollout, whose lights follow the
    /// recording. `scores`: result of [`Self::judge`].
    ///
    /// The route is that of planners ([`logged_route`]), the centre line that of PDM-Closed. If the scenario
    /// has no lights, the metric of traffic lights is undefined: either there are none, or they are not
    /// recorded.
    ///
    /// # Errors
    /// As [`Self::judge`].
    pub fn judge_navsim(
        &self,
        scenario: &Scenario,
        scores: &PlannerScores,
    ) -> Result<NavsimScores, HistoryError> {
        let route = logged_route(scenario, &self.map, &self.shape);
        let lights = (!scenario.start.lights.is_empty())
            .then(|| LightLanes::new(&scenario.start).recorded(scenario, CURRENT..CURRENT + self.ego.len()));
        let mut past: Vec<EgoState> = ego_states_until_now(&scenario.logged(AV), &self.shape);
        past.pop();
        judge_navsim(&NavsimInput {
            history: &self.history(),
            scores,
            centerline: route.as_ref().and_then(|route| self.centerline(route)).as_ref(),
            route: route.as_ref(),
            lights: lights.as_deref(),
            past: &past,
        })
    }

    /// Returns the centre line of a route from the first state of ego; `None` if the route has none.
    fn centerline(&self, route: &Route) -> Option<Path> {
        let samples = [Sample { ego: *self.ego.first()?, objects: Vec::new() }];
        let input = PlannerInput {
            iteration: 0,
            history: planner::History::new(&samples)?,
            lights: &[],
            route,
            map: &self.map,
            shape: &self.shape,
            seen: None,
        };
        pdm::centerline(&input).ok()
    }
}
