//! Hand-written scenarios: one JSON file each, with compact notations for motions and lines. Described in
//! `docs/files.md`.

mod motion;
mod parts;
mod raw;

use std::path::Path;

use reactsim_scene::Scenario;

use self::raw::RawScenario;
use super::crop::crop;
use super::error::{Cause, FormatError};
use super::format::{PendingScenarios, ScenarioFormat, json_head, read_whole, single, with_stated_frames};
use super::frames::{CurrentFrames, LengthChoice};

/// Maximum file size in bytes; a scenario with full tracks has a few megabytes.
const MAX_FILE_SIZE: u64 = 1 << 28;

pub(super) struct Json;

impl ScenarioFormat for Json {
    fn id(&self) -> &'static str {
        "json"
    }

    fn title(&self) -> &'static str {
        "hand-written scenario, JSON with \"format\": \"reactsim-scenario-v1\""
    }

    fn recognises(&self, path: &Path) -> bool {
        json_head(path).is_some_and(|head| head.contains(raw::FORMAT))
    }

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        let cropped = move |path: &Path, _| {
            let mut scenario = read(path)?;
            match crop(&mut scenario, length) {
                Ok(()) => Ok(scenario),
                Err(cause) => Err(FormatError::record(path, 0, Some(scenario.id), cause)),
            }
        };
        with_stated_frames(self, path, frames, || single(self, path, frames, cropped))
    }

    fn count(&self, _path: &Path) -> Option<usize> {
        Some(1)
    }
}

fn read(path: &Path) -> Result<Scenario, FormatError> {
    parse(path, &read_whole(path, MAX_FILE_SIZE, "one scenario")?)
}

/// Reads a hand-written scenario from memory; errors refer to it as `path`.
///
/// # Errors
/// [`FormatError`] names the field and the value.
pub fn parse(path: &Path, text: &[u8]) -> Result<Scenario, FormatError> {
    let raw: RawScenario = serde_json::from_slice(text)
        .map_err(|e| FormatError::file(path, Cause::Undecodable(e.to_string())).at(0))?;
    let id = raw.id.clone();
    let parts = parts::parts(raw).map_err(|cause| FormatError::record(path, 0, Some(id), cause))?;
    Scenario::assemble(parts).map_err(|e| FormatError::scene(path, 0, e))
}

#[cfg(test)]
mod tests;
