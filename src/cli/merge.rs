//! `reactsim merge`: joins the partitions of a command.

use std::path::PathBuf;

use clap::Args;

use super::partition::{Partitions, refuse_filled};

const AFTER: &str = "\
Example:
  reactsim run LOGS --models idm --partition 1/2 --out part1
  reactsim run LOGS --models idm --partition 2/2 --out part2
  reactsim merge part1 part2 --out runs/idm

The output is byte-identical to that of the command without --partition.";

/// Arguments of `merge`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct MergeArgs {
    /// Folders of all partitions, in any order
    #[arg(required = true, value_name = "FOLDERS")]
    folders: Vec<PathBuf>,
    /// Folder or file to write, as --out of the whole command
    #[arg(long, value_name = "PATH")]
    pub(super) out: PathBuf,
}

impl MergeArgs {
    /// Reads the partitions.
    pub(super) fn open(&self) -> anyhow::Result<Partitions> {
        let partitions = Partitions::read(&self.folders)?;
        refuse_filled(&self.out)?;
        Ok(partitions)
    }
}
