//! Arguments that select scenarios of nuPlan logs as nuPlan's devkit does.

use std::path::PathBuf;

use clap::Args;

use super::find_inputs;
use crate::formats::{Input, nuplan_filter};

/// Logs of nuPlan with a scenario filter of the devkit.
#[derive(Debug, Args)]
pub(super) struct NuplanArgs {
    /// Logs of nuPlan (`.db`), or folders that hold some; may be repeated
    #[arg(long, value_name = "LOGS", requires = "filter")]
    nuplan: Vec<PathBuf>,
    /// Scenarios of --nuplan that a scenario_filter of nuPlan's devkit (YAML) selects, such as val14_split.yaml
    #[arg(long, value_name = "FILE", requires = "nuplan")]
    filter: Option<PathBuf>,
    /// Folder with the list of nuPlan's maps [default: the one above the logs]
    #[arg(long, value_name = "FOLDER", requires = "nuplan")]
    maps: Option<PathBuf>,
}

impl NuplanArgs {
    /// Returns whether scenarios are selected.
    pub(super) fn is_given(&self) -> bool {
        self.filter.is_some()
    }

    /// Returns the options that are given, by name.
    pub(super) fn named(&self) -> impl Iterator<Item = (&'static str, String)> {
        self.filter.iter().map(|filter| ("filter", filter.display().to_string()))
    }

    /// Finds inputs as [`find_inputs`], and the selected scenarios.
    pub(super) fn find_inputs(&self, paths: &[PathBuf]) -> anyhow::Result<Vec<Input>> {
        let mut inputs = find_inputs(paths)?;
        if let Some(filter) = &self.filter {
            inputs.push(nuplan_filter(filter, &self.nuplan, self.maps.clone())?);
        }
        Ok(inputs)
    }
}
