//! The Waymo Open Motion Dataset: `Scenario` messages in TFRecord files, plain, gzip or zstd.

mod example;
pub(super) mod message;
mod parts;
pub(super) mod record;
pub(super) mod window;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use reactsim_files::name_of;
use reactsim_scene::{LATER_FRAME, Scenario};

use self::message::Scenario as Proto;
use self::record::Records;
use self::window::Window;
use super::error::FormatError;
use super::format::{
    PendingScenarios, ScenarioFormat, UNRECORDED_FRAMES, UndecodedScenario, add_repairs, is_parquet, named,
};
use super::frames::{CurrentFrames, LengthChoice};

/// The format of the Waymo Open Motion Dataset.
pub(super) struct Womd;

impl ScenarioFormat for Womd {
    fn id(&self) -> &'static str {
        "womd"
    }

    fn title(&self) -> &'static str {
        "Waymo Open Motion Dataset, TFRecord, plain, gzip or zstd"
    }

    fn recognises(&self, path: &Path) -> bool {
        !is_parquet(path).unwrap_or(false) && (Records::starts(path) || has_tfrecord_name(path))
    }

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        Ok(Box::new(Reader::open(path, frames, length)?))
    }

    fn count(&self, path: &Path) -> Option<usize> {
        record::count(path)
    }
}

/// Returns whether a file is named like a TFRecord: `x.tfrecord`, `x.tfrecord.gz`, `x.tfrecord.zst`,
/// `x.tfrecord-00003-of-01000`.
fn has_tfrecord_name(path: &Path) -> bool {
    let shard = |name: &str| {
        let number = name.split_once(".tfrecord-").map(|(_, number)| number);
        number.is_some_and(|n| n.chars().all(|c| c.is_ascii_digit() || "-of".contains(c)))
    };
    [".tfrecord", ".tfrecord.gz", ".tfrecord.zst"].iter().any(|end| named(path, end)) || shard(&name_of(path))
}

struct Reader {
    path: PathBuf,
    records: Records,
    frames: CurrentFrames,
    length: LengthChoice,
    /// Index of the next record.
    next: u64,
    /// Further windows of the record that was read last.
    windows: VecDeque<UndecodedScenario>,
}

impl Reader {
    fn open(path: &Path, frames: CurrentFrames, length: LengthChoice) -> Result<Self, FormatError> {
        let (records, path) = (Records::open(path)?, path.to_owned());
        Ok(Self { path, records, frames, length, next: 0, windows: VecDeque::new() })
    }
}

impl Iterator for Reader {
    type Item = Result<UndecodedScenario, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(window) = self.windows.pop_front() {
            return Some(Ok(window));
        }
        let record = self.next;
        self.next += 1;
        let payload = match self.records.take_next()? {
            Ok(payload) => Arc::new(payload),
            Err(error) => return Some(Err(error)),
        };
        let read = |window: Window| -> UndecodedScenario {
            let (path, payload, length) = (self.path.clone(), Arc::clone(&payload), self.length);
            UndecodedScenario::new(move || read_one(&path, record, &payload, window, length))
        };
        match self.frames {
            CurrentFrames::Stated => Some(Ok(read(Window::Stated))),
            CurrentFrames::At(frame) => Some(Ok(read(Window::At(frame)))),
            CurrentFrames::Every(step) => {
                self.windows = Window::every(step, self.length, &payload).map(read).collect();
                self.windows.pop_front().map(Ok)
            }
        }
    }
}

fn read_one(
    path: &Path,
    record: u64,
    payload: &[u8],
    window: Window,
    length: LengthChoice,
) -> Result<Scenario, FormatError> {
    let decoded = Proto::decode(payload);
    let mut proto = decoded.map_err(|cause| FormatError::record(path, record, None, cause))?;
    let id = proto.scenario_id.clone();
    let refuse = |cause| FormatError::record(path, record, Some(id.clone()), cause);
    let (length, later) = window.crop(&mut proto, length).map_err(refuse)?;
    let (parts, missing) = parts::parts(proto, length).map_err(refuse)?;
    let mut scenario = Scenario::assemble(parts).map_err(|e| FormatError::scene(path, record, e))?;
    add_repairs(&mut scenario, [(UNRECORDED_FRAMES, missing), (LATER_FRAME, later as u32)]);
    Ok(scenario)
}

#[cfg(test)]
mod tests;
