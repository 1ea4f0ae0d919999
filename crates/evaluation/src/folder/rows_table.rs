//! Rows in Parquet: the content of `rows.jsonl`, without loss.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use arrow_array::RecordBatch;
use reactsim_formats::{
    Cause, FormatError,
    table::{Column, Leaf, TableReader, TableWriter, Value as Cell, View},
};
use reactsim_metrics::REMOVED_METRICS;

use crate::row::{Row, RowLength, RowNote, Value};

/// Kind of the file in its metadata.
const KIND: &str = "reactsim-rows";
/// Format version in the metadata.
const VERSION: u32 = 1;
/// Number of rows per row group.
const GROUP_ROWS: usize = 4096;
/// Maximum count that a floating-point number represents exactly.
const MAX_COUNT: u64 = 1 << 53;

/// Writes rows to a file.
///
/// A metric is an element of four parallel lists: `metric`, `kind` (`rate`, `count`, `mean` or `value`; null
/// if nothing was evaluated), `numerator` and `denominator`. The value of rates and means is numerator over
/// denominator, the value of the others is the numerator. The columns of notes exist only if a row has notes.
/// The columns of the length exist only if a scenario is longer or shorter than those of the benchmark.
///
/// # Errors
/// [`FormatError`] if the file cannot be written, or a count is too large for it.
pub(crate) fn write(path: &Path, rows: &[Row]) -> Result<(), FormatError> {
    let mut columns = vec![
        Column::new("input", Leaf::Whole, 0, false),
        Column::new("record", Leaf::Whole, 0, false),
        Column::new("scenario", Leaf::Text, 0, false),
        Column::new("digest", Leaf::Text, 0, false),
        Column::new("simulator", Leaf::Text, 0, false),
        Column::new("rollout", Leaf::Whole, 0, true),
        Column::new("category", Leaf::Text, 0, true),
        Column::new("difficulty", Leaf::Text, 0, true),
        Column::new("direction_tracking", Leaf::Text, 0, true),
        Column::new("metric", Leaf::Text, 1, false),
        Column::new("kind", Leaf::Text, 1, true),
        Column::new("numerator", Leaf::Number, 1, true),
        Column::new("denominator", Leaf::Whole, 1, true),
        Column::new("deviation", Leaf::Text, 1, false),
        Column::new("deviation_value", Leaf::Number, 1, false),
        Column::new("outcome", Leaf::Text, 1, false),
        Column::new("outcome_count", Leaf::Whole, 1, false),
    ];
    // Rows of most runs have no notes.
    let has_notes = rows.iter().any(|row| !row.notes.is_empty());
    if has_notes {
        columns.extend([
            Column::new("note", Leaf::Text, 1, false),
            Column::new("note_count", Leaf::Whole, 1, false),
            Column::new("note_detail", Leaf::Text, 1, true),
        ]);
    }
    let has_lengths = rows.iter().any(|row| row.length.is_some());
    if has_lengths {
        columns.extend([
            Column::new("history", Leaf::Whole, 0, true),
            Column::new("steps", Leaf::Whole, 0, true),
        ]);
    }
    let mut table = TableWriter::create(path, (KIND, VERSION), GROUP_ROWS, columns)?;
    for (record, row) in (0..).zip(rows) {
        let refuse = |cause| FormatError::record(path, record, Some(row.scenario.clone()), cause);
        put(&mut table, row, has_notes, has_lengths).map_err(refuse)?;
        table.end_row()?;
    }
    table.finish()
}

