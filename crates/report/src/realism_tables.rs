//! Comparison of two sets of scenarios as Markdown, CSV and JSON.

use std::io::{self, Write};

use reactsim_generation::realism::{Comparison, Row, Side, Spread};

use super::markdown::{escape, write_aligned};

/// Writes the comparison as Markdown tables: the statistics by which a set is judged, then the others.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_markdown(out: &mut dyn Write, comparison: &Comparison) -> io::Result<()> {
    let Comparison { generated, reference, .. } = comparison;
    writeln!(out, "{} against {}.\n", side(generated), side(reference))?;
    table(out, comparison, true)?;
    let judged = comparison.rows.iter().filter(|r| r.decides);
    if let Some(worst) = judged.filter(|r| r.divergence.is_some()).max_by(by_divergence) {
        writeln!(out, "\nLargest divergence: {} ({}).\n", share(worst.divergence), lower(worst.title))?;
    }
    writeln!(out, "Other statistics:\n")?;
    table(out, comparison, false)?;
    writeln!(
        out,
        "\nQuartiles: lower, median, upper. JSD: Jensen-Shannon divergence of the histograms, base 2, \
         0 to 1. Chance: the same between the halves of the reference.\n"
    )?;
    let rows = comparison.rows.iter().map(|r| vec![r.title.to_owned(), r.of.to_owned()]);
    let head = vec!["Statistic".to_owned(), "One value per".to_owned()];
    write_aligned(out, &std::iter::once(head).chain(rows).collect::<Vec<_>>(), 2)
}

fn by_divergence(a: &&Row, b: &&Row) -> std::cmp::Ordering {
    let value = |r: &Row| r.divergence.unwrap_or(0.0);
    value(a).total_cmp(&value(b))
}

/// Describes a set.
fn side(side: &Side) -> String {
    let scenarios = super::table::count(side.scenarios as usize, "scenario");
    let failed = if side.failures > 0 { format!(", {} unreadable", side.failures) } else { String::new() };
    format!("{} ({scenarios}{failed})", escape(&side.name))
}

fn lower(title: &str) -> String {
    let mut chars = title.chars();
    chars.next().map_or_else(String::new, |c| c.to_lowercase().chain(chars).collect())
}

fn table(out: &mut dyn Write, comparison: &Comparison, decides: bool) -> io::Result<()> {
    let head = ["Statistic", "n", "Mean", "Quartiles", "n (ref.)", "Mean", "Quartiles", "JSD", "Chance"];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    for row in comparison.rows.iter().filter(|r| r.decides == decides) {
        let unit = if row.unit.is_empty() { String::new() } else { format!(" ({})", row.unit) };
        let mut cells = vec![format!("{}{unit}", row.title)];
        for spread in [&row.generated, &row.reference] {
            cells.push(spread.n.to_string());
            cells.push(number(spread.mean, row));
            cells.push(quartiles(spread, row));
        }
        cells.push(share(row.divergence));
        cells.push(share(row.chance));
        rows.push(cells);
    }
    write_aligned(out, &rows, 1)
}

fn quartiles(spread: &Spread, row: &Row) -> String {
    let each = [spread.lower_quartile, spread.median, spread.upper_quartile];
    if spread.n == 0 { "–".to_owned() } else { each.map(|v| number(v, row)).join(" / ") }
}

/// Formats a number with the precision of the bins.
fn number(value: Option<f64>, row: &Row) -> String {
    let digits = if row.bins.width < 0.1 { 3 } else { 2 };
    let Some(value) = value else { return "–".to_owned() };
    let text = format!("{value:.digits$}");
    // No sign before a zero; a typographic minus before other numbers.
    match text.strip_prefix('-') {
        Some(zero) if zero.trim_matches(['0', '.']).is_empty() => zero.to_owned(),
        Some(positive) => format!("−{positive}"),
        None => text,
    }
}

fn share(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |v| format!("{v:.3}"))
}

/// Writes the comparison as CSV: one line per statistic and set, without histograms.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_csv(out: &mut dyn Write, comparison: &Comparison) -> io::Result<()> {
    writeln!(
        out,
        "statistic,unit,decides,set,n,mean,lower_quartile,median,upper_quartile,divergence,chance"
    )?;
    let value = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
    for row in &comparison.rows {
        for (set, s) in [("generated", &row.generated), ("reference", &row.reference)] {
            let numbers = [s.mean, s.lower_quartile, s.median, s.upper_quartile, row.divergence, row.chance];
            let numbers = numbers.map(value).join(",");
            writeln!(out, "{},{},{},{set},{},{numbers}", row.id, row.unit, row.decides, s.n)?;
        }
    }
    Ok(())
}

/// Writes the comparison as JSON, including histograms and their bins.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_json(out: &mut dyn Write, comparison: &Comparison) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, comparison)?;
    out.write_all(b"\n")
}
