//! Closed-loop stepping of a planner in traffic, as nuPlan steps (devkit 1.2.2, `Simulation`).
//!
//! Start with [`Episode::run`]. At each iteration the planner observes ego and its surroundings and
//! returns a trajectory; the controller moves ego along it for one step, and the traffic advances at the
//! same time, from the state of ego before the step. The data is plain: recorded futures are known to the
//! [`Traffic`] at most.

use reactsim_rollout::Observation;

use crate::planner::{History, Light, Planner, PlannerInput, Route, Sample};
use crate::tracking::Controller;
use crate::trajectory::{STEP, Trajectory, validate};
use crate::{EgoShape, EgoState, PlanningError, PlanningMap, TrackedObject};

/// Objects and traffic lights around ego at one iteration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Objects, without ego.
    pub objects: Vec<TrackedObject>,
    /// Traffic lights.
    pub lights: Vec<Light>,
}

/// The traffic around ego.
pub trait Traffic: Send {
    /// Returns the surroundings at `iteration`, at least 1. `ego` is the state of ego at the iteration
    /// before: ego and traffic move at the same time.
    ///
    /// Iterations are consecutive.
    ///
    /// # Errors
    /// [`PlanningError`] if there are no surroundings at this iteration. The episode is then over.
    fn advance(&mut self, iteration: usize, ego: &EgoState) -> Result<Surroundings, PlanningError>;
}

/// Recorded traffic, which does not react to ego.
#[derive(Clone, Debug)]
pub struct Replay {
    samples: Vec<Surroundings>,
}

impl Replay {
    /// Creates traffic from recorded surroundings, the first of iteration 0.
    pub fn new(samples: Vec<Surroundings>) -> Self {
        Self { samples }
    }
}

impl Traffic for Replay {
    fn advance(&mut self, iteration: usize, _: &EgoState) -> Result<Surroundings, PlanningError> {
        let ended = || {
            let samples = self.samples.len();
            PlanningError(format!(
                "recording has {samples} samples and none of iteration {iteration}; simulate fewer steps"
            ))
        };
        self.samples.get(iteration).cloned().ok_or_else(ended)
    }
}

/// The conditions of an episode.
#[derive(Clone, Copy, Debug)]
pub struct Episode<'a> {
    /// Map.
    pub map: &'a PlanningMap,
    /// Route of ego.
    pub route: &'a Route,
    /// Box and axles of ego.
    pub shape: &'a EgoShape,
    /// Controller of ego.
    pub controller: Controller,
    /// Number of steps.
    pub steps: usize,
    /// Number of steps between plans, at least 1: trajectories are kept in between.
    pub replan_interval: usize,
}

/// The recorded past and present with which an episode begins.
#[derive(Clone, Debug)]
pub struct EpisodeStart {
    /// Samples up to the present at intervals of [`STEP`], oldest first. Planners observe the last two
    /// seconds.
    ///
    /// nuPlan begins with the position, heading, velocity and acceleration of the log; the steering
    /// angle, yaw rate and yaw acceleration of the present state are 0 even in a bend (devkit 1.2.2).
    pub history: Vec<Sample>,
    /// Traffic lights at present.
    pub lights: Vec<Light>,
}

/// The present of an iteration.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Now<'a> {
    pub(crate) iteration: usize,
    /// Samples up to the present one.
    pub(crate) samples: &'a [Sample],
    pub(crate) lights: &'a [Light],
    pub(crate) seen: Option<Observation<'a>>,
}

/// A finished episode.
#[derive(Clone, Debug)]
pub struct Drive {
    /// Samples of iterations 0 to the number of steps. nuPlan does not record the last one (devkit 1.2.2).
    pub samples: Vec<Sample>,
    /// Trajectory that was followed at each step; one less than samples.
    pub trajectories: Vec<Trajectory>,
}

