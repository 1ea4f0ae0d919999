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
use super::format::{PendingScenarios, ScenarioFormat, head, read_whole, refused_frames, single};
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
        head(path, 4096).is_ok_and(|head| {
            let contains = |text: &str| head.windows(text.len()).any(|w| w == text.as_bytes());
            // Files of this program state their format at the beginning.
            head.trim_ascii_start().starts_with(b"{")
                && !contains("\"reactsim-")
                && (contains("\"objects\"") || contains("\"roads\""))
                && (contains("\"position\"") || contains("\"geometry\""))
        })
    }

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        match refused_frames(self, path, frames) {
            Some(refused) => refused,
            None => single(self, path, frames, move |path, _| read(path, length)),
        }
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
    let converted = parts::parts(raw, length).map_err(|cause| FormatError::record(path, 0, id, cause))?;
    let mut scenario = Scenario::assemble(converted.parts).map_err(|e| FormatError::scene(path, 0, e))?;
    let repairs = converted.left_out.into_iter().map(|(what, count)| (what.to_owned(), count));
    for (what, count) in repairs.chain(converted.unknown_types) {
        *scenario.repairs.entry(what).or_default() += count;
    }
    Ok(scenario)
}
