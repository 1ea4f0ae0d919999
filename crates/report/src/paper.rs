//! A run next to the numbers of the paper, as tables.

use std::io::{self, Write};

use reactsim_evaluation::Estimate;
use reactsim_evaluation::paper::{PAPER_ROWS, PAPER_SCENARIOS, PaperComparison, PaperNumber};
use serde::Serialize;

use super::markdown::write_aligned;
use super::table::{Column, MAIN_COLUMNS, count};

/// Columns of the numbers of log replay.
const HEAD: [&str; 5] = ["Log replay", "Paper", "Here", "95 % interval", "Verdict"];
/// Columns of the variants of metrics.
const VARIANT_HEAD: [&str; 6] = ["Not equal", "With", "Paper", "Here", "95 % interval", "Verdict"];

/// Writes the comparison of a run with the paper as Markdown.
///
/// # Errors
/// If `out` cannot be written.
pub fn write(comparison: &PaperComparison, out: &mut dyn Write) -> io::Result<()> {
    let rows = comparison.numbers.iter().map(|(number, found)| cells(vec![title(number)], number, found));
    write_aligned(out, &HEAD, rows, 1)?;
    writeln!(out, "\nPaper: arXiv 2606.14058, table 1, {PAPER_SCENARIOS} scenarios.")?;
    writeln!(out, "Here: {}.", count(comparison.scenarios, "scenario"))?;
    if comparison.scenarios != PAPER_SCENARIOS {
        writeln!(out, "The numbers of other scenarios, or of a part of them, need not be equal.")?;
    }
    if !comparison.options.is_empty() {
        writeln!(out, "Metric options of the run: {}.", comparison.options.join(" "))?;
    }
    if !comparison.variants.is_empty() {
        let rows = comparison.variants.iter().map(|variant| {
            let texts = vec![title(&variant.number), format!("`{}`", variant.variant)];
            cells(texts, &variant.number, &variant.found)
        });
        writeln!(out)?;
        write_aligned(out, &VARIANT_HEAD, rows, 2)?;
        writeln!(
            out,
            "\nA variant explains a difference if its verdict is better than that above. Variants that change nothing are left out."
        )?;
    }
    if let Some(reason) = &comparison.not_computed {
        writeln!(out, "\nVariants of the metrics were not computed: {reason}.")?;
    }
    Ok(())
}

fn title(number: &PaperNumber) -> String {
    let column = Column::of(number.metric).map_or(number.metric, |column| column.title());
    if number.is_share { format!("{column}, share of scenarios (%)") } else { heading(number.metric) }
}

/// Returns the title of a metric with its unit.
fn heading(metric: &str) -> String {
    let of = |column: Column| match column.unit() {
        Some(unit) => format!("{} ({unit})", column.title()),
        None => column.title().to_owned(),
    };
    Column::of(metric).map_or_else(|| metric.to_owned(), of)
}

fn cells(mut row: Vec<String>, number: &PaperNumber, found: &Estimate) -> Vec<String> {
    let print = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| number.print(value));
    let interval = match (found.low, found.high) {
        (Some(_), Some(_)) => format!("{} to {}", print(found.low), print(found.high)),
        _ => "–".to_owned(),
    };
    let verdict = number.agreement(found).name().to_owned();
    row.extend([number.printed.to_owned(), print(found.mean), interval, verdict]);
    row
}

/// The main table of the paper, for pages.
#[derive(Debug, Serialize)]
pub(super) struct PaperTable {
    /// Ids of the metrics.
    metrics: Vec<&'static str>,
    /// Name and numbers of each row.
    rows: [(&'static str, [&'static str; 7]); PAPER_ROWS.len()],
    scenarios: usize,
}

impl PaperTable {
    pub(super) fn new() -> Self {
        let metrics = MAIN_COLUMNS.iter().map(|column| column.metric).collect();
        Self { metrics, rows: PAPER_ROWS, scenarios: PAPER_SCENARIOS }
    }
}
