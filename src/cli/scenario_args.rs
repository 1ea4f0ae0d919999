//! Arguments that name scenarios and their deviated AVs.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::bail;
use clap::Args;

use super::ReadingArgs;
use crate::evaluation::Source;

/// Scenarios of a command, by default those of the shipped benchmark.
#[derive(Debug, Args)]
pub(super) struct ScenarioArgs {
    /// Files or folders of scenarios [default: the shipped benchmark]
    #[arg(value_name = "SCENARIOS")]
    pub(super) scenarios: Vec<PathBuf>,
    /// Deviated AVs by scenario id, Parquet or JSON; other scenarios are skipped
    #[arg(long, value_name = "FILE")]
    pub(super) deviations: Option<PathBuf>,
    /// Only the first N scenarios of every file [default: all]
    #[arg(long, value_name = "N")]
    pub(super) limit: Option<NonZeroUsize>,
    #[command(flatten)]
    reading: ReadingArgs,
}

impl ScenarioArgs {
    /// Finds the files of scenarios and recognises their formats.
    pub(super) fn sources(&self) -> anyhow::Result<Vec<Source>> {
        let most = self.limit.map_or(usize::MAX, NonZeroUsize::get);
        if self.scenarios.is_empty() {
            if self.reading.current_frame.is_some() {
                bail!("the shipped scenarios have a fixed current frame: leave --current-frame out");
            }
            return Ok(vec![Source::shipped(most)]);
        }
        Ok(Source::of_inputs(self.reading.find_inputs(&self.scenarios)?, most)?)
    }
}
