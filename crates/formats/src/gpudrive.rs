//! JSON files of GPUDrive and its predecessor Nocturne: one Waymo scenario each. Described in
//! `docs/files.md`.

pub(super) mod links;

mod angles;
mod parts;
mod raw;
mod roads;

use std::path::Path;

use reactsim_scene::Scenario;

use self::raw::RawScenario;
use super::document::values::quote_not_finite;
use super::error::{Cause, FormatError};
use super::format::{
    PendingScenarios, ScenarioFormat, add_repairs, json_head, read_whole, single, with_stated_frames,
};
use super::frames::{CurrentFrames, LengthChoice};

/// Maximum file size in bytes; the largest scenarios have about ten megabytes.
const MAX_FILE_SIZE: u64 = 1 << 27;

/// The format of GPUDrive and Nocturne.
pub(super) struct GpuDrive;

impl ScenarioFormat for GpuDrive {
    fn id(&self) -> &'static str {
        "gpudrive"
    }

    fn title(&self) -> &'static str {
        "GPUDrive or Nocturne scenario, JSON with \"objects\" and \"roads\""
    }

    fn recognises(&self, path: &Path) -> bool {
        json_head(path).is_some_and(|head| {
            // Files of this program state their format at the beginning.
            !head.contains("\"reactsim-")
                && (head.contains("\"objects\"") || head.contains("\"roads\""))
                && (head.contains("\"position\"") || head.contains("\"geometry\""))
        })
    }

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        let open = || single(self, path, frames, move |path, _| read(path, length));
        with_stated_frames(self, path, frames, open)
    }

    fn count(&self, _path: &Path) -> Option<usize> {
        Some(1)
    }
}

fn read(path: &Path, length: LengthChoice) -> Result<Scenario, FormatError> {
    let undecodable = |e: String| FormatError::file(path, Cause::Undecodable(e)).at(0);
    let text = read_whole(path, MAX_FILE_SIZE, "one scenario")?;
    let text = String::from_utf8(text).map_err(|e| undecodable(e.to_string()))?;
    // Python writes NaN.
    let raw: RawScenario =
        serde_json::from_str(&quote_not_finite(&text)).map_err(|e| undecodable(e.to_string()))?;
    drop(text);
    let id = raw.id();
    let (parts, repairs) =
        parts::parts(raw, length).map_err(|cause| FormatError::record(path, 0, id, cause))?;
    let mut scenario = Scenario::assemble(parts).map_err(|e| FormatError::scene(path, 0, e))?;
    add_repairs(&mut scenario, repairs);
    Ok(scenario)
}
