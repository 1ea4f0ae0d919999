//! `reactsim train qp-regression`.

use std::fs;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use super::closed_loop::ClosedLoopArgs;
use super::recipe;
use super::session::{self, SessionArgs};
use crate::cli::ExitStatus;
use crate::models;
use crate::models::nn::device;
use crate::models::qp_regression::learn::{Recipe, Regression};
use crate::models::qp_regression::network::Network;
use crate::models::qp_regression::{Driving, Intentions, RegressionSimulator};
use crate::rollout::Controller;

/// Arguments of `train qp-regression`.
#[derive(Debug, Args)]
pub(super) struct QpRegressionArgs {
    #[command(flatten)]
    session: SessionArgs,
    /// Recipe, TOML: sizes of the network, augmentation [default: a network for two cores]
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    /// Intention points, as `train intentions` finds them [default: a fan of sixteen]
    #[arg(long, value_name = "FILE")]
    intentions: Option<PathBuf>,
    #[command(flatten)]
    closed_loop: ClosedLoopArgs,
}

pub(super) fn qp_regression(args: &QpRegressionArgs) -> anyhow::Result<ExitStatus> {
    let recipe: Recipe = recipe::read(args.recipe.as_deref())?;
    recipe.network.check().context("the recipe")?;
    let intentions = match &args.intentions {
        Some(path) => {
            let bytes = fs::read(path).with_context(|| format!("could not read {}", path.display()))?;
            Intentions::read(&bytes).with_context(|| path.display().to_string())?
        }
        None => Intentions::fan(),
    };
    let device = device();
    let drive = args.closed_loop.read()?;
    let task = Regression::new(recipe, intentions, &device);
    let Some(drive) = drive else { return session::train(&args.session, &task, None) };
    // As its card says.
    let baseline = models::find("regression").context("there is no simulator `regression`")?;
    let driving: Driving = baseline.setup()?.parameters()?;
    let measure = |network: &Network, _step: u64| {
        let simulator = RegressionSimulator::new(task.policy(network), driving, device.clone());
        drive.measure(&Controller::Fair(Box::new(simulator)))
    };
    session::train(&args.session, &task, Some(&measure))
}
