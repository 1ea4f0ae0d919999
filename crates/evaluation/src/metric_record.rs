//! Records of metrics that the benchmark does not have, in files.

use parking_lot::Mutex;
use reactsim_metrics::{MetricSpec, Scope, Unit, check_own};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

/// A metric that the benchmark does not have, as stored in files.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MetricRecord {
    /// Id.
    pub id: String,
    /// Title in tables.
    pub title: String,
    /// Unit: `count`, `rate`, `m`, `m/s²`, another one, or empty.
    pub unit: String,
    /// Input of one value: `rollout`, `scenario` or `av` ([`Scope`]).
    pub scope: String,
    /// Whether lower values are better.
    pub lower_is_better: bool,
    /// Source of the definition.
    pub source: String,
}

/// Descriptions of the metrics of all files that were read. They live as long as the program, as those of the
/// benchmark do, and there is one per record.
static SPECS: Mutex<Vec<&'static MetricSpec>> = Mutex::new(Vec::new());

impl MetricRecord {
    /// Creates the record of a metric.
    pub fn of(spec: &MetricSpec) -> Self {
        Self {
            id: spec.id.to_owned(),
            title: spec.title.to_owned(),
            unit: spec.unit.name().to_owned(),
            scope: spec.scope.name().to_owned(),
            lower_is_better: spec.lower_is_better,
            source: spec.source.to_owned(),
        }
    }

    /// Returns the description of the metric. An unknown scope is that of a rollout.
    pub fn spec(&self) -> &'static MetricSpec {
        let mut specs = SPECS.lock();
        if let Some(known) = specs.iter().find(|spec| Self::of(spec) == *self) {
            return known;
        }
        let text = |text: &String| -> &'static str { text.clone().leak() };
        let spec: &'static MetricSpec = Box::leak(Box::new(MetricSpec {
            id: text(&self.id),
            title: text(&self.title),
            unit: Unit::from_name(text(&self.unit)),
            scope: self.scope().unwrap_or(Scope::Rollout),
            lower_is_better: self.lower_is_better,
            source: text(&self.source),
        }));
        specs.push(spec);
        spec
    }

    fn scope(&self) -> Option<Scope> {
        Scope::ALL.into_iter().find(|scope| scope.name() == self.scope)
    }
}

/// Reads records of metrics and checks them: tables and pages print their texts as they are.
pub(super) fn checked<'de, D: Deserializer<'de>>(file: D) -> Result<Vec<MetricRecord>, D::Error> {
    let records = Vec::<MetricRecord>::deserialize(file)?;
    if let Some(wrong) = records.iter().find(|record| record.scope().is_none()) {
        let known = Scope::ALL.map(Scope::name).join(", ");
        let (id, scope) = (&wrong.id, &wrong.scope);
        return Err(D::Error::custom(format!("metric `{id}`: scope is `{scope}`, expected one of {known}")));
    }
    let specs: Vec<_> = records.iter().map(MetricRecord::spec).collect();
    check_own(&specs).map_err(D::Error::custom)?;
    Ok(records)
}
