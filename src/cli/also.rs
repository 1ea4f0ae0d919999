//! Columns that tables have on request.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::metrics::METRICS;
use crate::report::Column;

/// Metrics that are not columns of every table.
#[derive(Debug, Args)]
pub(super) struct Also {
    /// Further columns of the tables: metrics, separated by commas, such as log-clinging
    /// (`reactsim list metrics` names all)
    #[arg(long, value_name = "METRIC", value_delimiter = ',', hide_possible_values = true, value_parser = column())]
    also: Vec<Column>,
}

impl Also {
    /// The columns that were asked for.
    pub(super) fn columns(&self) -> &[Column] {
        &self.also
    }
}

/// Reads the id of a metric; an unknown one is answered with those that there are, and with one that is named alike.
fn column() -> impl TypedValueParser<Value = Column> {
    let ids = METRICS.iter().map(|m| m.spec().id);
    PossibleValuesParser::new(ids).try_map(|id| Column::of(&id).ok_or_else(|| format!("no metric `{id}`")))
}
