//! `reactsim train qp-regression`: trains the network of `regression` and `qp-regression`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;

use super::closed_loop::ClosedLoopArgs;
use super::recipe;
use super::session::{self, SessionArgs};
use crate::cli::ExitStatus;
use crate::files::read_regular;
use crate::models::qp_regression::learn::{Recipe, Regression};
use crate::models::qp_regression::network::Network;
use crate::models::qp_regression::{Driving, Intentions, RegressionSimulator};
use crate::models::{self, WeightsFile};
use crate::rollout::Controller;

/// Arguments of `train qp-regression`.
#[derive(Debug, Args)]
pub(super) struct QpRegressionArgs {
    #[command(flatten)]
    session: SessionArgs,
    /// Recipe (TOML): network sizes, augmentation [default: a network for two cores]
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    /// Intention points, from `train intentions` [default: a fan of sixteen]
    #[arg(long, value_name = "FILE")]
    intentions: Option<PathBuf>,
    /// Start from the weights of an earlier training instead of new ones; keeps their sizes and
    /// intention points
    #[arg(long, value_name = "FILE", conflicts_with = "intentions")]
    from: Option<PathBuf>,
    #[command(flatten)]
    closed_loop: ClosedLoopArgs,
}

/// Simulator that runs the network.
const ID: &str = "qp-regression";

pub(super) fn qp_regression(args: &QpRegressionArgs) -> anyhow::Result<ExitStatus> {
    let recipe: Recipe = recipe::read(args.recipe.as_deref())?;
    recipe.network.check().context("the recipe")?;
    let device = args.session.device()?;
    let drive = args.closed_loop.read()?;
    let read = |path: &Path| read_regular(path).with_context(|| format!("could not read {}", path.display()));
    let task = match (&args.from, &args.intentions) {
        (Some(path), _) => {
            let file = WeightsFile::new(path.display().to_string(), read(path)?);
            Regression::from_weights(recipe, &file, &device)?
        }
        (None, Some(path)) => {
            let intentions = Intentions::read(&read(path)?).with_context(|| path.display().to_string())?;
            Regression::new(recipe, intentions, &device)
        }
        (None, None) => Regression::new(recipe, Intentions::fan(), &device),
    };
    let Some(drive) = drive else { return session::train(&args.session, ID, &task, None) };
    // Closed-loop driving uses the parameters of the simulator's card.
    let baseline = models::find("regression").context("there is no simulator `regression`")?;
    let driving: Driving = baseline.setup()?.parameters()?;
    let measure = |network: &Network, _step: u64| {
        let simulator = RegressionSimulator::new(task.policy(network), driving, device.clone());
        drive.measure(&Controller::Fair(Box::new(simulator)))
    };
    session::train(&args.session, ID, &task, Some(&measure))
}
