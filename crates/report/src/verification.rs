//! Agreement of a run with a reference, as tables.

use std::io::{self, Write};

use reactsim_evaluation::reference::{LargestDifference, Reference, SimulatorCheck, Subject, Verification};

use super::markdown::{escape, write_aligned};
use super::table::count;

/// Columns of the first table.
const HEAD: [&str; 6] = ["Simulator", "Class", "Compared", "Differ", "Largest difference", "Verdict"];
/// Columns of the table of differences.
const DIFFERENCE_HEAD: [&str; 5] = ["Simulator", "Scenario", "Metric", "Reference", "Found"];

/// Writes a verification as Markdown; at most `most` differences are listed.
///
/// # Errors
/// If `out` cannot be written.
pub fn write(
    reference: &Reference,
    verification: &Verification,
    most: usize,
    out: &mut dyn Write,
) -> io::Result<()> {
    write_aligned(out, &HEAD, verification.simulators.iter().map(row), 2)?;
    let what = match verification.subject {
        Subject::Rows => "row",
        Subject::Summary => "value",
    };
    let compared: usize = verification.simulators.iter().map(|s| s.compared).sum();
    let of = reference.record.benchmark.as_ref().map(|b| format!(", {b}")).unwrap_or_default();
    writeln!(
        out,
        "\n{}{}: {} compared.",
        escape(&reference.record.name),
        escape(&of),
        count(compared, what)
    )?;
    if verification.left_out > 0 {
        let left = count(verification.left_out, what);
        writeln!(
            out,
            "This was a quick check: {left} of networks were skipped. Leave --quick out to compare them."
        )?;
    }
    if verification.simulators.iter().any(|s| !s.bit_for_bit) {
        writeln!(
            out,
            "Backend or class of processor are not those of the reference: \
             networks are compared by mean paired differences."
        )?;
    }
    if verification.differences.is_empty() {
        return Ok(());
    }
    let rows = verification.differences.iter().take(most).map(|d| {
        let scenario = d.scenario.as_deref().unwrap_or("all");
        let rollout = d.rollout.map(|r| format!(", rollout {r}")).unwrap_or_default();
        let field = d.field.trim_start_matches("metrics.");
        [&d.simulator, &format!("{scenario}{rollout}"), field, &d.reference, &d.found].map(escape).to_vec()
    });
    writeln!(out)?;
    write_aligned(out, &DIFFERENCE_HEAD, rows, 3)?;
    let more = verification.differences.len().saturating_sub(most);
    if more > 0 {
        writeln!(out, "\nand {more} more.")?;
    }
    Ok(())
}

fn row(check: &SimulatorCheck) -> Vec<String> {
    let verdict = match check {
        SimulatorCheck { compared: 0, .. } => "not compared",
        SimulatorCheck { passed: false, .. } => "differs",
        SimulatorCheck { differing: 0, .. } => "equal",
        _ => "within bounds",
    };
    let largest = check.largest.as_ref().map_or_else(|| "–".to_owned(), largest);
    vec![
        escape(&check.id),
        check.class.to_owned(),
        check.compared.to_string(),
        check.differing.to_string(),
        largest,
        verdict.to_owned(),
    ]
}

/// Formats the largest difference with four significant digits; the list below the table has all bits.
fn largest(largest: &LargestDifference) -> String {
    let LargestDifference { metric, difference, bound } = largest;
    let bound = bound.map(|b| format!(" of {b:.3e}")).unwrap_or_default();
    format!("{difference:.3e}{bound} ({metric})")
}
