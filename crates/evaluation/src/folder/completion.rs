//! Completion of a run folder.

use crate::error::EvaluationError;
use crate::folder::RunFolder;
use crate::folder::{long_tables, rollouts};
use crate::layout::SUMMARY;
use crate::row::Failure;
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// Sorts rows and events and writes them as tables, joins the rollouts if they are kept, and writes the
/// summary, whose existence marks the folder as finished.
pub(crate) fn complete(
    folder: &RunFolder,
    tally: &Tally,
    failures: &[Failure],
    summary: &Summary,
    keep_rollouts: bool,
) -> Result<(), EvaluationError> {
    folder.finish(tally, failures)?;
    long_tables::write(folder.path(), &tally.metrics)?;
    if keep_rollouts {
        rollouts::join_parts(folder, tally)?;
    }
    folder.put(SUMMARY, &summary.to_json())?;
    folder.remove_parts()
}
