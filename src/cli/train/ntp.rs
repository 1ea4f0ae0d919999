//! `reactsim train ntp`: trains the next-token network of `ntp-reactive`.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use super::closed_loop::ClosedLoopArgs;
use super::recipe;
use super::session::{self, SessionArgs};
use crate::cli::ExitStatus;
use crate::files::read_regular;
use crate::models;
use crate::models::ntp::Driving;
use crate::models::ntp::learn::{NextToken, Recipe};
use crate::models::ntp::reactive::{Network, Policy, ReactiveSimulator};
use crate::models::ntp::tokens::{Kinematic, Vocabulary};
use crate::rollout::Controller;

/// Arguments of `train ntp`.
#[derive(Debug, Args)]
pub(super) struct NtpArgs {
    #[command(flatten)]
    session: SessionArgs,
    /// Recipe (TOML): network sizes, augmentation, smoothing [default: a network for two cores]
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    /// Vocabulary of motion tokens, from `train vocabulary` [default: the kinematic one]
    #[arg(long, value_name = "FILE")]
    vocabulary: Option<PathBuf>,
    #[command(flatten)]
    closed_loop: ClosedLoopArgs,
}

/// Simulator that runs the network.
const ID: &str = "ntp-reactive";

pub(super) fn ntp(args: &NtpArgs) -> anyhow::Result<ExitStatus> {
    let recipe: Recipe = recipe::read(args.recipe.as_deref())?;
    recipe.network.check().context("the recipe")?;
    let vocabulary = match &args.vocabulary {
        Some(path) => {
            let bytes = read_regular(path).with_context(|| format!("could not read {}", path.display()))?;
            Vocabulary::read(&bytes).with_context(|| path.display().to_string())?
        }
        None => Kinematic::default().build()?,
    };
    let device = args.session.device()?;
    let drive = args.closed_loop.read()?;
    let task = NextToken::new(recipe, vocabulary.clone(), &device);
    let Some(drive) = drive else { return session::train(&args.session, ID, &task, None) };
    // Closed-loop driving uses the parameters of the simulator's card.
    let baseline = models::find(ID).with_context(|| format!("there is no simulator `{ID}`"))?;
    let driving: Driving = baseline.setup()?.parameters()?;
    let measure = |network: &Network, _step: u64| {
        let policy =
            Policy { config: recipe.network, vocabulary: vocabulary.clone(), network: network.clone() };
        let simulator = ReactiveSimulator::new(policy, driving, device.clone());
        drive.measure(&Controller::Fair(Box::new(simulator)))
    };
    session::train(&args.session, ID, &task, Some(&measure))
}
