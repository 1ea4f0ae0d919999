//! Tables of the realism metrics of the Sim Agents challenge.

use std::io::{self, Write};

use reactsim_evaluation::{
    Estimate,
    realism::{RealismScores, RealismSummary},
};
use reactsim_metrics::wosac::Feature;
use serde::Serialize;

use super::table::count;
use super::{csv, markdown};

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
/// [`WosacMetrics::buckets`](reactsim_metrics::wosac::WosacMetrics::buckets).
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

/// Writes the tables of a set of rollouts as Markdown: the aggregates of the leaderboard and the likelihoods,
/// one row per configuration.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_markdown(scores: &RealismScores, out: &mut dyn Write) -> io::Result<()> {
    let configs = || scores.configs.iter().enumerate();
    let aggregates = configs().map(|(i, config)| {
        let cells = scores.aggregates(i).into_iter().map(|(_, estimate)| cell(Some(&estimate)));
        with_first(config.title, cells)
    });
    markdown::write_aligned(out, &head("Configuration"), aggregates, 1)?;

    writeln!(out, "\nLikelihoods:\n")?;
    let features = Feature::ALL.map(|feature| feature.name().replace('_', " "));
    let likelihoods = configs().map(|(i, config)| {
        let of = |feature: Feature| {
            cell(Some(&scores.estimate(feature.name(), |row| row.metrics[i].likelihood(feature))))
        };
        with_first(config.title, Feature::ALL.map(of))
    });
    markdown::write_aligned(out, &with_first("Configuration", features), likelihoods, 1)?;

    let rollouts = || scores.rows.iter().map(|row| row.rollouts);
    let rollouts = match (rollouts().min(), rollouts().max()) {
        (Some(least), Some(most)) if least != most => format!("{least} to {most}"),
        (least, _) => least.unwrap_or_default().to_string(),
    };
    let method = if scores.method.is_empty() { "" } else { ", " };
    writeln!(
        out,
        "\n{}.\n{}, {rollouts} rollouts each{method}{}.",
        markdown::NUMBERS,
        count(scores.rows.len(), "scenario"),
        markdown::escape(&scores.method)
    )
}

/// Writes the simulators of a study as a table in Markdown: the aggregates of the leaderboard, one row per
/// simulator.
///
/// # Errors
/// If `out` cannot be written.
pub(super) fn write_simulators(simulators: &[RealismSummary], out: &mut dyn Write) -> io::Result<()> {
    let config = simulators.first().map_or("", |simulator| simulator.config.as_str());
    writeln!(out, "Realism metrics of the Sim Agents challenge {config}:\n")?;
    let row = |simulator: &RealismSummary| {
        let cells = AGGREGATES.map(|column| cell(simulator.aggregates.get(column.id)));
        with_first(&markdown::escape(&simulator.title), cells)
    };
    markdown::write_aligned(out, &head("Method"), simulators.iter().map(row), 1)?;
    writeln!(out, "\nMeans over scenarios ± half the width of the 95 % bootstrap interval.")
}

/// Returns the head of a table of aggregates.
fn head(first: &str) -> Vec<String> {
    with_first(first, AGGREGATES.map(|column| column.heading()))
}

fn with_first(first: &str, cells: impl IntoIterator<Item = String>) -> Vec<String> {
    std::iter::once(first.to_owned()).chain(cells).collect()
}

/// Writes the scores of every scenario as CSV, one line per scenario and configuration.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_csv(scores: &RealismScores, out: &mut dyn Write) -> io::Result<()> {
    let likelihoods = Feature::ALL.map(|feature| feature.likelihood_name());
    let fixed = ["metametric", "average_displacement_error", "min_average_displacement_error"];
    let rates =
        ["simulated_collision_rate", "simulated_offroad_rate", "simulated_traffic_light_violation_rate"];
    let columns: Vec<&str> = fixed.into_iter().chain(likelihoods).chain(rates).collect();
    writeln!(out, "scenario_id,config,rollouts,{}", columns.join(","))?;
    for row in &scores.rows {
        for (config, metrics) in scores.configs.iter().zip(&row.metrics) {
            write!(out, "{},{},{}", csv::quote(&row.scenario_id), config.id, row.rollouts)?;
            let fields = metrics.fields();
            for column in &columns {
                let value = fields.iter().find(|(name, _)| name == column).and_then(|(_, value)| *value);
                write!(out, ",{}", value.map_or_else(String::new, |v| v.to_string()))?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

fn cell(estimate: Option<&Estimate>) -> String {
    markdown::estimate_text(estimate, |value| format!("{value:.4}"))
}
