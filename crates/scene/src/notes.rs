//! Properties of a scenario that readers of its results must be told.

use std::collections::BTreeMap;

use super::Scenario;

/// Counts by description, e.g. `agents whose velocity is unknown`.
pub type Notes = BTreeMap<&'static str, u32>;

/// Counts one property of a scenario; the property is noted unless the count is 0.
type Note = (&'static str, fn(&Scenario) -> u32);

/// All properties that are noted.
const NOTES: [Note; 0] = [];

impl Scenario {
    /// Returns what readers of results of this scenario must be told, with counts. Most scenarios have no
    /// notes. They are computed at the first call.
    pub fn notes(&self) -> &Notes {
        self.notes.get_or_init(|| {
            let counts = NOTES.iter().map(|(what, count)| (*what, count(self)));
            counts.filter(|(_, n)| *n > 0).collect()
        })
    }
}
