//! The Waymo Open Motion Dataset: `Scenario` messages in TFRecord files, plain, gzip or zstd.

pub(super) mod message;
mod parts;
pub(super) mod record;
pub(super) mod size;

use std::path::{Path, PathBuf};

use prost::Message;
use reactsim_files::name_of;
use reactsim_scene::Scenario;

use self::message::Scenario as Proto;
use self::record::Records;
use super::error::{Cause, FormatError};
use super::format::{
    PendingScenarios, ScenarioFormat, Scenarios, UNRECORDED_FRAMES, UndecodedScenario, is_parquet, named,
};

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

    fn open(&self, path: &Path) -> Result<Scenarios, FormatError> {
        Ok(Box::new(Reader::open(path)?.map(|record| record.and_then(|decode| decode()))))
    }

    fn open_undecoded(&self, path: &Path) -> Result<PendingScenarios, FormatError> {
        Ok(Box::new(Reader::open(path)?))
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
    /// Index of the next record.
    next: u64,
}

impl Reader {
    fn open(path: &Path) -> Result<Self, FormatError> {
        Ok(Self { path: path.to_owned(), records: Records::open(path)?, next: 0 })
    }
}

impl Iterator for Reader {
    type Item = Result<UndecodedScenario, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        let payload = self.records.next()?.map(<[u8]>::to_vec);
        let (path, record) = (self.path.clone(), self.next);
        self.next += 1;
        Some(payload.map(|payload| Box::new(move || read_one(&path, record, &payload)) as UndecodedScenario))
    }
}

fn read_one(path: &Path, record: u64, payload: &[u8]) -> Result<Scenario, FormatError> {
    size::check(payload).map_err(|cause| FormatError::record(path, record, None, cause))?;
    let proto = Proto::decode(payload)
        .map_err(|e| FormatError::record(path, record, None, Cause::Undecodable(e.to_string())))?;
    let id = proto.scenario_id.clone();
    let (parts, missing) =
        parts::parts(proto).map_err(|cause| FormatError::record(path, record, Some(id), cause))?;
    let mut scenario = Scenario::assemble(parts).map_err(|e| FormatError::scene(path, record, e))?;
    if missing > 0 {
        scenario.repairs.insert(UNRECORDED_FRAMES.into(), missing);
    }
    Ok(scenario)
}

#[cfg(test)]
mod tests;
