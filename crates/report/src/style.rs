//! The content and the appearance of a table.

use super::Run;
use super::table::Column;

/// Choice of columns and presentation, for all formats that have them.
#[derive(Clone, Copy, Debug, Default)]
pub struct TableStyle<'a> {
    /// The columns; empty for the usual ones.
    pub columns: &'a [Column],
    /// Columns in addition.
    pub also: &'a [Column],
    /// Whether the best numbers among comparable runs are bold.
    pub bold: bool,
    /// Caption of a LaTeX table; `None` for the usual one.
    pub caption: Option<&'a str>,
    /// Label of a LaTeX table.
    pub label: Option<&'a str>,
}

impl TableStyle<'_> {
    /// Returns the columns of a table over these runs.
    pub(super) fn columns_of(&self, runs: &[Run<'_>]) -> Vec<Column> {
        let used = || Column::used(&runs.iter().map(|run| run.summary).collect::<Vec<_>>(), self.also);
        self.chosen().unwrap_or_else(used)
    }

    /// Returns the chosen columns and those in addition; `None` for the usual ones.
    pub(super) fn chosen(&self) -> Option<Vec<Column>> {
        (!self.columns.is_empty()).then(|| Column::with(self.columns.to_vec(), self.also))
    }

    /// Returns whether a metric was chosen, for formats that otherwise hold every metric.
    pub(super) fn has(&self, metric: &str) -> bool {
        self.columns.is_empty() || self.columns.iter().chain(self.also).any(|c| c.metric == metric)
    }
}
