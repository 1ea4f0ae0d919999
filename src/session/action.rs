//! Actions: how a program moves the AV or an agent during one step.

use serde::Deserialize;

use super::wire::{RequestError, refused};
use crate::geometry::{Vec2, direction, left};
use crate::planning::av::{at_start, state_of_box};
use crate::planning::from_scene::ego_states_until_now;
use crate::planning::tracking::Controller;
use crate::planning::{EgoShape, EgoState, MAX_SPEED, STEP, Trajectory};
use crate::rollout::MAX_STEP_DISPLACEMENT;
use crate::scene::dynamics::{MAX_ACCELERATION, MAX_CURVATURE, Pose};
use crate::scene::{AgentState, DT, Frame};

/// Share of the largest speed of a trajectory to which planned displacements are shortened.
const BELOW_MAX_SPEED: f64 = 0.999;

/// The kind of the actions of an environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ActionKind {
    /// The next state in the frame of the scenario: x, y, heading, vx, vy.
    State,
    /// Acceleration, m/s², and curvature, 1/m, of a kinematic bicycle.
    Bicycle,
    /// Poses after 1, 2, … steps in the frame of the AV: x, y, heading. A tracker follows them.
    Plan {
        /// Number of poses.
        poses: usize,
    },
}

impl ActionKind {
    /// Returns the number of values of an action.
    pub fn values(self) -> usize {
        match self {
            Self::State => 5,
            Self::Bicycle => 2,
            Self::Plan { poses } => 3 * poses,
        }
    }

    /// Checks `actions`, one row per name; rows without a name are ignored.
    ///
    /// # Errors
    /// If the count of the numbers is another one, or one is not finite.
    pub(super) fn check(self, actions: &[f64], rows: &[Option<String>]) -> Result<(), RequestError> {
        let (values, found) = (self.values(), actions.len());
        if found != values * rows.len() {
            let rows = rows.len();
            return refused(format_args!("the actions have {found} numbers, expected {rows} × {values}"));
        }
        for (i, number) in actions.iter().enumerate() {
            // Velocities of states may be unknown.
            let is_fit = number.is_finite() || number.is_nan() && self == Self::State && i % values >= 3;
            if let (false, Some(row)) = (is_fit, &rows[i / values]) {
                let i = i % values;
                return refused(format_args!(
                    "value {i} of the action of {row} is {number}, expected a finite number"
                ));
            }
        }
        Ok(())
    }
}

/// The motion of an agent between two actions.
#[derive(Clone, Debug)]
pub(super) enum Mover {
    /// It takes states at face value.
    States,
    /// A kinematic bicycle with this speed along its heading, m/s.
    Bicycle { speed: f64 },
    /// A tracker follows the trajectory.
    Tracker(Box<Tracked>),
}

/// State of a tracked vehicle.
#[derive(Clone, Debug)]
pub(super) struct Tracked {
    shape: EgoShape,
    ego: EgoState,
    trajectory: Option<Trajectory>,
}

impl Mover {
    /// Creates the motion of an agent whose history is `track`.
    pub(super) fn new(kind: ActionKind, track: &[Frame], shape: &EgoShape) -> Option<Self> {
        Some(match kind {
            ActionKind::State => Self::States,
            ActionKind::Bicycle => {
                Self::Bicycle { speed: track.last().copied().flatten()?.forward_speed().max(0.0) }
            }
            ActionKind::Plan { .. } => {
                let ego = at_start(*ego_states_until_now(track, shape).last()?);
                Self::Tracker(Box::new(Tracked { shape: *shape, ego, trajectory: None }))
            }
        })
    }

    /// Returns the state after the next step. `now`: the present state; `is_new`: whether the action begins
    /// with this step, and does not continue an earlier one.
    ///
    /// # Errors
    /// If the state is not finite or too far away.
    pub(super) fn advance(
        &mut self,
        now: &AgentState,
        action: &[f64],
        is_new: bool,
    ) -> Result<AgentState, RequestError> {
        match self {
            Self::States => next_state(now, action),
            Self::Bicycle { speed } => {
                let acceleration = action[0].clamp(-MAX_ACCELERATION, MAX_ACCELERATION);
                let curvature = action[1].clamp(-MAX_CURVATURE, MAX_CURVATURE);
                // It brakes to a standstill and does not reverse.
                let next = (*speed + acceleration * DT).max(0.0);
                let distance = (0.5 * (*speed + next) * DT).min(MAX_STEP_DISPLACEMENT);
                *speed = next.min(MAX_STEP_DISPLACEMENT / DT);
                let pose = Pose::from(*now).advance(distance, curvature);
                let velocity = direction(pose.heading) * *speed;
                Ok(AgentState {
                    x: pose.position.x,
                    y: pose.position.y,
                    heading: pose.heading,
                    vx: velocity.x,
                    vy: velocity.y,
                })
            }
            Self::Tracker(tracked) => tracked.advance(now, action, is_new),
        }
    }
}

