//! Planners that plan in another process.

use std::collections::BTreeSet;

use reactsim_external::PlannerEpisode;
use reactsim_planning::from_scene::planning_lanes;
use reactsim_planning::planner::{Planner, PlannerInput};
use reactsim_planning::{PlanningError, Trajectory};

/// The planner of one rollout, which plans in another process.
pub(super) struct RemotePlanner {
    episode: PlannerEpisode,
    /// Number of steps between two plans.
    steps: usize,
    /// Number of steps of the rollout.
    future: usize,
    /// Lanes of the route in the map of the scenario.
    route: Option<Vec<usize>>,
}

impl RemotePlanner {
    /// Creates the planner of a rollout of `future` steps, which plans every `steps` steps.
    pub(super) fn new(episode: PlannerEpisode, steps: usize, future: usize) -> Self {
        Self { episode, steps, future, route: None }
    }
}

impl Planner for RemotePlanner {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let seen = input.seen.ok_or_else(|| PlanningError("it plans in rollouts only".to_owned()))?;
        let route = self.route.get_or_insert_with(|| {
            let lanes = planning_lanes(&seen.start().map);
            let mut passed = BTreeSet::new();
            let route = input.route.lanes(input.map).into_iter().map(|lane| lanes[lane]);
            route.filter(|&lane| passed.insert(lane)).collect()
        });
        let steps = self.steps.min(self.future - seen.step());
        let ego = input.ego();
        let motion = [ego.vx, ego.vy, ego.ax, ego.ay, ego.steering, ego.yaw_rate, ego.yaw_acceleration];
        let planned = self.episode.plan(&seen, steps, route, motion).map_err(PlanningError)?;
        Ok(Trajectory::through_centers_from(planned.present, &planned.poses, ego, input.shape)?)
    }
}
