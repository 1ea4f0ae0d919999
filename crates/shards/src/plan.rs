//! The plan of work in units.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::Path;

use reactsim_files::{lock_folder, replace};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::error::{ShardError, cannot_write};
use super::leaves::differences;
use super::range::RecordRange;

/// Name of the file with the plan.
pub const SHARD_PLAN: &str = "plan.json";
/// Identity of the file.
const FORMAT: &str = "reactsim-shards";
/// Version of the file.
const VERSION: u32 = 2;

/// Work that is divided into units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardPlan {
    format: String,
    version: u32,
    /// Arguments of the program for the whole work, its command first.
    pub arguments: Vec<String>,
    /// Everything that determines the results: settings, and the digests of inputs.
    subject: Value,
    /// The units, in the order of the results.
    pub units: Vec<Unit>,
}

/// A unit: consecutive records of one input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unit {
    /// Digest of the subject of the plan and of the range, 64 hexadecimal digits.
    pub key: String,
    /// Index of the part of the work, such as the member of a study.
    #[serde(default, skip_serializing_if = "is_first")]
    pub part: usize,
    /// The records.
    #[serde(flatten)]
    pub range: RecordRange,
}

impl Unit {
    /// Takes the planned records of all inputs but that of this unit for the present ones: other units report
    /// changes of their inputs.
    pub fn trust_other_inputs<T: Clone>(&self, planned: &[T], now: &mut [T]) {
        let inputs = now.iter_mut().zip(planned).enumerate();
        for (_, (now, planned)) in inputs.filter(|(index, _)| *index != self.range.input) {
            now.clone_from(planned);
        }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde requires this signature")]
fn is_first(part: &usize) -> bool {
    *part == 0
}

impl ShardPlan {
    /// Plans a unit for every range of every part. `arguments` are those of the program for the whole work,
    /// `subject` is everything that determines the results.
    ///
    /// # Errors
    /// [`ShardError::Work`] if the subject cannot be written as JSON.
    pub fn new(
        arguments: Vec<String>,
        subject: &impl Serialize,
        ranges: impl IntoIterator<Item = (usize, RecordRange)>,
    ) -> Result<Self, ShardError> {
        let subject = serde_json::to_value(subject).map_err(ShardError::work)?;
        let identity = subject.to_string();
        let unit = |(part, range)| Unit { key: key(&identity, part, range), part, range };
        let units = ranges.into_iter().map(unit).collect();
        Ok(Self { format: FORMAT.to_owned(), version: VERSION, arguments, subject, units })
    }

    /// Plans work of one part, whose inputs have these numbers of records, in units of `records` records, or
    /// fewer at the end of an input.
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn divide(
        arguments: Vec<String>,
        subject: &impl Serialize,
        counts: &[usize],
        records: usize,
    ) -> Result<Self, ShardError> {
        Self::new(arguments, subject, RecordRange::divide(counts, records).map(|range| (0, range)))
    }

    /// Writes the plan to a folder, which is created if it does not exist.
    ///
    /// # Errors
    /// [`ShardError`] if the folder has a plan already or cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), ShardError> {
        let path = folder.join(SHARD_PLAN);
        let refuse_planned = || match path.exists() {
            true => Err(ShardError::Planned { path: path.clone() }),
            false => Ok(()),
        };
        refuse_planned()?;
        fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        // Of two that plan at the same time the second finds the plan of the first.
        let _lock = lock_folder(folder).map_err(cannot_write(folder))?;
        refuse_planned()?;
        let mut text = serde_json::to_string_pretty(self).map_err(ShardError::work)?;
        text.push('\n');
        replace(&path, |out| out.write_all(text.as_bytes())).map_err(cannot_write(&path))
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
        let identity = plan.subject.to_string();
        let mut before = (0, 0, 0);
        for (number, unit) in plan.units.iter().enumerate() {
            let Unit { part, range, .. } = *unit;
            if unit.key != key(&identity, part, range) {
                return Err(bad(format!("the key of unit {number} is not that of its records")));
            }
            if (part, range.input, range.first) < before || range.count == 0 {
                return Err(bad(format!("unit {number} is out of order or empty")));
            }
            before = (part, range.input, range.end());
        }
        Ok(plan)
    }

    /// Returns everything that determines the results, as the command of the plan describes it.
    ///
    /// # Errors
    /// [`ShardError::OtherSubject`] if it is not of this command.
    pub fn subject<S: DeserializeOwned>(&self) -> Result<S, ShardError> {
        serde_json::from_value(self.subject.clone()).map_err(|source| ShardError::OtherSubject { source })
    }

    /// Checks that work with this subject is the planned one.
    ///
    /// # Errors
    /// [`ShardError::OtherWork`] names the first setting that differs.
    pub fn check(&self, now: &impl Serialize) -> Result<(), ShardError> {
        let now = serde_json::to_value(now).map_err(ShardError::work)?;
        match differences(&self.subject, &now).into_iter().next() {
            None => Ok(()),
            Some((setting, planned, now)) => Err(ShardError::OtherWork { setting, planned, now }),
        }
    }

    /// Returns a unit by its number.
    ///
    /// # Errors
    /// [`ShardError::NoUnit`].
    pub fn unit(&self, number: usize) -> Result<&Unit, ShardError> {
        self.units.get(number).ok_or(ShardError::NoUnit { unit: number, count: self.units.len() })
    }

    /// Returns the inputs of some units, by index.
    ///
    /// # Errors
    /// [`ShardError::NoUnit`].
    pub fn inputs_of(&self, units: &[usize]) -> Result<BTreeSet<usize>, ShardError> {
        units.iter().map(|number| self.unit(*number).map(|unit| unit.range.input)).collect()
    }

    /// Returns the number of records of all units.
    pub fn records(&self) -> usize {
        self.units.iter().map(|unit| unit.range.count).sum()
    }
}

/// Returns the key of a range of records of a part of the work with this subject.
fn key(subject: &str, part: usize, range: RecordRange) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(subject.as_bytes());
    let RecordRange { input, first, count } = range;
    hasher.update(format!("\n{part} {input} {first} {count}\n").as_bytes());
    hasher.finalize().to_hex().to_string()
}
