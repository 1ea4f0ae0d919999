//! Work divided into units, for clusters: planned once, carried out anywhere in any order, merged into the
//! results that one machine would have written, byte for byte.
//!
//! A folder of units contains
//!
//! - `plan.json`: the arguments of the program, what determines the results, and the units ([`ShardPlan`])
//! - `unit-<number>-<key>/`: a finished unit: [`UnitRecord`] and the folder `results`
//! - `partial-<key>-…/`: what a process is writing, or has left when it was killed
//!
//! A unit is a range of records of one input. Its key is the digest of the subject of the plan and of the
//! range, so that results of another plan cannot be mistaken for its own. A unit is written to a folder of
//! its own, which is renamed when it is complete: results are there as a whole or not at all, and of two
//! processes that carry out the same unit the first one wins.
//!
//! This module knows plans and folders; [`Work`] is what a command does with records.

mod error;
mod finished;
mod leaves;
mod plan;
mod range;
mod sample;
mod unit;
mod work;

pub use error::ShardError;
pub use finished::{FinishedUnit, FinishedUnits};
pub use leaves::{differences, leaves};
pub use plan::{SHARD_PLAN, ShardPlan, Unit};
pub use range::RecordRange;
pub use sample::SampleResults;
pub use unit::{UnitOutcome, UnitRecord, UnitWorker};
pub use work::{UnitResults, Work};
