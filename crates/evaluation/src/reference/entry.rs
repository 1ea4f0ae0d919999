//! Entries of a leaderboard: references, and submitted run folders.

use std::path::Path;

use serde::Serialize;

use super::{Reference, ReferenceError, check_values, rescore};
use crate::folder::{read_provenance, read_rows, read_summary};
use crate::layout::REFERENCE_RECORD;
use crate::provenance::Provenance;
use crate::provenance::leaves::differences;
use crate::source::Source;
use crate::source::benchmarks::BenchmarkRecord;
use crate::summary::Summary;

/// A run in a leaderboard.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Name of the entry and its folder.
    pub name: String,
    /// Benchmark.
    pub benchmark: BenchmarkRecord,
    /// Result.
    pub summary: Summary,
    /// Degree of verification.
    pub status: Status,
}

/// The degree to which the numbers of an entry were verified, the best one first. For all entries the rows
/// give the summary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// A reference whose files have the recorded digests.
    Reference,
    /// A run whose kept rollouts reproduce its rows.
    Verified,
    /// A run without rollouts, or on scenarios that are not available.
    Unverified,
}

impl Status {
    /// Returns the name used in tables and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Verified => "verified",
            Self::Unverified => "unverified",
        }
    }
}

impl Entry {
    /// Reads an entry: a reference, or a finished run folder. `scenarios` opens the file of a benchmark if it
    /// is available, to score kept rollouts again.
    ///
    /// # Errors
    /// [`ReferenceError`] for an entry that is unfinished, on no known benchmark or on a part of one, that
    /// has failures, whose rows do not give its summary, or whose rollouts do not reproduce its rows.
    pub fn read(
        folder: &Path,
        name: String,
        scenarios: impl Fn(&BenchmarkRecord) -> Option<Source>,
    ) -> Result<Self, ReferenceError> {
        let place = folder.display().to_string();
        let whole = |provenance: &Provenance| match &provenance.benchmark {
            Some(benchmark) if benchmark.known().is_some() => Ok(benchmark.clone()),
            Some(benchmark) => {
                let digest = &benchmark.blake3;
                let reason = format!("this program does not know the benchmark {benchmark} ({digest})");
                Err(ReferenceError::unfit(&place, reason))
            }
            None => {
                let reason = "the run is on no known benchmark, or on a part of one";
                Err(ReferenceError::unfit(&place, reason))
            }
        };
        if folder.join(REFERENCE_RECORD).exists() {
            let reference = Reference::open(folder)?;
            let benchmark = whole(&reference.provenance)?;
            return Ok(Self { name, benchmark, summary: reference.summary, status: Status::Reference });
        }
        let (mut summary, provenance) = (read_summary(folder)?, read_provenance(folder)?);
        let benchmark = whole(&provenance)?;
        check_values(&place, &provenance, &summary, Some(&read_rows(folder)?))?;
        let scored = match scenarios(&benchmark) {
            Some(source) => rescore(folder, &[source])?,
            None => None,
        };
        // Only metrics of the benchmark can be verified and compared.
        summary.provenance.run.own_metrics.clear();
        let status = if scored.is_some() { Status::Verified } else { Status::Unverified };
        Ok(Self { name, benchmark, summary, status })
    }

    /// Checks that two entries are comparable: of the same benchmark, with the same settings.
    ///
    /// # Errors
    /// [`ReferenceError`] names the difference.
    pub fn check_comparable(&self, first: &Self) -> Result<(), ReferenceError> {
        let (own, of_first) = (&self.summary.provenance.run, &first.summary.provenance.run);
        let refuse = |field: &str, stated: String, found: String| {
            let place = &first.name;
            let reason = format!(
                "`{field}` is {found}, and {stated} in {place}: they cannot be compared in one table"
            );
            Err(ReferenceError::unfit(&self.name, reason))
        };
        if self.benchmark != first.benchmark {
            let text = |b: &BenchmarkRecord| format!("{b} ({:.12})", b.blake3);
            return refuse("benchmark", text(&first.benchmark), text(&self.benchmark));
        }
        let settings = differences(&of_first.settings, &own.settings).into_iter();
        let options = differences(&of_first.metric_options, &own.metric_options).into_iter();
        match settings.chain(options).next() {
            Some((field, stated, found)) => refuse(&field, stated, found),
            None => Ok(()),
        }
    }
}