fn put(table: &mut TableWriter, row: &Row, has_notes: bool, has_lengths: bool) -> Result<(), Cause> {
    // Destructured, so that a new field cannot be forgotten.
    let Row {
        input,
        record,
        scenario,
        digest,
        simulator,
        rollout,
        category,
        difficulty,
        direction_tracking,
        metrics,
        deviation,
        outcomes,
        notes,
        length,
    } = row;
    let mut one = |column: &str, cell: Cell<'_>| table.column(column).push(cell);
    one("input", Cell::Whole(whole("input", *input as u64)?));
    one("record", Cell::Whole(whole("record", *record as u64)?));
    one("scenario", Cell::Text(scenario));
    one("digest", Cell::Text(digest));
    one("simulator", Cell::Text(simulator));
    one("rollout", rollout.map_or(Cell::Null, Cell::Whole));
    one("category", Cell::from(category.as_deref()));
    one("difficulty", Cell::from(difficulty.as_deref()));
    one("direction_tracking", Cell::from(direction_tracking.as_deref()));
    let mut parts = Vec::with_capacity(metrics.len());
    for (name, value) in metrics {
        parts.push(value.map(|v| split(name, v)).transpose()?);
    }
    let part = |of: fn(&Split) -> Cell<'static>| parts.iter().map(move |p| p.as_ref().map_or(Cell::Null, of));
    table.column("metric").list(metrics.keys().map(|name| Cell::Text(name)));
    table.column("kind").list(part(|p| Cell::Text(p.0)));
    table.column("numerator").list(part(|p| Cell::Number(p.1)));
    table.column("denominator").list(part(|p| p.2.map_or(Cell::Null, Cell::Whole)));
    table.column("deviation").list(deviation.keys().map(|name| Cell::Text(name)));
    table.column("deviation_value").list(deviation.values().map(|v| Cell::Number(*v)));
    let counts: Vec<u32> = outcomes.iter().map(|(name, n)| whole(name, *n)).collect::<Result<_, _>>()?;
    table.column("outcome").list(outcomes.keys().map(|name| Cell::Text(name)));
    table.column("outcome_count").list(counts.into_iter().map(Cell::Whole));
    if has_lengths {
        for (column, frames) in [("history", length.map(|l| l.history)), ("steps", length.map(|l| l.steps))] {
            let cell = frames.map(|frames| whole(column, frames as u64)).transpose()?;
            table.column(column).push(cell.map_or(Cell::Null, Cell::Whole));
        }
    }
    if has_notes {
        table.column("note").list(notes.keys().map(|id| Cell::Text(id)));
        table.column("note_count").list(notes.values().map(|note| Cell::Whole(note.count)));
        table.column("note_detail").list(notes.values().map(|note| Cell::from(note.detail.as_deref())));
    }
    Ok(())
}

