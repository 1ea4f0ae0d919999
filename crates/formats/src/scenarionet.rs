//! Pickles of ScenarioNet: one scenario each, from Waymo, nuPlan, nuScenes or Argoverse 2. Described in
//! `docs/files.md`.

mod ground;
mod lights;
mod map;
mod parts;
mod tracks;
mod window;

use std::num::NonZeroUsize;
use std::path::Path;

use reactsim_scene::Scenario;

use super::error::{Cause, FormatError};
use super::format::{
    PendingScenarios, ScenarioFormat, UndecodedScenario, add_repairs, head, named, read_whole, single,
};
use super::frames::{CurrentFrames, LengthChoice};
use super::pickle::Pickle;

/// Maximum file size in bytes; the largest scenarios have some megabytes.
const MAX_FILE_SIZE: u64 = 1 << 27;
/// Keys of a scenario, some of which occur at the beginning of a file.
const KEYS: &[&str] = &["tracks", "map_features", "dynamic_map_states", "metadata", "version", "length"];
/// Index files that accompany the scenarios of a data set.
const INDEX_FILES: &[&str] = &["dataset_summary.pkl", "dataset_mapping.pkl"];

pub(super) struct ScenarioNet;

impl ScenarioFormat for ScenarioNet {
    fn id(&self) -> &'static str {
        "scenarionet"
    }

    fn title(&self) -> &'static str {
        "ScenarioNet scenario, a Python pickle with \"tracks\" and \"map_features\""
    }

    fn recognises(&self, path: &Path) -> bool {
        head(path, 4096).is_ok_and(|head| {
            // A text follows its length, which has one byte or four.
            let contains = |key: &&&str| {
                let (key, n) = (key.as_bytes(), key.len() as u8);
                let at = |w: &[u8]| w[4..] == *key && (w[3] == n || w[..4] == [n, 0, 0, 0]);
                head.windows(4 + key.len()).any(at)
            };
            matches!(head[..], [0x80, 2..=5, ..])
                && !self.accompanies(path)
                && KEYS.iter().filter(contains).count() >= 2
        })
    }

    fn accompanies(&self, path: &Path) -> bool {
        INDEX_FILES.iter().any(|file| named(path, file))
    }

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        match frames {
            CurrentFrames::Every(step) => Ok(windows(path, step, length)),
            _ => single(self, path, frames, move |path, current| read(path, current, length)),
        }
    }

    fn count(&self, _path: &Path) -> Option<usize> {
        Some(1)
    }
}

/// Returns the windows of a recording: one every `step` frames, whose id gets its current frame.
fn windows(path: &Path, step: NonZeroUsize, length: LengthChoice) -> PendingScenarios {
    let frames = match frames(path) {
        Ok(frames) => frames,
        Err(error) => return Box::new(std::iter::once(Err(error))),
    };
    let path = path.to_owned();
    Box::new(length.windows(frames, step).map(move |current| {
        let path = path.clone();
        let decode = UndecodedScenario::new(move || {
            let mut scenario = read(&path, Some(current), length)?;
            scenario.id = format!("{}@{current}", scenario.id);
            Ok(scenario)
        });
        Ok(decode)
    }))
}

/// Reads the number of frames of a recording.
fn frames(path: &Path) -> Result<usize, FormatError> {
    let file = read_whole(path, MAX_FILE_SIZE, "one scenario")?;
    let pickle = parsed(path, &file)?;
    parts::frames(&pickle.root()).map_err(|cause| FormatError::record(path, 0, None, cause))
}

fn parsed<'a>(path: &Path, file: &'a [u8]) -> Result<Pickle<'a>, FormatError> {
    Pickle::read(file)
        .map_err(|e| FormatError::file(path, Cause::Undecodable(format!("as a pickle: {e}"))).at(0))
}

/// Reads a scenario with the frame `current` (counted from 0, with enough frames before it) as the current
/// one. `None` stands for the current frame stored in the file, or the first one with enough frames before it
/// if there is none. Missing frames after it are counted in the scenario's repairs.
fn read(path: &Path, current: Option<usize>, length: LengthChoice) -> Result<Scenario, FormatError> {
    let file = read_whole(path, MAX_FILE_SIZE, "one scenario")?;
    let pickle = parsed(path, &file)?;
    let root = pickle.root();
    let id = parts::id(&root).map_err(|cause| FormatError::record(path, 0, None, cause))?;
    let (parts, repairs) = parts::parts(&root, id.clone(), current, length)
        .map_err(|cause| FormatError::record(path, 0, Some(id), cause))?;
    let mut scenario = Scenario::assemble(parts).map_err(|e| FormatError::scene(path, 0, e))?;
    add_repairs(&mut scenario, repairs);
    Ok(scenario)
}
