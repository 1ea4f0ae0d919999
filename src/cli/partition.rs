//! Partitions of a command: processes work on one each, in a folder of its own.

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::output::{ExitStatus, count, lock_folder, note, say, write_result};
use crate::evaluation::{EvaluationError, differences};
use crate::files::FolderLock;
use crate::formats::Partition;

/// Name of the file that describes a finished partition.
const PARTITION: &str = "partition.json";
/// Identity of the file.
const FORMAT: &str = "reactsim-partition";
/// Version of the file.
const VERSION: u32 = 1;

/// Restriction of a command to a partition.
#[derive(Clone, Copy, Debug, Args)]
pub(super) struct PartitionArg {
    /// Work only on part I of N equal parts, and write a folder; `reactsim merge` joins the folders of all
    /// parts into the output of the whole
    #[arg(long, value_name = "I/N", requires = "out")]
    pub(super) partition: Option<Partition>,
}

/// A finished partition.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PartitionRecord {
    format: String,
    version: u32,
    partition: Partition,
    /// Arguments of the program.
    arguments: Vec<String>,
    /// Number of failures.
    failed: usize,
    /// Everything that determines the results, if no other file of the folder has it.
    subject: Value,
}

/// Creates and locks the folder of a partition.
pub(super) fn folder(out: &Path) -> anyhow::Result<FolderLock> {
    refuse_filled(out)?;
    lock_folder(out)
}

/// Refuses a folder that has files.
pub(super) fn refuse_filled(out: &Path) -> anyhow::Result<()> {
    if out.is_dir() && fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some()) {
        bail!("{} exists and is not empty; choose another folder, or remove it", out.display());
    }
    Ok(())
}

/// Marks the folder of a partition as finished.
pub(super) fn finish(
    folder: &Path,
    partition: Partition,
    failed: usize,
    subject: &impl Serialize,
) -> anyhow::Result<ExitStatus> {
    let record = PartitionRecord {
        format: FORMAT.to_owned(),
        version: VERSION,
        partition,
        arguments: env::args().skip(1).collect(),
        failed,
        subject: serde_json::to_value(subject)?,
    };
    let (path, text) = (folder.join(PARTITION), serde_json::to_string_pretty(&record)?);
    write_result(Some(&path), |out| writeln!(out, "{text}"))?;
    note(format_args!("partition {partition} is finished; next: reactsim merge FOLDERS --out PATH"));
    if failed > 0 {
        say(format_args!("warning: {failed} failed"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// The finished partitions of a command: each one there once, in their order.
pub(super) struct Partitions {
    pub(super) folders: Vec<PathBuf>,
    records: Vec<PartitionRecord>,
}

impl Partitions {
    /// Reads these folders.
    pub(super) fn read(folders: &[PathBuf]) -> anyhow::Result<Self> {
        let mut found: BTreeMap<Partition, (&PathBuf, PartitionRecord)> = BTreeMap::new();
        for folder in folders {
            let record = read(folder)?;
            let partition = record.partition;
            if let Some((first, (other, _))) = found.first_key_value()
                && first.count() != partition.count()
            {
                let (other, folder) = (other.display(), folder.display());
                bail!("{other} has partition {first}, and {folder} has partition {partition}");
            }
            if let Some((other, _)) = found.insert(partition, (folder, record)) {
                let (other, folder) = (other.display(), folder.display());
                bail!("partition {partition} is there twice: {other} and {folder}; leave one of them out");
            }
        }
        let all = found.keys().next().map_or(0, |partition| partition.count());
        let is_there: Vec<usize> = found.keys().map(|partition| partition.number()).collect();
        let missing = (1..=all).filter(|number| is_there.binary_search(number).is_err());
        let missing: Vec<String> = missing.map(|number| number.to_string()).collect();
        if !missing.is_empty() {
            let (n, first) = (count(missing.len(), "partition"), missing[..missing.len().min(10)].join(", "));
            bail!("{n} of {all} missing, among them {first}: give the folders of all partitions");
        }
        let (folders, records) = found.into_values().map(|(folder, record)| (folder.clone(), record)).unzip();
        Ok(Self { folders, records })
    }

    /// Returns the arguments with which the first partition was made.
    pub(super) fn arguments(&self) -> &[String] {
        self.records.first().map_or(&[], |record| &record.arguments)
    }

    /// Returns the number of failures of all partitions.
    pub(super) fn failed(&self) -> usize {
        self.records.iter().map(|record| record.failed).sum()
    }

    /// Returns what determines the results, which is the same for all partitions, except for what `unite`
    /// makes the same in two of them.
    pub(super) fn subject<S: Serialize + DeserializeOwned>(
        &self,
        unite: impl Fn(&mut S, &mut S),
    ) -> anyhow::Result<S> {
        let mut joined: Option<S> = None;
        for (path, record) in self.folders.iter().zip(&self.records) {
            let other = serde_json::from_value(record.subject.clone());
            let mut other =
                other.with_context(|| format!("{} is of another command", path.join(PARTITION).display()))?;
            let Some(joined) = &mut joined else {
                joined = Some(other);
                continue;
            };
            unite(joined, &mut other);
            if let Some(difference) = differences(joined, &other).into_iter().next() {
                return Err(EvaluationError::other_partition(path, &self.folders[0], difference).into());
            }
        }
        joined.context("no partition is given")
    }
}

fn read(folder: &Path) -> anyhow::Result<PartitionRecord> {
    let path = folder.join(PARTITION);
    let text = fs::read_to_string(&path).with_context(|| {
        format!("{} has no finished partition: run it with --partition", folder.display())
    })?;
    let record: PartitionRecord =
        serde_json::from_str(&text).with_context(|| format!("{} is damaged", path.display()))?;
    if (record.format.as_str(), record.version) != (FORMAT, VERSION) {
        bail!("{} is of another version of the program: run the partition again", path.display());
    }
    Ok(record)
}
