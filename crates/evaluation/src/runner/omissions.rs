//! Scenarios that a run leaves out, and names for which there is no scenario.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::plan::Plan;
use crate::source::selection::Selection;
use crate::summary::SummaryProvenance;

/// Scenarios left out, and the named ones that were read, from which follows which ones were not.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Omissions {
    /// Number of scenarios that the file of deviations does not name.
    pub(crate) passed_over: usize,
    /// Number of scenarios that are not selected.
    pub(crate) unselected: usize,
    /// Ids in the selection that scenarios have.
    found: BTreeSet<String>,
    /// Ids in the file of deviations that scenarios have.
    deviated: BTreeSet<String>,
    /// Number of deviations in the file whose scenarios are selected by id.
    pub(crate) deviations: usize,
}

impl Omissions {
    /// Notes ids of scenarios that were read and are selected by id.
    pub(crate) fn read<'a>(&mut self, plan: &Plan, ids: impl IntoIterator<Item = &'a String>) {
        let (selected, deviations) = (&plan.selection.ids, plan.deviations.as_ref());
        for id in ids {
            if selected.contains(id) {
                self.found.insert(id.clone());
            }
            if deviations.is_some_and(|d| d.tracks.contains_key(id)) {
                self.deviated.insert(id.clone());
            }
        }
    }

    /// Adds what another partition of the run left out.
    pub(crate) fn add(&mut self, other: Self) {
        self.passed_over += other.passed_over;
        self.unselected += other.unselected;
        self.found.extend(other.found);
        self.deviated.extend(other.deviated);
        self.deviations = other.deviations;
    }

    /// Writes to a summary what was left out.
    pub(crate) fn describe(&self, summary: &mut SummaryProvenance) {
        let selection: &Selection = &summary.run.settings.selection;
        summary.missing_ids = selection.ids.difference(&self.found).cloned().collect();
        summary.passed_over = self.passed_over;
        summary.unselected = self.unselected;
        summary.unused_deviations = self.deviations.saturating_sub(self.deviated.len());
    }
}
