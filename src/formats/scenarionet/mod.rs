//! The pickles of ScenarioNet: one scenario each, of Waymo, nuPlan, nuScenes or Argoverse 2. Told in `scenarios/README.md`.

mod ground;
mod lights;
mod map;
mod parts;
mod pickle;
mod tracks;

use std::path::{Path, PathBuf};

use self::pickle::Pickle;
use super::error::{Cause, FormatError};
use super::format::{PendingScenarios, ScenarioFormat, Scenarios, Undecoded, head, named, read_whole};
use crate::scene::Scenario;

/// Longest file that is read: one of the largest scenarios has some megabytes.
const LONGEST: u64 = 1 << 27;
/// Keys of a scenario; of those at the beginning of a file some are here.
const KEYS: &[&str] = &["tracks", "map_features", "dynamic_map_states", "metadata", "version", "length"];
/// What lies beside the scenarios of a data set.
const LISTS: &[&str] = &["dataset_summary.pkl", "dataset_mapping.pkl"];

/// The format.
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
            // A text stands behind its length, in one byte or four.
            let says = |key: &&&str| {
                let (key, n) = (key.as_bytes(), key.len() as u8);
                let at = |w: &[u8]| w[4..] == *key && (w[3] == n || w[..4] == [n, 0, 0, 0]);
                head.windows(4 + key.len()).any(at)
            };
            matches!(head[..], [0x80, 2..=5, ..])
                && !self.accompanies(path)
                && KEYS.iter().filter(says).count() >= 2
        })
    }

    fn accompanies(&self, path: &Path) -> bool {
        LISTS.iter().any(|list| named(path, list))
    }

    fn open(&self, path: &Path) -> Result<Scenarios, FormatError> {
        let scenario = read(path, None)?;
        Ok(Box::new(std::iter::once(Ok(scenario))))
    }

    fn open_undecoded(&self, path: &Path) -> Result<PendingScenarios, FormatError> {
        let path: PathBuf = path.to_owned();
        let decode: Undecoded = Box::new(move || read(&path, None));
        Ok(Box::new(std::iter::once(Ok(decode))))
    }

    fn read_at(&self, path: &Path, current_frame: usize) -> Result<Scenario, FormatError> {
        read(path, Some(current_frame))
    }
}

/// Reads a scenario of which the frame `current` (from 10 on, counted from 0) is the current one; none asks for the frame that the file calls
/// so, and frame 10 where it calls none. What lacks of the 80 frames after it is counted in the scenario's repairs.
fn read(path: &Path, current: Option<usize>) -> Result<Scenario, FormatError> {
    let file = read_whole(path, LONGEST, "one scenario")?;
    let pickle = Pickle::read(&file)
        .map_err(|e| FormatError::file(path, Cause::Undecodable(format!("as a pickle: {e}"))).at(0))?;
    let root = pickle.root();
    let id = parts::id(&root).map_err(|cause| FormatError::record(path, 0, None, cause))?;
    let read = parts::parts(&root, id.clone(), current)
        .map_err(|cause| FormatError::record(path, 0, Some(id), cause))?;
    let mut scenario = Scenario::assemble(read.parts).map_err(|e| FormatError::scene(path, 0, e))?;
    for (what, count) in read.repairs {
        *scenario.repairs.entry(what.to_owned()).or_default() += count;
    }
    Ok(scenario)
}
