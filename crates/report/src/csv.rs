//! CSV in the long form (RFC 4180, but with line feeds).

use std::borrow::Cow;
use std::io::{self, Write};

use super::long::records;
use super::{Exporter, Run, TableStyle};

/// The CSV format.
pub(super) struct Csv;

impl Exporter for Csv {
    fn id(&self) -> &'static str {
        "csv"
    }

    fn title(&self) -> &'static str {
        "one line per run, simulator, category or difficulty, and metric; rates are fractions"
    }

    fn export(&self, runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
        writeln!(out, "run,simulator,oracle,kind,category,difficulty,metric,mean,low,high,scenarios")?;
        for r in records(runs, style) {
            let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
            writeln!(
                out,
                "{},{},{},{},{},{},{},{},{},{},{}",
                quote(r.run),
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
}

pub(super) fn quote(text: &str) -> Cow<'_, str> {
    if text.contains(['"', ',', '\n', '\r']) {
        Cow::Owned(format!("\"{}\"", text.replace('"', "\"\"")))
    } else {
        Cow::Borrowed(text)
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
}
