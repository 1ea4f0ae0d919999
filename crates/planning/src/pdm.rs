//! PDM-Closed, the planner of tuplan_garage (commit b51d5d0): proposals of an intelligent driver model
//! along the centre line of the route, simulated and scored by the metrics of nuPlan (Dauner et al. 2023,
//! "Parting with Misconceptions about Learning-based Vehicle Motion Planning").
//!
//! Start with [`PdmClosed`]. A plan is computed in the order of the files: `route` and `centerline`
//! (first iteration only), `forecast`, `proposals`, `simulation`, `scoring`, `brake`.

mod areas;
mod brake;
mod centerline;
mod forecast;
mod proposals;
mod route;
mod scoring;
mod simulation;

#[cfg(test)]
mod tests;

pub use proposals::{Leader, Proposal};
pub(crate) use route::without_gaps;
pub use scoring::Scores;

use std::collections::BTreeSet;

use areas::DrivableLanes;
use forecast::{Forecast, ObstacleId};
use proposals::Proposals;
use scoring::Scorer;

use crate::metrics::SmoothedComfort;
use crate::path::Path;
use crate::planner::{Planner, PlannerInput, no_lanes, no_path, not_started};
use crate::trajectory::{Pose, STEP, Trajectory};
use crate::{EgoState, PlanningError};

/// Offsets of the paths to the left of the centre line, metres (tuplan_garage b51d5d0,
/// `lateral_offsets`). The centre line itself is the first path.
const LATERAL_OFFSETS: [f64; 2] = [-1.0, 1.0];

/// The planner.
#[derive(Debug)]
pub struct PdmClosed {
    comfort: SmoothedComfort,
    plan: Option<RoutePlan>,
    ignored: BTreeSet<ObstacleId>,
    cycle: Option<Cycle>,
}

/// The route and its paths, found at the first iteration and kept.
#[derive(Debug)]
struct RoutePlan {
    /// Roadblocks in driving order.
    route: Vec<usize>,
    /// Lanes of the route, in its order.
    lanes: Vec<usize>,
    on_route: BTreeSet<usize>,
    /// Centre line, and its parallels.
    paths: Vec<Path>,
}

/// Intermediate results of one plan.
#[derive(Clone, Debug)]
pub struct Cycle {
    /// Proposals: five speeds on the centre line, then on the right and on the left parallel.
    pub proposals: Vec<Proposal>,
    /// States of ego if it tracks each proposal for 4 s, the present one first.
    pub simulated: Vec<Vec<EgoState>>,
    /// Scores.
    pub scores: Scores,
    /// Index of the best proposal.
    pub best: usize,
    /// Whether the trajectory comes from the emergency brake.
    pub is_emergency_brake: bool,
}

impl Default for PdmClosed {
    fn default() -> Self {
        Self::new()
    }
}

impl PdmClosed {
    /// Creates a planner for one scenario.
    pub fn new() -> Self {
        Self {
            comfort: SmoothedComfort::new(proposals::STEPS + 1),
            plan: None,
            ignored: BTreeSet::new(),
            cycle: None,
        }
    }

    /// Returns the intermediate results of the last plan.
    pub fn cycle(&self) -> Option<&Cycle> {
        self.cycle.as_ref()
    }

    /// Returns the corrected route: roadblocks in driving order, empty before the first plan.
    pub fn route(&self) -> &[usize] {
        self.plan.as_ref().map_or(&[], |plan| &plan.route)
    }

    /// Returns the centre line; `None` before the first plan.
    pub fn centerline(&self) -> Option<&Path> {
        Some(&self.plan.as_ref()?.paths[0])
    }

