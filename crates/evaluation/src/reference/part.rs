//! Results of a reference by part: all scenarios, or those of one category or difficulty.

use std::collections::BTreeMap;

use super::{Reference, ReferenceError};
use crate::folder::tally_of;
use crate::row::Row;
use crate::summary::{CategorySummary, Summary};

/// A part of the scenarios.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Part {
    /// All scenarios.
    #[default]
    All,
    /// Scenarios with a deviation of this category.
    Category(String),
    /// Scenarios of this difficulty.
    Difficulty(String),
}

impl Reference {
    /// Returns the results by simulator in a part of the scenarios.
    ///
    /// # Errors
    /// [`ReferenceError`] if no scenario is in this part, or if it is unknown because the reference has no
    /// rows.
    pub fn part(&self, part: &Part) -> Result<BTreeMap<String, CategorySummary>, ReferenceError> {
        let unfit = |reason: String| ReferenceError::unfit(&self.place, reason);
        let simulators = self.summary.simulators.iter();
        let found: BTreeMap<String, CategorySummary> = match part {
            Part::All => simulators
                .map(|(id, s)| {
                    (id.clone(), CategorySummary { scenarios: s.scenarios, metrics: s.metrics.clone() })
                })
                .collect(),
            Part::Category(name) => simulators
                .filter_map(|(id, s)| Some((id.clone(), s.by_category.get(name)?.clone())))
                .collect(),
            Part::Difficulty(name) => {
                let Some(rows) = &self.rows else {
                    return Err(unfit("it has no rows, so results by difficulty are unknown".to_owned()));
                };
                let of_part = |row: &&Row| row.difficulty.as_deref() == Some(name);
                let rows: Vec<Row> = rows.iter().filter(of_part).cloned().collect();
                let (tally, _) = tally_of(&self.provenance, &rows);
                let summary = Summary::new(&tally, &[], &self.provenance);
                let with_result = summary.simulators.into_iter().filter(|(_, s)| s.scenarios > 0);
                with_result
                    .map(|(id, s)| (id, CategorySummary { scenarios: s.scenarios, metrics: s.metrics }))
                    .collect()
            }
        };
        match (found.is_empty(), part) {
            (true, Part::Category(name)) => Err(unfit(format!("no scenario has the category `{name}`"))),
            (true, Part::Difficulty(name)) => Err(unfit(format!("no scenario has the difficulty `{name}`"))),
            _ => Ok(found),
        }
    }
}
