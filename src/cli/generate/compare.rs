//! `reactsim generate compare`: generated logs against recorded ones.

use anyhow::bail;
use clap::Args;

use crate::cli::ExitStatus;

/// Arguments of `generate compare`.
#[derive(Debug, Args)]
pub(super) struct CompareArgs {}

pub(super) fn compare(_args: &CompareArgs) -> anyhow::Result<ExitStatus> {
    bail!("the comparison is not there yet")
}
