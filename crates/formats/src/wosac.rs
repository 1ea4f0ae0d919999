//! Files of the Waymo Open Sim Agents Challenge: recorded scenarios as its metrics read them ([`WosacLogs`]),
//! and submissions ([`SubmissionReader`], [`SubmissionWriter`]). One scenario is in memory at a time.

mod archive;
mod check;
mod log;
mod metadata;
mod rollouts;
mod shards;
mod stream;
mod submission;
mod writer;

pub use check::SubmissionCheck;
pub use log::WosacLogs;
pub use metadata::SubmissionMetadata;
pub use rollouts::{decode_rollouts, encode_rollouts, read_rollouts};
pub use submission::{SubmissionReader, SubmittedRollouts};
pub use writer::SubmissionWriter;

#[cfg(test)]
mod tests;
