//! Additional table columns on request.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::metrics::METRICS;
use crate::report::Column;

/// Metrics to show in addition to the columns of every table.
#[derive(Debug, Args)]
pub(super) struct ExtraColumns {
    /// Additional table columns: metrics, separated by commas, such as log-clinging
    /// (`reactsim list metrics` names all)
    #[arg(long, value_name = "METRIC", value_delimiter = ',', hide_possible_values = true,
          value_parser = column())]
    also: Vec<Column>,
}

impl ExtraColumns {
    /// The requested columns.
    pub(super) fn columns(&self) -> &[Column] {
        &self.also
    }
}

/// Parses the id of a metric; clap answers an unknown id with all ids and the most similar one.
pub(super) fn column() -> impl TypedValueParser<Value = Column> {
    let ids = METRICS.iter().map(|m| m.spec().id);
    PossibleValuesParser::new(ids).try_map(|id| Column::of(&id).ok_or_else(|| format!("no metric `{id}`")))
}
