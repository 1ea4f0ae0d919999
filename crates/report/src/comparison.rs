//! Comparisons of two results as tables.

use std::io::{self, Write};

use reactsim_evaluation::{Comparison, ConditionDifference, PairedDifference};

use super::markdown::{escape, write_aligned};
use super::table::{COLUMNS, Column, count};

/// Writes comparisons of two runs as Markdown, with the conditions in which the runs differ. Per metric,
/// lists at most `most` scenarios that got better and at most `most` that got worse.
///
/// # Errors
/// If `out` cannot be written.
pub fn write(
    comparisons: &[Comparison],
    differences: &[ConditionDifference],
    most: usize,
    out: &mut dyn Write,
) -> io::Result<()> {
    for (i, comparison) in comparisons.iter().enumerate() {
        let Comparison { first, second, scenarios, unpaired, .. } = comparison;
        let same = first == second;
        let title = if same { escape(first) } else { format!("{} and {}", escape(first), escape(second)) };
        writeln!(out, "{}{title}: {}\n", if i > 0 { "\n" } else { "" }, count(*scenarios, "scenario"))?;
        write_differences(comparison, out)?;
        if *unpaired > 0 {
            writeln!(out, "\n{} in one run alone.", count(*unpaired, "scenario"))?;
        }
        for (column, paired) in columns(comparison) {
            for (name, changed) in [("Worse", &paired.worse), ("Better", &paired.better)] {
                let shown = changed.iter().take(most);
                let all: Vec<String> =
                    shown.map(|(id, d)| format!("{} ({})", escape(id), signed(&column, *d))).collect();
                if !all.is_empty() {
                    let more = changed.len() - all.len();
                    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                    writeln!(out, "\n{name}, {}: {}{more}", column.title(), all.join(", "))?;
                }
            }
        }
    }
    writeln!(out, "\n{LEGEND}")?;
    for ConditionDifference { condition, first, second } in differences {
        let (first, second) = (escape(first), escape(second));
        writeln!(out, "The runs differ in `{}`: {first} and {second}.", condition.name())?;
    }
    Ok(())
}

/// What the tables of differences show.
pub const LEGEND: &str = "\
    n: scenarios in which both have a value; all numbers are of them. Second minus first, scenario by \
    scenario: mean with its 95 % bootstrap interval; p by a permutation test of the signs; the verdict is for p \
    below 0.05, one column at a time. Seen from: so large a difference is found in four of five cases.";

/// Writes the table of a comparison, and which doublings it would not show.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_differences(comparison: &Comparison, out: &mut dyn Write) -> io::Result<()> {
    let mut rows = vec![HEAD.map(str::to_owned).to_vec()];
    rows.extend(columns(comparison).map(|(column, paired)| row(&column, paired)));
    write_aligned(out, &rows, 1)?;
    let hidden = columns(comparison).filter(|(_, paired)| paired.may_hide_doubling());
    let hidden: Vec<&str> = hidden.map(|(column, _)| column.title()).collect();
    if hidden.is_empty() {
        return Ok(());
    }
    writeln!(out, "\nToo few scenarios to see a doubling: {}.", hidden.join(", "))
}

/// Returns the change of a metric in words, such as `Progress 0.855 → 0.810 (p 0.0400)`.
pub fn change(paired: &PairedDifference) -> String {
    let column = Column::of_spec(paired.metric);
    let unit = column.unit().map(|unit| format!(" {unit}")).unwrap_or_default();
    let [first, second] = [paired.first, paired.second].map(|value| column.number(value));
    format!("{} {first} → {second}{unit} (p {})", column.title(), p_text(paired.p))
}

/// Smallest p-value that is printed as a number.
const MIN_PRINTED_P: f64 = 0.0001;

/// Column heads.
const HEAD: [&str; 10] =
    ["Metric", "n", "First", "Second", "Difference", "p", "Verdict", "Seen from", "Better in", "Worse in"];

/// Returns the metrics of a comparison in the order of the tables, then those that only the runs have.
fn columns(comparison: &Comparison) -> impl Iterator<Item = (Column, &PairedDifference)> {
    let paired = comparison.metrics.values();
    let own = paired.map(|p| Column::of_spec(p.metric)).filter(|c| Column::of(c.metric).is_none());
    COLUMNS.iter().copied().chain(own).filter_map(|c| Some((c, comparison.metrics.get(c.metric)?)))
}

fn row(column: &Column, paired: &PairedDifference) -> Vec<String> {
    let interval = match (paired.difference.low, paired.difference.high) {
        (Some(low), Some(high)) => format!(" [{}, {}]", signed(column, low), signed(column, high)),
        _ => String::new(),
    };
    vec![
        column.head(),
        paired.difference.scenarios.to_string(),
        column.number(paired.first),
        column.number(paired.second),
        format!("{}{interval}", signed(column, paired.second - paired.first)),
        p_text(paired.p),
        paired.verdict.words().to_owned(),
        paired.visible.map_or_else(|| "–".to_owned(), |visible| format!("±{}", column.number(visible))),
        paired.better.len().to_string(),
        paired.worse.len().to_string(),
    ]
}

fn p_text(p: f64) -> String {
    if p < MIN_PRINTED_P { format!("< {MIN_PRINTED_P}") } else { format!("{p:.4}") }
}

/// Formats a number with its sign; numbers that round to 0 have none.
pub(super) fn signed(column: &Column, value: f64) -> String {
    let text = column.number(value.abs());
    match value {
        _ if text.chars().all(|c| matches!(c, '0' | '.')) => text,
        v if v < 0.0 => format!("-{text}"),
        _ => format!("+{text}"),
    }
}
