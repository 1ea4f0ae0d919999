//! Plans from outside of this program, which are checked before their motion is judged.

use std::collections::BTreeMap;
use std::sync::Arc;

use parking_lot::Mutex;
use reactsim_planning::planner::{Planner, PlannerInput};
use reactsim_planning::tracking::Controller;
use reactsim_planning::{EgoState, PlanningError, Trajectory};
use reactsim_scene::{AgentState, DT, Frame};

/// Number of poses of a plan that are checked.
const POSES: u32 = 20;
/// Largest difference between times that are the same, seconds.
const SAME_TIME: f64 = 1e-6;

/// The AV when a plan is made, and its box after 0.1, 0.2, … s in the plan.
type GivenPlan = (AgentState, Vec<Frame>);

/// The plans of one scenario, by index of the rollout. Motion under perfect tracking is that of the plans, so
/// that only plans that a tracker follows are kept.
#[derive(Default)]
pub(in super::super) struct GivenPlans(Mutex<BTreeMap<u32, Vec<GivenPlan>>>);

impl GivenPlans {
    /// Returns a planner whose plans in a rollout are kept.
    pub(super) fn keep(
        self: &Arc<Self>,
        planner: Box<dyn Planner>,
        controller: Controller,
        rollout: u32,
    ) -> Box<dyn Planner> {
        if controller == Controller::PerfectTracking {
            return planner;
        }
        self.0.lock().insert(rollout, Vec::new());
        Box::new(Kept { planner, given: Arc::clone(self), rollout })
    }

    /// Takes the plans of a rollout.
    pub(in super::super) fn take(&self, rollout: u32) -> Vec<GivenPlan> {
        self.0.lock().remove(&rollout).unwrap_or_default()
    }
}

/// A planner whose plans are kept.
struct Kept {
    planner: Box<dyn Planner>,
    given: Arc<GivenPlans>,
    rollout: u32,
}

impl Planner for Kept {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let trajectory = self.planner.plan(input)?;
        if let Some(now) = input.seen.and_then(|seen| seen.state(0)) {
            let plan = (now, boxes(&trajectory, input));
            self.given.0.lock().entry(self.rollout).or_default().push(plan);
        }
        Ok(trajectory)
    }
}

/// Returns the first boxes of a plan.
fn boxes(trajectory: &Trajectory, input: &PlannerInput<'_>) -> Vec<Frame> {
    let state = |time: f64| -> EgoState {
        // Interpolation wraps headings, which may be degrees.
        let planned = trajectory.states().iter().find(|state| (state.time - time).abs() < SAME_TIME);
        planned.copied().unwrap_or_else(|| trajectory.at(time))
    };
    let times = (1..=POSES).map(|k| input.ego().time + DT * f64::from(k));
    let covered = times.take_while(|time| *time <= trajectory.end() + SAME_TIME);
    covered
        .map(|time| {
            let (ego, velocity) = (state(time), f64::NAN);
            let center = ego.center(input.shape);
            Some(AgentState { x: center.x, y: center.y, heading: ego.heading, vx: velocity, vy: velocity })
        })
        .collect()
}