    /// Plans with the paths of `plan`.
    fn cycle_of(
        &mut self,
        input: &PlannerInput<'_>,
        plan: &RoutePlan,
    ) -> Result<(Cycle, Trajectory), PlanningError> {
        let (ego, shape, map) = (input.ego(), input.shape, input.map);
        let forecast = Forecast::observe(input, &plan.on_route, &mut self.ignored);
        let lane = centerline::current_lane(input, &plan.lanes, &plan.on_route)
            .ok_or_else(|| no_lanes(plan.route.len()))?;
        let targets = proposals::target_speeds(map.lane(lane).speed_limit);
        let mut proposals = Proposals::unroll(ego, shape, &plan.paths, targets, &forecast);
        let simulated: Vec<Vec<EgoState>> =
            proposals.list.iter().map(|proposal| simulation::simulate(ego, shape, proposal)).collect();
        let lanes = DrivableLanes::near(map, ego.center(shape), &plan.on_route);
        let scorer = Scorer {
            shape,
            map,
            lanes: &lanes,
            forecast: &forecast,
            centerline: &plan.paths[0],
            comfort: &self.comfort,
        };
        let scores = scorer.score(&simulated);
        let best = scores.best();
        let is_emergency_brake = brake::is_necessary(ego, scores.collision_time[best]);
        let states = if is_emergency_brake {
            brake::states(ego, shape)
        } else {
            states_of(ego, proposals.extend(best))
        };
        let trajectory = Trajectory::new(states, ego)?;
        Ok((Cycle { proposals: proposals.list, simulated, scores, best, is_emergency_brake }, trajectory))
    }
}

impl Planner for PdmClosed {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let plan = match self.plan.take() {
            Some(plan) => plan,
            None if input.iteration == 0 => RoutePlan::find(input)?,
            None => return Err(not_started(input)),
        };
        let result = self.cycle_of(input, &plan);
        self.plan = Some(plan);
        let (cycle, trajectory) = result?;
        self.cycle = Some(cycle);
        Ok(trajectory)
    }
}

/// Returns the centre line along the route of ego, as [`PdmClosed`] finds it at its first plan.
///
/// # Errors
/// [`PlanningError`] if no lane of the route is near ego, or the lanes have no length.
pub fn centerline(input: &PlannerInput<'_>) -> Result<Path, PlanningError> {
    Ok(RoutePlan::find(input)?.paths.swap_remove(0))
}

impl RoutePlan {
    /// Corrects the route and finds the centre line.
    fn find(input: &PlannerInput<'_>) -> Result<Self, PlanningError> {
        let (map, ego) = (input.map, input.ego());
        let nowhere = || {
            let (x, y) = (ego.x, ego.y);
            PlanningError(format!("no roadblock is near ego at ({x:.1}, {y:.1}); check the frame of the map"))
        };
        let route = route::corrected(map, Pose::from(ego), input.route.roadblocks()).ok_or_else(nowhere)?;
        let lanes: Vec<usize> =
            route.iter().flat_map(|&block| map.lanes_of_roadblock(block)).copied().collect();
        let on_route = lanes.iter().copied().collect();
        let start =
            centerline::current_lane(input, &lanes, &on_route).ok_or_else(|| no_lanes(route.len()))?;
        let states = centerline::centerline_states(map, start, &route, &on_route);
        let paths = parallels(states).ok_or_else(|| no_path(map, start))?;
        Ok(Self { route, lanes, on_route, paths })
    }
}

/// Returns the path through `states` and its parallels; `None` if one has no length.
fn parallels(states: Vec<Pose>) -> Option<Vec<Path>> {
    let centerline = Path::new(states)?;
    let parallels = LATERAL_OFFSETS.map(|offset| centerline.aside(offset));
    [Some(centerline)].into_iter().chain(parallels).collect()
}

/// Returns poses at rest, at intervals of [`STEP`] from the present on.
fn states_of(ego: &EgoState, poses: &[Pose]) -> Vec<EgoState> {
    let state = |(step, pose): (usize, &Pose)| EgoState {
        time: ego.time + STEP * step as f64,
        ..EgoState::standing(pose.position, pose.heading)
    };
    poses.iter().enumerate().map(state).collect()
}
