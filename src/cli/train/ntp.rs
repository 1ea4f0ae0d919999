//! `reactsim train ntp`.

use std::fs;
use std::path::PathBuf;

use anyhow::Context;
use clap::Args;

use super::session::{self, SessionArgs};
use crate::cli::ExitStatus;
use crate::models::nn::device;
use crate::models::ntp::learn::{NextToken, Recipe};
use crate::models::ntp::tokens::{Kinematic, Vocabulary};

/// Arguments of `train ntp`.
#[derive(Debug, Args)]
pub(super) struct NtpArgs {
    #[command(flatten)]
    session: SessionArgs,
    /// Recipe, TOML: sizes of the network, augmentation, smoothing [default: that of the shipped weights]
    #[arg(long, value_name = "FILE")]
    recipe: Option<PathBuf>,
    /// Vocabulary of motion tokens, as `train vocabulary` makes it [default: the kinematic one]
    #[arg(long, value_name = "FILE")]
    vocabulary: Option<PathBuf>,
}

pub(super) fn ntp(args: &NtpArgs) -> anyhow::Result<ExitStatus> {
    let recipe: Recipe = match &args.recipe {
        Some(path) => {
            let text = fs::read_to_string(path).with_context(|| format!("could not read {}", path.display()))?;
            toml::from_str(&text).with_context(|| format!("{} is no recipe", path.display()))?
        }
        None => Recipe::default(),
    };
    recipe.network.check().context("the recipe")?;
    let vocabulary = match &args.vocabulary {
        Some(path) => {
            let bytes = fs::read(path).with_context(|| format!("could not read {}", path.display()))?;
            Vocabulary::read(&bytes).with_context(|| path.display().to_string())?
        }
        None => Kinematic::default().build()?,
    };
    let task = NextToken::new(recipe, vocabulary, &device());
    session::train(&args.session, &task, None)
}
