//! Selection of scenarios by id and category.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_formats::deviations::DeviationRecord;
use reactsim_scene::{Deviation, Scenario};
use serde::{Deserialize, Serialize};

/// The scenarios of the sources that a run uses: those with one of the ids and one of the categories.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Selection {
    /// Ids; all if empty.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub ids: BTreeSet<String>,
    /// Names of categories of the deviated AV; all if empty.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub categories: BTreeSet<String>,
}

impl Selection {
    /// Returns whether every scenario is selected.
    pub(crate) fn is_all(&self) -> bool {
        self.ids.is_empty() && self.categories.is_empty()
    }

    /// Returns whether scenarios with this id are selected, as far as the category allows.
    pub fn has_id(&self, id: &str) -> bool {
        self.ids.is_empty() || self.ids.contains(id)
    }

    /// Returns whether some scenarios may not be selected: those without one of the ids and categories and,
    /// with a file of deviations, those that are not there and do not fall back on the logged AV.
    pub fn leaves_out(&self, has_deviations: bool, falls_back: bool) -> bool {
        !self.is_all() || (has_deviations && !falls_back)
    }

    /// Returns whether a scenario is selected. If there is a file of deviations, its category is that there;
    /// a scenario that is not there has none if it `falls_back` on the logged AV, else it is not selected.
    pub fn has(
        &self,
        scenario: &Scenario,
        deviations: Option<&BTreeMap<String, DeviationRecord>>,
        falls_back: bool,
    ) -> bool {
        let category = match deviations {
            Some(deviations) => match deviations.get(&scenario.id) {
                Some(record) => record.category,
                None if falls_back => None,
                None => return false,
            },
            None => scenario.deviation.as_ref().and_then(|deviation| deviation.category),
        };
        self.has_id(&scenario.id) && self.has_category(category)
    }

    /// Returns whether scenarios of this category are selected, as far as the id allows.
    pub(crate) fn has_category(&self, category: Option<Deviation>) -> bool {
        self.categories.is_empty() || category.is_some_and(|c| self.categories.contains(c.name()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Source;

    #[test]
    fn scenarios_without_a_deviation_in_the_file_are_selected_if_the_log_drives_them() {
        let scenario = Source::shipped(1).scenarios().unwrap().next().unwrap().unwrap();
        let category = scenario.deviation.as_ref().unwrap().category.unwrap().name().to_owned();
        let (all, none) = (Selection::default(), BTreeMap::new());
        let has = |selection: &Selection| {
            [(None, false), (Some(&none), false), (Some(&none), true)]
                .map(|(deviations, falls_back)| selection.has(&scenario, deviations, falls_back))
        };
        assert_eq!(has(&all), [true, false, true]);
        // The logged AV has no category, whatever that of the scenario's own deviation is.
        let categories = Selection { categories: [category].into(), ..Selection::default() };
        assert_eq!(has(&categories), [true, false, false]);
    }

    #[test]
    fn nothing_requested_selects_all() {
        let all = Selection::default();
        assert!(all.is_all() && all.has_id("a") && all.has_category(None));
        assert_eq!(serde_json::to_string(&all).unwrap(), "{}");
    }

    #[test]
    fn a_category_excludes_scenarios_without_one() {
        let lateral = Selection { categories: ["lateral".to_owned()].into(), ..Selection::default() };
        assert!(lateral.has_category(Some(Deviation::Lateral)) && lateral.has_id("a"));
        assert!(!lateral.has_category(Some(Deviation::Directional)) && !lateral.has_category(None));
    }

    #[test]
    fn only_requested_ids_are_selected() {
        let one = Selection { ids: ["a".to_owned()].into(), ..Selection::default() };
        assert!(one.has_id("a") && !one.has_id("b") && !one.is_all());
    }
}
