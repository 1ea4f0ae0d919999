//! The diffusion planner that ships, along the lanes of the route.

use std::sync::Arc;

use reactsim_geometry::math;
use reactsim_planning::planner::{Planner, PlannerInput};
use reactsim_planning::{Path, PlanningError, Trajectory, TrajectoryError, pdm};
use reactsim_rollout::{Observation, Stream};
use reactsim_scene::AgentState;

/// Standard deviation of the initial noise (published).
pub(super) const TEMPERATURE: f64 = 0.5;

/// Samples a plan of the AV: its states after 1, 2, … steps; `None` if the AV is absent.
pub(super) type Network = dyn Fn(&Observation<'_>, &mut Stream) -> Option<Vec<AgentState>> + Send + Sync;

/// The planner of one rollout. Plans of a small network stray from their lanes, so that only their speed is
/// used: the AV drives along the centre line of its route as far as the sampled plan does.
pub(super) struct AlongRoute {
    pub(super) network: Arc<Network>,
    pub(super) stream: Stream,
    /// Centre line of the route; `None` before the first plan.
    pub(super) path: Option<Path>,
}

impl Planner for AlongRoute {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let failed = |text: &str| PlanningError(text.to_owned());
        let seen = input.seen.ok_or_else(|| failed("it plans in rollouts only"))?;
        let path = match &mut self.path {
            Some(path) => path,
            none => none.insert(pdm::centerline(input)?),
        };
        let plan = (self.network)(&seen, &mut self.stream);
        let plan = plan.ok_or_else(|| failed("the network has no plan, as the AV is absent"))?;
        if !plan.iter().all(|state| state.is_finite()) {
            return Err(failed("the network planned states that are not finite"));
        }
        let (ego, center) = (input.ego(), input.ego().center(input.shape));
        let (mut last, mut s) = (center, path.project(center));
        let poses: Vec<[f64; 3]> = plan
            .iter()
            .map(|state| {
                s += math::hypot(state.x - last.x, state.y - last.y);
                last = state.position();
                let pose = path.at(s);
                [pose.position.x, pose.position.y, pose.heading]
            })
            .collect();
        // The plan of the network is not at fault.
        let beside = |error| match error {
            TrajectoryError::Teleport { index: 1, .. } => failed(&format!(
                "the AV is {:.1} m beside the centre line of its route, along which this planner drives; choose \
                 another planner, or check the lanes of the scenario",
                (path.at(path.project(center)).position - center).norm()
            )),
            error => error.into(),
        };
        Trajectory::through_centers(&poses, ego, input.shape).map_err(beside)
    }
}
