//! Tables of the realism metrics of the Sim Agents challenge.

use std::fmt::Write as _;

use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::evaluation::Estimate;
use crate::evaluation::realism::{RealismScores, RealismSummary};
use crate::metrics::wosac::Feature;

/// An aggregate of the leaderboard as a column of tables.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Aggregate {
    /// Name in the official message.
    pub id: &'static str,
    /// Title.
    pub title: &'static str,
    /// `m`, `likelihood` or `share`.
    pub unit: &'static str,
    /// Whether smaller values are better.
    pub lower_is_better: bool,
}

impl Aggregate {
    const fn likelihood(id: &'static str, title: &'static str) -> Self {
        Self { id, title, unit: "likelihood", lower_is_better: false }
    }

    const fn cost(id: &'static str, title: &'static str, unit: &'static str) -> Self {
        Self { id, title, unit, lower_is_better: true }
    }

    fn heading(&self) -> String {
        let unit = if self.unit == "m" { " (m)" } else { "" };
        format!("{}{unit} {}", self.title, if self.lower_is_better { "↓" } else { "↑" })
    }
}

/// The aggregates of the leaderboard, in the order of
/// [`BucketMetrics::fields`](crate::metrics::wosac::BucketMetrics::fields).
pub const AGGREGATES: [Aggregate; 8] = [
    Aggregate::likelihood("realism_meta_metric", "Realism"),
    Aggregate::likelihood("kinematic_metrics", "Kinematic"),
    Aggregate::likelihood("interactive_metrics", "Interactive"),
    Aggregate::likelihood("map_based_metrics", "Map-based"),
    Aggregate::cost("min_ade", "minADE", "m"),
    Aggregate::cost("simulated_collision_rate", "Collision", "share"),
    Aggregate::cost("simulated_offroad_rate", "Offroad", "share"),
    Aggregate::cost("simulated_traffic_light_violation_rate", "Red light", "share"),
];

/// Returns the tables as Markdown: the aggregates of the leaderboard and the likelihoods, one row per
/// configuration.
pub fn realism_markdown(scores: &RealismScores) -> String {
    let mut text = String::new();
    row(&mut text, std::iter::once("Configuration".to_owned()).chain(AGGREGATES.map(|a| a.heading())));
    rule(&mut text, AGGREGATES.len());
    for (i, config) in scores.configs.iter().enumerate() {
        let estimates = scores.aggregates(i).into_iter().map(|(_, estimate)| cell(estimate));
        row(&mut text, std::iter::once(config.title.to_owned()).chain(estimates));
    }
    text.push_str("\nLikelihoods:\n\n");
    let features = Feature::ALL.map(|feature| feature.name().replace('_', " "));
    row(&mut text, std::iter::once("Configuration").chain(features.iter().map(String::as_str)));
    rule(&mut text, features.len());
    for (i, config) in scores.configs.iter().enumerate() {
        let likelihood = |feature: Feature| {
            cell(scores.estimate(feature.name(), |row| row.metrics[i].likelihood(feature)))
        };
        row(&mut text, std::iter::once(config.title.to_owned()).chain(Feature::ALL.map(likelihood)));
    }
    let scenarios = match scores.rows.len() {
        1 => "1 scenario".to_owned(),
        n => format!("{n} scenarios"),
    };
    let rollouts: Vec<usize> = scores.rows.iter().map(|row| row.rollouts).collect();
    let rollouts = match (rollouts.iter().min(), rollouts.iter().max()) {
        (Some(least), Some(most)) if least != most => format!("{least} to {most}"),
        (least, _) => least.copied().unwrap_or_default().to_string(),
    };
    let method = if scores.method.is_empty() { "" } else { ", " };
    write!(
        text,
        "\nMeans over scenarios ± half the width of the 95 % bootstrap interval; ↓ less is better, ↑ more is.\n\
         {scenarios}, {rollouts} rollouts each{method}{}.\n",
        scores.method
    )
    .ok();
    text
}

/// Returns a table of the simulators of a study as Markdown: the aggregates of the leaderboard, one row per
/// simulator.
pub fn realism_table(simulators: &[RealismSummary]) -> String {
    let mut text = String::from("Realism metrics of the Sim Agents challenge 2025:\n\n");
    row(&mut text, std::iter::once("Method".to_owned()).chain(AGGREGATES.map(|a| a.heading())));
    rule(&mut text, AGGREGATES.len());
    for simulator in simulators {
        let estimate = |column: Aggregate| simulator.aggregates.get(column.id).copied().unwrap_or_default();
        let estimates = AGGREGATES.map(|column| cell(estimate(column)));
        row(&mut text, std::iter::once(simulator.title.clone()).chain(estimates));
    }
    text.push_str("\nMeans over scenarios ± half the width of the 95 % bootstrap interval.\n");
    text
}