fn next_state(now: &AgentState, action: &[f64]) -> Result<AgentState, RequestError> {
    let [x, y, heading, vx, vy] = [action[0], action[1], action[2], action[3], action[4]];
    let mut next = AgentState { x, y, heading, vx, vy };
    let displacement = next.position() - now.position();
    let metres = displacement.norm();
    if !(metres <= MAX_STEP_DISPLACEMENT) || !heading.is_finite() {
        return refused(format_args!(
            "the action moves the agent {metres:.1} m in 0.1 s to ({x}, {y}) with the heading {heading}, \
             expected at most {MAX_STEP_DISPLACEMENT:.1} m from ({:.2}, {:.2})",
            now.x, now.y
        ));
    }
    if next.velocity().is_none() {
        (next.vx, next.vy) = (displacement.x / DT, displacement.y / DT);
    }
    Ok(next)
}

impl Tracked {
    fn advance(
        &mut self,
        now: &AgentState,
        action: &[f64],
        is_new: bool,
    ) -> Result<AgentState, RequestError> {
        if is_new || self.trajectory.is_none() {
            let poses = self.poses(now, action);
            let trajectory = Trajectory::through_centers(&poses, &self.ego, &self.shape);
            self.trajectory = Some(trajectory.map_err(RequestError::new)?);
        }
        let Some(trajectory) = &self.trajectory else { return refused("there is no plan") };
        let next = Controller::LqrBicycle.advance(&self.ego, &self.shape, trajectory);
        self.ego = next.map_err(RequestError::new)?;
        let state = state_of_box(&self.ego, &self.shape);
        let metres = (state.position() - now.position()).norm();
        if metres > MAX_STEP_DISPLACEMENT {
            return refused(format_args!(
                "the plan moves the AV {metres:.1} m in 0.1 s, expected at most {MAX_STEP_DISPLACEMENT:.1} m"
            ));
        }
        Ok(state)
    }

    /// Returns the planned box centres in the frame of the scenario. Displacements of the rear axle that are
    /// faster than a trajectory can be are shortened.
    fn poses(&self, now: &AgentState, action: &[f64]) -> Vec<[f64; 3]> {
        let ahead = direction(now.heading);
        let longest = BELOW_MAX_SPEED * MAX_SPEED * STEP;
        let mut before = self.ego.rear_axle();
        let pose = |values: &[f64]| {
            let heading = now.heading + values[2];
            let to_center = direction(heading) * self.shape.rear_axle_to_center;
            let center = now.position() + ahead * values[0] + left(ahead) * values[1];
            let by: Vec2 = center - to_center - before;
            let rear_axle = before + by * (longest / by.norm()).min(1.0);
            before = rear_axle;
            let center = rear_axle + to_center;
            [center.x, center.y, heading]
        };
        action.chunks(3).map(pose).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(speed: f64) -> AgentState {
        AgentState { x: 1.0, y: 2.0, heading: 0.0, vx: speed, vy: 0.0 }
    }

    fn history(speed: f64) -> Vec<Frame> {
        (0..11).map(|k| Some(AgentState { x: 1.0 - speed * DT * f64::from(10 - k), ..at(speed) })).collect()
    }

    #[test]
    fn a_bicycle_brakes_to_a_standstill_and_stays_within_the_limits() {
        let mut mover = Mover::new(ActionKind::Bicycle, &history(1.0), &EgoShape::PACIFICA).unwrap();
        let mut now = at(1.0);
        for _ in 0..5 {
            now = mover.advance(&now, &[-60.0, 0.0], true).unwrap();
        }
        assert!((now.x - 1.0 - 0.07 - 0.02).abs() < 1e-12, "{now:?}");
        assert_eq!((now.y, now.vx), (2.0, 0.0));
        let next = mover.advance(&now, &[60.0, 9.0], true).unwrap();
        assert!((next.speed() - MAX_ACCELERATION * DT).abs() < 1e-12);
        assert!((next.heading - MAX_CURVATURE * 0.03).abs() < 1e-12);
    }

    #[test]
    fn a_straight_plan_is_followed() {
        let mut mover =
            Mover::new(ActionKind::Plan { poses: 20 }, &history(8.0), &EgoShape::PACIFICA).unwrap();
        let plan: Vec<f64> = (1..=20).flat_map(|k| [0.8 * f64::from(k), 0.0, 0.0]).collect();
        let mut now = at(8.0);
        for k in 0..10 {
            now = mover.advance(&now, &plan, k == 0).unwrap();
        }
        assert!((now.x - 9.0).abs() < 0.05 && (now.y - 2.0).abs() < 1e-6, "{now:?}");
    }

    #[test]
    fn plans_that_are_too_fast_are_shortened() {
        let mut mover =
            Mover::new(ActionKind::Plan { poses: 3 }, &history(8.0), &EgoShape::PACIFICA).unwrap();
        let wild = [400.0, -400.0, 3.0, -400.0, 400.0, -3.0, 400.0, 400.0, 0.0];
        let next = mover.advance(&at(8.0), &wild, true).unwrap();
        assert!(next.is_finite() && (next.position() - at(8.0).position()).norm() < MAX_STEP_DISPLACEMENT);
    }

    #[test]
    fn unknown_velocities_of_states_are_displacements() {
        let next = Mover::States.advance(&at(1.0), &[1.5, 2.0, 0.0, f64::NAN, 0.0], true).unwrap();
        assert_eq!((next.vx, next.vy), (5.0, 0.0));
        assert!(Mover::States.advance(&at(1.0), &[f64::NAN, 2.0, 0.0, 0.0, 0.0], true).is_err());
    }
}
