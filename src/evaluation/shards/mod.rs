//! Runs divided into units, for clusters: planned once, carried out anywhere in any order, merged into the
//! run folder that one machine would have written, byte for byte.
//!
//! A folder of units contains
//!
//! - `plan.json`: the arguments of the run, its provenance, and the units ([`ShardPlan`])
//! - `unit-<number>-<key>/`: results of a finished unit ([`UnitRecord`] and the files of a run)
//! - `partial-<key>-…/`: what a process is writing, or has left when it was killed
//!
//! A unit is a range of records of one file. Its key is the digest of the run's provenance and of the range,
//! so that results of another plan cannot be mistaken for its own. A unit is written to a folder of its own,
//! which is renamed when it is complete: results are there as a whole or not at all, and of two processes
//! that carry out the same unit the first one wins.

mod error;
mod merge;
mod plan;
mod sample;
mod unit;

pub use error::ShardError;
pub use merge::{Merged, merge};
pub use plan::{SHARD_PLAN, ShardPlan, Unit};
pub use sample::SampleResults;
pub use unit::{UnitOutcome, UnitRecord, UnitWorker};
