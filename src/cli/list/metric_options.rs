//! `reactsim list metric-options`: the variants of the metrics.

use crate::metrics::{OptionDescription, Options};

/// Returns a row per option below a row of headings.
pub(super) fn rows() -> Vec<Vec<String>> {
    let headings = ["option", "default", "values", "description"].map(str::to_owned).to_vec();
    let row = |option: OptionDescription| {
        vec![option.name.to_owned(), option.default, option.values, option.about.to_owned()]
    };
    std::iter::once(headings).chain(Options::descriptions().into_iter().map(row)).collect()
}