/// Returns the scores as JSON, with the field names of the official messages.
pub fn realism_json(scores: &RealismScores) -> Value {
    let mut configs = Map::new();
    for (i, (config, mean)) in scores.means().into_iter().enumerate() {
        let fields = |fields: Vec<(&'static str, Option<f64>)>| -> Map<String, Value> {
            fields.into_iter().filter_map(|(name, value)| Some((name.to_owned(), json!(value?)))).collect()
        };
        let buckets = mean.buckets(config).fields();
        let intervals: Map<String, Value> = scores
            .aggregates(i)
            .into_iter()
            .filter_map(|(name, estimate)| Some((name.to_owned(), json!([estimate.low?, estimate.high?]))))
            .collect();
        let entry = json!({
            "metrics": fields(mean.fields()),
            "buckets": fields(buckets.to_vec()),
            "intervals_95": intervals,
        });
        configs.insert(config.id.to_owned(), entry);
    }
    json!({
        "method": scores.method,
        "scenarios": scores.rows.len(),
        "configs": configs,
        "missing": scores.missing,
        "failures": scores.failures.iter().map(|failure| &failure.error).collect::<Vec<_>>(),
    })
}

/// Returns the scores of every scenario as JSON lines, one per scenario and configuration.
pub fn realism_rows(scores: &RealismScores) -> String {
    let mut text = String::new();
    for row in &scores.rows {
        for (config, metrics) in scores.configs.iter().zip(&row.metrics) {
            let mut line = Map::new();
            line.insert("scenario_id".to_owned(), json!(row.scenario_id));
            line.insert("method".to_owned(), json!(scores.method));
            line.insert("config".to_owned(), json!(config.id));
            line.insert("rollouts".to_owned(), json!(row.rollouts));
            line.extend(
                metrics.fields().into_iter().filter_map(|(name, v)| Some((name.to_owned(), json!(v?)))),
            );
            writeln!(text, "{}", Value::Object(line)).ok();
        }
    }
    text
}

/// Returns the scores of every scenario as CSV, one line per scenario and configuration.
pub fn realism_csv(scores: &RealismScores) -> String {
    let mut text = String::from("scenario_id,config,rollouts");
    let names = Feature::ALL.iter().map(|feature| feature.likelihood_name());
    let fixed = ["metametric", "average_displacement_error", "min_average_displacement_error"];
    let rates =
        ["simulated_collision_rate", "simulated_offroad_rate", "simulated_traffic_light_violation_rate"];
    let columns: Vec<&str> = fixed.into_iter().chain(names).chain(rates).collect();
    columns.iter().for_each(|name| write!(text, ",{name}").unwrap_or_default());
    text.push('\n');
    for row in &scores.rows {
        for (config, metrics) in scores.configs.iter().zip(&row.metrics) {
            let fields = metrics.fields();
            let id = row.scenario_id.replace('"', "\"\"");
            write!(text, "\"{id}\",{},{}", config.id, row.rollouts).ok();
            for column in &columns {
                let value = fields.iter().find(|(name, _)| name == column).and_then(|(_, value)| *value);
                write!(text, ",{}", value.map_or_else(String::new, |v| v.to_string())).ok();
            }
            text.push('\n');
        }
    }
    text
}

fn cell(estimate: Estimate) -> String {
    match (estimate.mean, estimate.low.zip(estimate.high)) {
        (Some(mean), Some((low, high))) => format!("{mean:.4} ±{:.4}", 0.5 * (high - low)),
        (Some(mean), None) => format!("{mean:.4}"),
        (None, _) => "–".to_owned(),
    }
}

fn row(text: &mut String, cells: impl Iterator<Item = impl AsRef<str>>) {
    cells.for_each(|cell| write!(text, "| {} ", cell.as_ref()).unwrap_or_default());
    text.push_str("|\n");
}

fn rule(text: &mut String, columns: usize) {
    text.push_str("|---");
    text.push_str(&"|--:".repeat(columns));
    text.push_str("|\n");
}
