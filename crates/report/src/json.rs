//! JSON: `summary.json` unchanged.

use std::collections::BTreeMap;
use std::io::{self, Write};

use super::{Run, TableStyle};

pub(super) fn export(runs: &[Run<'_>], _: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    if let [only] = runs {
        return out.write_all(only.summary.to_json().as_bytes());
    }
    let named: BTreeMap<&str, _> = runs.iter().map(|r| (r.name, r.summary)).collect();
    serde_json::to_writer_pretty(&mut *out, &named)?;
    out.write_all(b"\n")
}
