//! The baselines of this family.

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_nn::device_of;
use reactsim_rollout::Controller;

use super::{Policy, QpRegressionSimulator, RegressionSimulator};

/// Baseline that plans along predictions.
pub const QP_REGRESSION: Baseline = Baseline {
    takes_stage: false,
    by_default: true,
    ..Baseline::of_network(
        "qp-regression",
        include_str!("cards/qp_regression.toml"),
        include_str!("ranges/qp_regression.toml"),
        qp_regression,
    )
};

/// Baseline that executes predictions as they are.
pub const REGRESSION: Baseline = Baseline::of_network(
    "regression",
    include_str!("cards/regression.toml"),
    include_str!("ranges/regression.toml"),
    regression,
);

/// The same with the published structure, without the lane outlook.
pub const MTR: Baseline = Baseline { id: "mtr", card: include_str!("cards/mtr.toml"), ..REGRESSION };

fn qp_regression(setup: Setup) -> Result<Controller, ModelError> {
    let smooth = setup.parameters()?;
    let (device, settings) = (device_of(setup.backend), crate::settings()?);
    let policy = setup.read_weights(|bytes| Policy::read(bytes, &device))?;
    Ok(Controller::Fair(Box::new(QpRegressionSimulator::new(policy, smooth, settings, device))))
}

fn regression(setup: Setup) -> Result<Controller, ModelError> {
    let driving = setup.parameters()?;
    let device = device_of(setup.backend);
    let policy = setup.read_weights(|bytes| Policy::read(bytes, &device))?;
    Ok(Controller::Fair(Box::new(RegressionSimulator::new(policy, driving, device))))
}
