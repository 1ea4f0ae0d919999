//! The table of a run while it runs: means over the scenarios that are finished.

use std::fmt;

use crate::evaluation::{PlannedSimulator, Row};
use crate::metrics::Score;
use crate::report::{Column, MAIN_COLUMNS};

/// Sums over finished scenarios, by simulator and metric.
pub(super) struct LiveTable {
    simulators: Vec<LiveRow>,
}

struct LiveRow {
    id: String,
    title: String,
    scenarios: usize,
    /// Sum and number of values per column.
    sums: [(f64, usize); MAIN_COLUMNS.len()],
}

impl LiveTable {
    /// Creates the table of these simulators.
    pub(super) fn of(simulators: &[PlannedSimulator]) -> Self {
        let row = |s: &PlannedSimulator| LiveRow {
            id: s.id.clone(),
            title: s.title.clone(),
            scenarios: 0,
            sums: [(0.0, 0); MAIN_COLUMNS.len()],
        };
        Self { simulators: simulators.iter().map(row).collect() }
    }

    /// Adds the rows of one scenario and one simulator.
    pub(super) fn add(&mut self, rows: &[Row]) {
        let Some(first) = rows.first() else { return };
        let Some(simulator) = self.simulators.iter_mut().find(|s| s.id == first.simulator) else { return };
        simulator.scenarios += 1;
        for (column, (sum, count)) in MAIN_COLUMNS.iter().zip(&mut simulator.sums) {
            let scores = rows.iter().filter_map(|row| row.metrics.get(column.metric).copied().flatten());
            let values: Vec<f64> = scores.filter_map(Score::value).collect();
            if !values.is_empty() {
                *sum += values.iter().sum::<f64>() / values.len() as f64;
                *count += 1;
            }
        }
    }
}

impl fmt::Display for LiveTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.simulators.iter().map(|s| s.title.chars().count()).max().unwrap_or(0);
        for simulator in self.simulators.iter().filter(|s| s.scenarios > 0) {
            let cells =
                MAIN_COLUMNS.iter().zip(simulator.sums).map(|(column, (sum, count)): (&Column, _)| {
                    let text = if count > 0 { column.number(sum / count as f64) } else { "–".to_owned() };
                    format!("  {text:>6}")
                });
            let cells: String = cells.collect();
            writeln!(f, "{:width$}{cells}  {}", simulator.title, simulator.scenarios)?;
        }
        Ok(())
    }
}
