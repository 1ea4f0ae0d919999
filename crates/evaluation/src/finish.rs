//! Completion of a run folder.

use super::folder::{RunFolder, SUMMARY};
use super::row::Failure;
use super::summary::Summary;
use super::tally::Tally;
use super::{EvaluationError, long_tables, rollouts};

/// Sorts rows and events and writes them as tables, joins the rollouts if they are kept, and writes the
/// summary, whose existence marks the folder as finished.
pub(super) fn finish(
    folder: &RunFolder,
    tally: &Tally,
    failures: &[Failure],
    summary: &Summary,
    keep_rollouts: bool,
) -> Result<(), EvaluationError> {
    folder.finish(tally, failures)?;
    long_tables::write(folder.path())?;
    if keep_rollouts {
        rollouts::join_parts(folder, tally)?;
    }
    folder.put(SUMMARY, &summary.to_json())?;
    folder.remove_parts()
}
