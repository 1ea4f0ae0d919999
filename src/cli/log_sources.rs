//! Sources of logs for the realism metrics.

use std::path::PathBuf;

use super::{find_inputs, inputs_of};
use crate::evaluation::ReadingSpec;
use crate::evaluation::realism::LogSource;
use crate::formats::CurrentFrames;

/// Returns the sources of logs as they were recorded, as far as files are recordings of the Waymo Open Motion
/// Dataset; the shipped scenarios without paths.
pub(super) fn recorded(paths: &[PathBuf]) -> anyhow::Result<Vec<LogSource>> {
    if paths.is_empty() {
        return Ok(vec![LogSource::Shipped]);
    }
    let mut sources = Vec::new();
    for path in paths {
        if LogSource::is_message(path) {
            sources.push(LogSource::Recording(path.clone()));
        } else {
            sources.extend(find_inputs(std::slice::from_ref(path))?.into_iter().map(LogSource::of));
        }
    }
    Ok(sources)
}

/// Returns the sources of logs with the agents that a run simulates: recordings as they are if these are all,
/// at the current frame that they state.
pub(super) fn simulated(paths: &[PathBuf], reading: &ReadingSpec) -> anyhow::Result<Vec<LogSource>> {
    let as_recorded = reading.has_all_agents() && reading.frames() == CurrentFrames::Stated;
    if reading.is_shipped(paths) || as_recorded && reading.nuplan.filter.is_none() {
        return recorded(paths);
    }
    Ok(inputs_of(reading, paths)?.into_iter().map(LogSource::Scenarios).collect())
}
