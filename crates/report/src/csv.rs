//! CSV in the long form (RFC 4180, but with line feeds).

use std::borrow::Cow;
use std::io::{self, Write};

use super::long::records;
use super::terminal::is_unsafe;
use super::{Run, TableStyle};

pub(super) fn export(runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "run,av,simulator,oracle,kind,category,difficulty,metric,mean,low,high,scenarios")?;
    for r in records(runs, style) {
        let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
        writeln!(
            out,
            "{},{},{},{},{},{},{},{},{},{},{},{}",
            quote(r.run),
            quote(r.av),
            quote(r.simulator),
            r.oracle,
            r.kind,
            quote(r.category.unwrap_or_default()),
            quote(r.difficulty.unwrap_or_default()),
            quote(r.metric),
            number(r.estimate.mean),
            number(r.estimate.low),
            number(r.estimate.high),
            r.estimate.scenarios
        )?;
    }
    Ok(())
}

/// Returns a text as a cell. Spreadsheets would take some beginnings for formulas: an apostrophe makes them
/// text. Control characters become spaces.
pub(super) fn quote(text: &str) -> Cow<'_, str> {
    let is_formula = text.starts_with(['=', '@', '+', '-', '\t', '\r']) && text.parse::<f64>().is_err();
    let shown: String = text.chars().map(|c| if is_unsafe(c) { ' ' } else { c }).collect();
    let shown = format!("{}{shown}", if is_formula { "'" } else { "" });
    if shown.contains(['"', ',']) {
        Cow::Owned(format!("\"{}\"", shown.replace('"', "\"\"")))
    } else if shown == text {
        Cow::Borrowed(text)
    } else {
        Cow::Owned(shown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_quoted_if_necessary() {
        assert_eq!(quote("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(quote("idm"), "idm");
    }

    #[test]
    fn no_cell_is_a_formula_or_has_control_characters() {
        for (text, cell) in [
            ("=1+1", "'=1+1"),
            ("@SUM(A1,A2)", "\"'@SUM(A1,A2)\""),
            ("+x", "'+x"),
            ("-q", "'-q"),
            ("\t=1", "' =1"),
            ("-1.5", "-1.5"),
            ("+7", "+7"),
            ("a\u{1b}[2J\r\nb", "a [2J  b"),
        ] {
            assert_eq!(quote(text), cell, "{text:?}");
        }
    }
}