impl Episode<'_> {
    /// Runs a planner, which must be new, from `start`.
    ///
    /// # Errors
    /// [`PlanningError`] if the planner, the controller or the traffic fails.
    pub fn run(
        &self,
        start: EpisodeStart,
        planner: &mut dyn Planner,
        traffic: &mut dyn Traffic,
    ) -> Result<Drive, PlanningError> {
        if self.replan_interval == 0 {
            return Err(PlanningError("replan interval is 0 steps; it must be at least 1".to_owned()));
        }
        let EpisodeStart { history: mut samples, mut lights } = start;
        let first = samples.len().checked_sub(1).ok_or_else(no_history)?;
        let start_time = samples[first].ego.time;
        let mut trajectories: Vec<Trajectory> = Vec::with_capacity(self.steps);
        for iteration in 0..self.steps {
            let (now, before) =
                (Now { iteration, samples: &samples, lights: &lights, seen: None }, trajectories.last());
            let at = |error| PlanningError(format!("iteration {iteration}: {error}"));
            let trajectory = self.trajectory(&now, planner, before).map_err(at)?;
            let ego = samples[first + iteration].ego;
            let next = self.next_ego(iteration, start_time, &ego, &trajectory).map_err(at)?;
            let surroundings = traffic.advance(iteration + 1, &ego).map_err(at)?;
            samples.push(Sample { ego: next, objects: surroundings.objects });
            lights = surroundings.lights;
            trajectories.push(trajectory);
        }
        samples.drain(..first);
        Ok(Drive { samples, trajectories })
    }

    /// Returns the state of ego at the iteration after this one. `start_time`: time of iteration 0, seconds.
    pub(crate) fn next_ego(
        &self,
        iteration: usize,
        start_time: f64,
        ego: &EgoState,
        trajectory: &Trajectory,
    ) -> Result<EgoState, PlanningError> {
        let next = self.controller.advance(ego, self.shape, trajectory)?;
        Ok(EgoState { time: start_time + STEP * (iteration + 1) as f64, ..next })
    }

    /// Returns the trajectory of an iteration: a new plan, or the one before.
    pub(crate) fn trajectory(
        &self,
        now: &Now<'_>,
        planner: &mut dyn Planner,
        before: Option<&Trajectory>,
    ) -> Result<Trajectory, PlanningError> {
        let Now { iteration, samples, lights, seen } = *now;
        let history = History::new(samples).ok_or_else(no_history)?;
        let kept = before.filter(|_| !iteration.is_multiple_of(self.replan_interval));
        let trajectory = match kept {
            Some(trajectory) => trajectory.clone(),
            None => {
                let (map, route, shape) = (self.map, self.route, self.shape);
                let input = PlannerInput { iteration, history, lights, route, map, shape, seen };
                planner.plan(&input)?
            }
        };
        validate(trajectory.states(), &history.present().ego).map_err(|e| PlanningError(e.to_string()))?;
        Ok(trajectory)
    }
}

pub(crate) fn no_history() -> PlanningError {
    PlanningError("history has no samples; an episode begins with the present sample".to_owned())
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;
    use crate::fixtures::{car, straight_road};

    /// A planner that drives straight ahead at 5 m/s and counts its plans.
    struct Straight {
        plans: Vec<usize>,
        horizon: usize,
    }

    impl Planner for Straight {
        fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
            self.plans.push(input.iteration);
            let ego = input.ego();
            let state = |step: usize| {
                let elapsed = STEP * step as f64;
                EgoState { time: ego.time + elapsed, x: ego.x + 5.0 * elapsed, vx: 5.0, ..*ego }
            };
            Ok(Trajectory::new((0..=self.horizon).map(state).collect(), ego)?)
        }
    }

    fn run(planner: &mut Straight, steps: usize, replan_interval: usize) -> Result<Drive, PlanningError> {
        let map = straight_road(None);
        let route = Route::new(&map, ["block"]).unwrap();
        let episode = Episode {
            map: &map,
            route: &route,
            shape: &EgoShape::PACIFICA,
            controller: Controller::PerfectTracking,
            steps,
            replan_interval,
        };
        let ego = EgoState { time: 3.0, ..EgoState::standing(Vec2::new(10.0, 1.75), 0.0) };
        let samples: Vec<Surroundings> = (0..21)
            .map(|i| Surroundings {
                objects: vec![car("a", 40.0 + f64::from(i), 1.75, 10.0)],
                lights: Vec::new(),
            })
            .collect();
        let start = EpisodeStart {
            history: vec![Sample { ego, objects: samples[0].objects.clone() }],
            lights: Vec::new(),
        };
        episode.run(start, planner, &mut Replay::new(samples))
    }

    #[test]
    fn ego_and_traffic_advance_together() {
        let mut planner = Straight { plans: Vec::new(), horizon: 10 };
        let drive = run(&mut planner, 20, 1).unwrap();
        assert_eq!((drive.samples.len(), drive.trajectories.len()), (21, 20));
        assert_eq!(planner.plans, (0..20).collect::<Vec<_>>());
        let last = &drive.samples[20];
        assert!((last.ego.x - 20.0).abs() < 1e-9 && (last.ego.time - 5.0).abs() < 1e-12);
        assert_eq!(last.objects[0].center.x, 60.0);
    }

    #[test]
    fn trajectories_are_kept_between_plans() {
        let mut planner = Straight { plans: Vec::new(), horizon: 10 };
        let drive = run(&mut planner, 20, 5).unwrap();
        assert_eq!(planner.plans, [0, 5, 10, 15]);
        assert_eq!(drive.trajectories[4], drive.trajectories[0]);
        assert!((drive.samples[20].ego.x - 20.0).abs() < 1e-9);
    }

    #[test]
    fn failures_name_their_iteration() {
        for (steps, replan_interval, expected) in [
            (20, 6, "iteration 4: trajectory is from"),
            (21, 1, "iteration 20: recording has 21 samples"),
            (1, 0, "replan interval is 0 steps"),
        ] {
            let mut planner = Straight { plans: Vec::new(), horizon: 4 };
            let error = run(&mut planner, steps, replan_interval).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
