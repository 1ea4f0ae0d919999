//! The plan of a run in units.

use std::fs;
use std::io;
use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::error::ShardError;
use crate::evaluation::folder::{cannot_write, replace};
use crate::evaluation::{Plan, Provenance, RecordRange, Source};

/// Name of the file with the plan.
pub const SHARD_PLAN: &str = "plan.json";
/// Identity of the file.
const FORMAT: &str = "reactsim-shards";
/// Version of the file.
const VERSION: u32 = 1;

/// A run that is divided into units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardPlan {
    format: String,
    version: u32,
    /// Arguments of the program for the run, its command first.
    pub arguments: Vec<String>,
    /// Provenance of the run.
    pub provenance: Provenance,
    /// Number of deviations in the file whose scenarios are selected by id.
    pub(super) deviations: usize,
    /// The units, in the order of the records.
    pub units: Vec<Unit>,
}

/// A unit: consecutive records of one input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unit {
    /// Digest of the provenance of the run and of the range, 64 hexadecimal digits.
    pub key: String,
    /// The records.
    #[serde(flatten)]
    pub range: RecordRange,
}

impl ShardPlan {
    /// Divides a run into units of this many records, or fewer at the end of a file. All files are read
    /// through once to count their records. `arguments` are those of the program for the run.
    ///
    /// # Errors
    /// [`ShardError::DividedBatch`] if units would divide batches of an external simulator.
    pub fn of(plan: &Plan, arguments: Vec<String>, records: usize) -> Result<Self, ShardError> {
        for simulator in &plan.simulators {
            let Some(batch) = simulator.batch().filter(|batch| !records.is_multiple_of(*batch)) else {
                continue;
            };
            return Err(ShardError::DividedBatch { simulator: simulator.id.clone(), batch, records });
        }
        let provenance = plan.provenance();
        let identity = serde_json::to_string(&provenance).expect("provenance is text and numbers");
        let counts: Vec<usize> = plan.sources.par_iter().map(count).collect();
        let mut units = Vec::new();
        for (input, all) in counts.into_iter().enumerate() {
            let of = |first: usize| {
                let range = RecordRange { input, first, count: records.min(all - first) };
                Unit { key: key(&identity, range), range }
            };
            units.extend((0..all).step_by(records.max(1)).map(of));
        }
        let deviations = plan.selected_deviations();
        Ok(Self { format: FORMAT.to_owned(), version: VERSION, arguments, provenance, deviations, units })
    }

    /// Writes the plan to a folder, which is created if it does not exist.
    ///
    /// # Errors
    /// [`ShardError`] if the folder has a plan already or cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), ShardError> {
        let path = folder.join(SHARD_PLAN);
        if path.exists() {
            return Err(ShardError::Planned { path });
        }
        fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        let mut text = serde_json::to_string_pretty(self).expect("a plan is text and numbers");
        text.push('\n');
        Ok(replace(&path, |out| out.write_all(text.as_bytes()))?)
    }

    /// Reads the plan in a folder.
    ///
    /// # Errors
    /// [`ShardError`] if there is none, or if it is damaged or of another version of the program.
    pub fn read(folder: &Path) -> Result<Self, ShardError> {
        let path = folder.join(SHARD_PLAN);
        let text = fs::read_to_string(&path).map_err(|source| match source.kind() {
            io::ErrorKind::InvalidData => {
                ShardError::BadPlan { path: path.clone(), reason: "it is not text".to_owned() }
            }
            _ => ShardError::NoPlan { path: path.clone(), source },
        })?;
        let bad = |reason: String| ShardError::BadPlan { path: path.clone(), reason };
        let plan: Self = serde_json::from_str(&text).map_err(|e| bad(e.to_string()))?;
        if (plan.format.as_str(), plan.version) != (FORMAT, VERSION) {
            return Err(bad(format!("it is {} version {}", plan.format, plan.version)));
        }
        let identity = serde_json::to_string(&plan.provenance).expect("provenance is text and numbers");
        let mut before = None;
        for (number, unit) in plan.units.iter().enumerate() {
            if unit.key != key(&identity, unit.range) {
                return Err(bad(format!("the key of unit {number} is not that of its records")));
            }
            let follows = before
                .is_none_or(|b: RecordRange| (b.input, b.end()) <= (unit.range.input, unit.range.first));
            if !follows || unit.range.input >= plan.provenance.inputs.len() || unit.range.count == 0 {
                return Err(bad(format!("unit {number} is out of order or empty")));
            }
            before = Some(unit.range);
        }
        Ok(plan)
    }

    /// Returns a unit by its number.
    ///
    /// # Errors
    /// [`ShardError::NoUnit`].
    pub fn unit(&self, number: usize) -> Result<&Unit, ShardError> {
        self.units.get(number).ok_or(ShardError::NoUnit { unit: number, count: self.units.len() })
    }

    /// Checks that a run is the planned one, as far as records of this input are concerned.
    pub(super) fn check(&self, input: usize, plan: &Plan) -> Result<(), ShardError> {
        let mut now = plan.provenance();
        for (index, planned) in self.provenance.inputs.iter().enumerate().filter(|(i, _)| *i != input) {
            if let Some(other) = now.inputs.get_mut(index) {
                other.clone_from(planned);
            }
        }
        match self.provenance.difference(&now) {
            None => Ok(()),
            Some((setting, planned, now)) => Err(ShardError::OtherRun { setting, planned, now }),
        }
    }

    /// Returns the number of records of all units.
    pub fn records(&self) -> usize {
        self.units.iter().map(|unit| unit.range.count).sum()
    }
}

/// Returns the number of records of a source, as a run counts them: a damaged record is one too. A file that
/// cannot be opened has one, so that its unit reports the reason.
fn count(source: &Source) -> usize {
    (source.open)(0).map_or(1, Iterator::count)
}

/// Returns the key of a range of records of the run with this provenance.
fn key(provenance: &str, range: RecordRange) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(provenance.as_bytes());
    let RecordRange { input, first, count } = range;
    hasher.update(format!("\n{input} {first} {count}\n").as_bytes());
    hasher.finalize().to_hex().to_string()
}
