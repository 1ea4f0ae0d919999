//! The page of runs and the location of their scenarios, shared by `report` and `view`.

use std::path::PathBuf;

use clap::Args;

use super::inputs::find_inputs;
use super::output::say;
use crate::evaluation::NuplanSpec;
use crate::formats::Input;
use crate::report::page::Gallery;

/// Scenarios of finished runs.
#[derive(Debug, Args)]
pub(super) struct RunScenarioArgs {
    /// Scenarios of the runs, unless they ship with the program, are where the runs read them, or are in the
    /// current folder; may be repeated
    #[arg(long, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    #[command(flatten)]
    nuplan: NuplanSpec,
}

impl RunScenarioArgs {
    /// Returns whether some are given.
    pub(super) fn is_given(&self) -> bool {
        !self.scenarios.is_empty() || self.nuplan != NuplanSpec::default()
    }

    /// Finds the files.
    pub(super) fn inputs(&self) -> anyhow::Result<Vec<Input>> {
        let mut inputs = find_inputs(&self.scenarios)?;
        inputs.extend(self.nuplan.input()?);
        Ok(inputs)
    }
}

/// Opens the runs in these folders with these scenarios. Says why scenes are unavailable, if they are.
pub(super) fn open(folders: &[PathBuf], scenarios: &RunScenarioArgs) -> anyhow::Result<Gallery> {
    let gallery = Gallery::of_folders(folders, &scenarios.inputs()?)?;
    for note in gallery.missing_for_scenes() {
        say(format_args!("note: {note}"));
    }
    Ok(gallery)
}