/// Kind, numerator and denominator of a value.
type Split = (&'static str, f64, Option<u32>);

fn split(name: &str, value: Value) -> Result<Split, Cause> {
    let exact = |n: u64| match n <= MAX_COUNT {
        true => Ok(n as f64),
        false => Err(Cause::value(name, n, "at most 2^53")),
    };
    Ok(match value {
        Value::Rate(hits, valid) => ("rate", exact(hits)?, Some(whole(name, valid)?)),
        Value::Count(n) => ("count", exact(n)?, None),
        Value::Mean(sum, n) => ("mean", sum, Some(whole(name, n)?)),
        Value::Value(v) => ("value", v, None),
    })
}

fn whole(name: &str, n: u64) -> Result<u32, Cause> {
    u32::try_from(n).map_err(|_| Cause::value(name, n, "less than 2^32"))
}

/// Reads the rows of a file in their order.
///
/// # Errors
/// [`FormatError`] if the file cannot be read, is damaged, or is of another kind.
pub(crate) fn read(path: &Path) -> Result<Vec<Row>, FormatError> {
    rows(path, TableReader::open(path)?)
}

/// Like [`read`], with the content in memory; errors name it by `name`.
pub(crate) fn read_bytes(name: &Path, content: Cow<'static, [u8]>) -> Result<Vec<Row>, FormatError> {
    rows(name, TableReader::of_bytes(name, content)?)
}

fn rows(path: &Path, mut table: TableReader) -> Result<Vec<Row>, FormatError> {
    table.require(KIND, VERSION)?;
    let mut rows = Vec::new();
    while let Some(batch) = table.next_batch() {
        let columns = batch.and_then(|b| Columns::of(&b).map_err(|cause| FormatError::file(path, cause)))?;
        for row in 0..columns.len {
            let refuse = |cause| FormatError::record(path, rows.len() as u64, None, cause);
            let row = columns.row(row).map_err(refuse)?;
            rows.push(row);
        }
    }
    Ok(rows)
}

/// The columns of a batch of rows.
struct Columns {
    len: usize,
    input: View,
    record: View,
    scenario: View,
    digest: View,
    simulator: View,
    rollout: View,
    category: View,
    difficulty: View,
    direction_tracking: View,
    metric: View,
    kind: View,
    numerator: View,
    denominator: View,
    deviation: View,
    deviation_value: View,
    outcome: View,
    outcome_count: View,
    /// Id, count and detail of notes; `None` if no row has notes.
    notes: Option<[View; 3]>,
    /// Frames of the history and steps; `None` if all scenarios have the length of the benchmark.
    length: Option<[View; 2]>,
}

impl Columns {
    fn of(batch: &RecordBatch) -> Result<Self, Cause> {
        let one = |name, leaf| View::need(batch, name, leaf, 0);
        let list = |name, leaf| View::need(batch, name, leaf, 1);
        let notes = match View::find(batch, "note", Leaf::Text, 1)? {
            Some(ids) => Some([ids, list("note_count", Leaf::Whole)?, list("note_detail", Leaf::Text)?]),
            None => None,
        };
        let length = match View::find(batch, "history", Leaf::Whole, 0)? {
            Some(history) => Some([history, one("steps", Leaf::Whole)?]),
            None => None,
        };
        Ok(Self {
            len: batch.num_rows(),
            input: one("input", Leaf::Whole)?,
            record: one("record", Leaf::Whole)?,
            scenario: one("scenario", Leaf::Text)?,
            digest: one("digest", Leaf::Text)?,
            simulator: one("simulator", Leaf::Text)?,
            rollout: one("rollout", Leaf::Whole)?,
            category: one("category", Leaf::Text)?,
            difficulty: one("difficulty", Leaf::Text)?,
            direction_tracking: one("direction_tracking", Leaf::Text)?,
            metric: list("metric", Leaf::Text)?,
            kind: list("kind", Leaf::Text)?,
            numerator: list("numerator", Leaf::Number)?,
            denominator: list("denominator", Leaf::Whole)?,
            deviation: list("deviation", Leaf::Text)?,
            deviation_value: list("deviation_value", Leaf::Number)?,
            outcome: list("outcome", Leaf::Text)?,
            outcome_count: list("outcome_count", Leaf::Whole)?,
            notes,
            length,
        })
    }

    fn row(&self, row: usize) -> Result<Row, Cause> {
        let mut metrics = BTreeMap::new();
        for (name, [kind, numerator, denominator]) in
            self.named(row, &self.metric, [&self.kind, &self.numerator, &self.denominator])?
        {
            if REMOVED_METRICS.contains(&name.as_str()) {
                continue;
            }
            let value = match self.kind.text(kind) {
                None => None,
                Some(kind) => Some(self.value(&name, kind, numerator, denominator)?),
            };
            metrics.insert(name, value);
        }
        let mut deviation = BTreeMap::new();
        for (name, [cell]) in self.named(row, &self.deviation, [&self.deviation_value])? {
            let value = self.deviation_value.number(cell).ok_or_else(|| missing_value(&name))?;
            deviation.insert(name, value);
        }
        let mut outcomes = BTreeMap::new();
        for (name, [cell]) in self.named(row, &self.outcome, [&self.outcome_count])? {
            let count = self.outcome_count.whole(cell).ok_or_else(|| missing_value(&name))?;
            outcomes.insert(name, count.into());
        }
        let mut notes = BTreeMap::new();
        if let Some([ids, counts, details]) = &self.notes {
            for (id, [count, detail]) in self.named(row, ids, [counts, details])? {
                let count = counts.whole(count).ok_or_else(|| missing_value(&id))?;
                notes.insert(id, RowNote { count, detail: details.text(detail).map(str::to_owned) });
            }
        }
        let frames = self.length.as_ref().map(|columns| columns.each_ref().map(|column| column.whole(row)));
        let length = match frames {
            Some([Some(history), Some(steps)]) => {
                Some(RowLength { history: history as usize, steps: steps as usize })
            }
            _ => None,
        };
        let text = |view: &View| view.text(row).map(str::to_owned);
        Ok(Row {
            input: number(&self.input, row)? as usize,
            record: number(&self.record, row)? as usize,
            scenario: text(&self.scenario).ok_or_else(|| missing_value("scenario"))?,
            digest: text(&self.digest).ok_or_else(|| missing_value("digest"))?,
            simulator: text(&self.simulator).ok_or_else(|| missing_value("simulator"))?,
            rollout: self.rollout.whole(row),
            category: text(&self.category),
            difficulty: text(&self.difficulty),
            direction_tracking: text(&self.direction_tracking),
            metrics,
            deviation,
            outcomes,
            notes,
            length,
        })
    }

    /// Returns the names in a list, each with the cells of the parallel lists.
    fn named<const N: usize>(
        &self,
        row: usize,
        names: &View,
        others: [&View; N],
    ) -> Result<Vec<(String, [usize; N])>, Cause> {
        let cells = names.range(0, row);
        let starts = others.map(|other| other.range(0, row));
        for (other, range) in others.iter().zip(&starts) {
            if range.len() != cells.len() {
                let expected = format!("{} elements, as `{}` has", cells.len(), names.name());
                return Err(Cause::value(format!("`{}`", other.name()), range.len(), expected));
            }
        }
        let named = cells.enumerate().map(|(i, cell)| {
            let name = names.text(cell).ok_or_else(|| missing_value(names.name()))?;
            Ok((name.to_owned(), starts.each_ref().map(|range| range.start + i)))
        });
        named.collect()
    }

    fn value(&self, name: &str, kind: &str, numerator: usize, denominator: usize) -> Result<Value, Cause> {
        let above =
            self.numerator.number(numerator).filter(|v| v.is_finite()).ok_or_else(|| missing_value(name))?;
        let below = || self.denominator.whole(denominator).map(u64::from).ok_or_else(|| missing_value(name));
        let count = || match above >= 0.0 && above <= MAX_COUNT as f64 && above.fract() == 0.0 {
            true => Ok(above as u64),
            false => Err(Cause::value(format!("`numerator` of `{name}`"), above, "a count")),
        };
        Ok(match kind {
            "rate" => Value::Rate(count()?, below()?),
            "count" => Value::Count(count()?),
            "mean" => Value::Mean(above, below()?),
            "value" => Value::Value(above),
            other => {
                return Err(Cause::value(format!("`kind` of `{name}`"), other, "rate, count, mean or value"));
            }
        })
    }
}

fn number(view: &View, row: usize) -> Result<u32, Cause> {
    view.whole(row).ok_or_else(|| missing_value(view.name()))
}

fn missing_value(name: &str) -> Cause {
    Cause::value(format!("`{name}`"), "null", "a value")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(record: usize) -> Row {
        let metrics = [
            ("a", Some(Value::Rate(3, 7))),
            ("b", Some(Value::Count(2))),
            ("c", Some(Value::Mean(0.1 + 0.2, 11))),
            ("d", Some(Value::Value(-1.0 / 3.0))),
            ("e", None),
            ("f", Some(Value::Rate(0, 0))),
        ];
        Row {
            input: 1,
            record,
            scenario: format!("scène-{record}"),
            digest: "0".repeat(64),
            simulator: "idm".into(),
            rollout: record.is_multiple_of(2).then_some(record as u32),
            category: record.is_multiple_of(3).then(|| "lateral".into()),
            difficulty: record.is_multiple_of(5).then(|| "hard".into()),
            direction_tracking: record.is_multiple_of(2).then(|| "nearest".into()),
            metrics: metrics.into_iter().take(record % 7).map(|(n, v)| (n.to_owned(), v)).collect(),
            deviation: (0..record % 3).map(|i| (format!("d{i}"), 1e-300 * i as f64)).collect(),
            outcomes: (0..record % 4).map(|i| (format!("o{i}"), i as u64)).collect(),
            notes: (1..record % 3).map(|i| (format!("n{i}"), note(i))).collect(),
            length: (record > 2 && record.is_multiple_of(2))
                .then_some(RowLength { history: 11, steps: record }),
        }
    }

    fn note(count: usize) -> RowNote {
        RowNote { count: count as u32, detail: count.is_multiple_of(2).then(|| "frame 7".into()) }
    }

    #[test]
    fn rows_round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.parquet");
        for count in [0, 1, 2, 300] {
            let rows: Vec<Row> = (0..count).map(row).collect();
            assert_eq!(rows.iter().any(|row| !row.notes.is_empty()), count == 300);
            assert_eq!(rows.iter().any(|row| row.length.is_some()), count == 300);
            write(&path, &rows).unwrap();
            assert_eq!(read(&path).unwrap(), rows);
            let content = std::fs::read(&path).unwrap();
            assert_eq!(read_bytes(&path, content.into()).unwrap(), rows);
        }
    }

    #[test]
    fn counts_beyond_the_columns_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.parquet");
        for value in [Value::Rate(1, 1 << 32), Value::Count(1 << 54), Value::Mean(0.0, 1 << 32)] {
            let many = Row { metrics: [("a".to_owned(), Some(value))].into(), ..row(0) };
            let refused = write(&path, &[many]).unwrap_err().to_string();
            assert!(refused.contains("scène-0") && refused.contains("2^"), "{refused}");
            assert!(!path.exists());
        }
    }
}
