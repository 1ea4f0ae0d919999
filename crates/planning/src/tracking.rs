//! Controllers: how ego moves during one step along the trajectory of its planner.
//!
//! Start with [`Controller`]. The LQR tracker with the kinematic bicycle is the controller of both
//! closed-loop challenges of nuPlan (devkit 1.2.2, `TwoStageController`).

mod bicycle;
mod lqr;
mod profile;
mod reference;

pub use bicycle::{Bicycle, Command};
pub use lqr::{HORIZON, LateralState, Target, command, is_stopping};
pub use profile::{Profile, Smoothing};
pub use reference::Reference;

use crate::trajectory::{MAX_SPEED, STEP, Trajectory};
use crate::{EgoShape, EgoState, PlanningError};

/// A controller of ego.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Controller {
    /// Ego takes the states of the trajectory, with their velocities and accelerations, at face value. It
    /// cannot be used with planners that return poses only, such as PDM-Closed.
    PerfectTracking,
    /// An LQR tracker commands acceleration and steering rate of a kinematic bicycle with lag.
    LqrBicycle,
}

impl Controller {
    /// Returns the state of ego [`STEP`] seconds later.
    ///
    /// # Errors
    /// [`PlanningError`] if the velocities of the trajectory are impossible or the result is not finite.
    pub fn advance(
        self,
        ego: &EgoState,
        shape: &EgoShape,
        trajectory: &Trajectory,
    ) -> Result<EgoState, PlanningError> {
        let state = match self {
            Self::PerfectTracking => perfect(ego, trajectory)?,
            Self::LqrBicycle => track(ego, shape, &Reference::new(trajectory)),
        };
        if state.is_finite() {
            Ok(state)
        } else {
            Err(PlanningError(format!(
                "state of ego after {} s is not finite: {state:?}; the trajectory is too far from ego to track",
                ego.time
            )))
        }
    }
}

/// Returns the state of the trajectory at the next step.
fn perfect(ego: &EgoState, trajectory: &Trajectory) -> Result<EgoState, PlanningError> {
    let state = trajectory.at(ego.time + STEP);
    let (time, speed) = (state.time, state.speed());
    if speed < MAX_SPEED {
        Ok(state)
    } else {
        Err(PlanningError(format!(
            "trajectory has the speed {speed:.1} m/s at {time} s; perfect tracking needs less than {MAX_SPEED} m/s"
        )))
    }
}

/// Returns the state at the next step of a bicycle that tracks `reference`.
pub fn track(ego: &EgoState, shape: &EgoShape, reference: &Reference<'_>) -> EgoState {
    let target = reference.target(ego.time);
    let lateral = LateralState::new(ego.into(), ego.steering, target.pose);
    Bicycle::of(shape).advance(ego, command(lateral, ego.vx, &target, shape.wheelbase))
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    fn straight(speed: f64) -> (EgoState, Trajectory) {
        let states: Vec<EgoState> = (0..81)
            .map(|i| {
                let time = STEP * f64::from(i);
                EgoState { time, vx: speed, ..EgoState::standing(Vec2::new(speed * time, 0.0), 0.0) }
            })
            .collect();
        let ego = states[0];
        (ego, Trajectory::new(states, &ego).unwrap())
    }

    #[test]
    fn a_straight_line_is_followed_exactly() {
        for controller in [Controller::PerfectTracking, Controller::LqrBicycle] {
            let (mut ego, trajectory) = straight(8.0);
            for _ in 0..40 {
                ego = controller.advance(&ego, &EgoShape::PACIFICA, &trajectory).unwrap();
            }
            assert!((ego.x - 32.0).abs() < 1e-9 && ego.y.abs() < 1e-9 && (ego.time - 4.0).abs() < 1e-9);
        }
    }

    #[test]
    fn offsets_are_reduced() {
        let (ego, trajectory) = straight(8.0);
        let mut ego = EgoState { y: 0.5, ..ego };
        for _ in 0..60 {
            ego = Controller::LqrBicycle.advance(&ego, &EgoShape::PACIFICA, &trajectory).unwrap();
        }
        assert!(ego.y.abs() < 0.05, "{ego:?}");
    }

    #[test]
    fn impossible_velocities_are_refused() {
        let (ego, trajectory) = straight(8.0);
        let fast: Vec<EgoState> =
            trajectory.states().iter().map(|state| EgoState { vx: 50.0, ..*state }).collect();
        let trajectory = Trajectory::new(fast, &ego).unwrap();
        let error = Controller::PerfectTracking.advance(&ego, &EgoShape::PACIFICA, &trajectory).unwrap_err();
        assert!(error.to_string().contains("perfect tracking needs less than 50 m/s"), "{error}");
    }
}
