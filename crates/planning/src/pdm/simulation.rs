//! Simulation of proposals by the LQR tracker and the bicycle (tuplan_garage b51d5d0, `PDMSimulator`).

use super::proposals::{Proposal, STEPS};
use crate::tracking::{Bicycle, HORIZON, LateralState, Profile, Smoothing, Target, command};
use crate::trajectory::{Pose, STEP};
use crate::{EgoShape, EgoState};

/// Returns the states of ego if it tracks the first [`STEPS`] steps of a proposal, the present state first.
pub(super) fn simulate(ego: &EgoState, shape: &EgoShape, proposal: &Proposal) -> Vec<EgoState> {
    let poses = &proposal.poses[..=STEPS];
    let profile = Profile::fit(poses, STEP, Smoothing::Acceleration);
    let bicycle = Bicycle::of(shape);
    let mut states = Vec::with_capacity(poses.len());
    states.push(*ego);
    for (step, &pose) in poses[..STEPS].iter().enumerate() {
        let state = states[step];
        let target = target(&profile, pose, step);
        let lateral = LateralState::new(Pose::from(&state), state.steering, target.pose);
        states.push(bicycle.advance(&state, command(lateral, state.vx, &target, shape.wheelbase)));
    }
    states
}

/// Returns the target of a step. Beyond the end of the profile the last sample counts.
fn target(profile: &Profile, pose: Pose, step: usize) -> Target {
    let last = profile.speeds.len() - 1;
    Target {
        pose,
        speed: profile.speeds[(step + HORIZON).min(last)],
        curvatures: std::array::from_fn(|ahead| profile.curvatures[(step + ahead).min(last)]),
    }
}
