//! Rows in Parquet: the content of `rows.jsonl`, without loss.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use reactsim_formats::{
    Cause, FormatError,
    table::{Batch, Column, Leaf, TableReader, TableWriter, Value as Cell, View},
};
use reactsim_metrics::{REMOVED_METRICS, Score};

use crate::row::{Row, RowLength, RowNote};

/// Kind of the file in its metadata.
const KIND: &str = "reactsim-rows";
/// Format version in the metadata.
const VERSION: u32 = 1;
/// Number of rows per row group.
const GROUP_ROWS: usize = 4096;
/// Maximum count that a floating-point number represents exactly.
const MAX_COUNT: u64 = 1 << 53;

/// Name, type and depth of a column, and whether cells may be null.
type Shape = (&'static str, Leaf, usize, bool);

/// The columns of every file.
const COLUMNS: [Shape; 17] = [
    ("input", Leaf::Whole, 0, false),
    ("record", Leaf::Whole, 0, false),
    ("scenario", Leaf::Text, 0, false),
    ("digest", Leaf::Text, 0, false),
    ("simulator", Leaf::Text, 0, false),
    ("rollout", Leaf::Whole, 0, true),
    ("category", Leaf::Text, 0, true),
    ("difficulty", Leaf::Text, 0, true),
    ("direction_tracking", Leaf::Text, 0, true),
    ("metric", Leaf::Text, 1, false),
    ("kind", Leaf::Text, 1, true),
    ("numerator", Leaf::Number, 1, true),
    ("denominator", Leaf::Whole, 1, true),
    ("deviation", Leaf::Text, 1, false),
    ("deviation_value", Leaf::Number, 1, false),
    ("outcome", Leaf::Text, 1, false),
    ("outcome_count", Leaf::Whole, 1, false),
];
/// The columns of files in which a row has notes: most runs have none.
const NOTES: [Shape; 3] = [
    ("note", Leaf::Text, 1, false),
    ("note_count", Leaf::Whole, 1, false),
    ("note_detail", Leaf::Text, 1, true),
];
/// The columns of files in which a scenario is longer or shorter than those of the benchmark.
const LENGTH: [Shape; 2] = [("history", Leaf::Whole, 0, true), ("steps", Leaf::Whole, 0, true)];

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
    let has_notes = rows.iter().any(|row| !row.notes.is_empty());
    let has_lengths = rows.iter().any(|row| row.length.is_some());
    let notes = NOTES.iter().filter(|_| has_notes);
    let length = LENGTH.iter().filter(|_| has_lengths);
    let columns = COLUMNS.iter().chain(notes).chain(length);
    let columns = columns.map(|&(name, leaf, depth, nullable)| Column::new(name, leaf, depth, nullable));
    let mut table = TableWriter::create(path, (KIND, VERSION), GROUP_ROWS, columns.collect())?;
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

fn split(name: &str, score: Score) -> Result<Split, Cause> {
    let exact = |n: u64| match n <= MAX_COUNT {
        true => Ok(n as f64),
        false => Err(Cause::value(name, n, "at most 2^53")),
    };
    Ok(match score {
        Score::Rate { hits, valid } => ("rate", exact(hits)?, Some(whole(name, valid)?)),
        Score::Count(n) => ("count", exact(n)?, None),
        Score::Mean { sum, n } => ("mean", sum, Some(whole(name, n)?)),
        Score::Value(v) => ("value", v, None),
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

/// The columns of a batch of rows, by name. Those of notes and of the length may be absent.
struct Columns {
    len: usize,
    views: BTreeMap<&'static str, View>,
}

impl Columns {
    fn of(batch: &Batch) -> Result<Self, Cause> {
        let mut views = BTreeMap::new();
        for group in [&COLUMNS[..], &NOTES, &LENGTH] {
            let (first, leaf, depth, _) = group[0];
            let is_there = first == COLUMNS[0].0 || View::find(batch, first, leaf, depth)?.is_some();
            for &(name, leaf, depth, _) in group.iter().filter(|_| is_there) {
                views.insert(name, View::need(batch, name, leaf, depth)?);
            }
        }
        Ok(Self { len: batch.num_rows(), views })
    }

    fn row(&self, row: usize) -> Result<Row, Cause> {
        let view = |name: &str| &self.views[name];
        let mut metrics = BTreeMap::new();
        for (name, [kind, numerator, denominator]) in
            self.named(row, "metric", ["kind", "numerator", "denominator"])?
        {
            if REMOVED_METRICS.contains(&name.as_str()) {
                continue;
            }
            let value = match view("kind").text(kind) {
                None => None,
                Some(kind) => Some(self.value(&name, kind, numerator, denominator)?),
            };
            metrics.insert(name, value);
        }
        let mut deviation = BTreeMap::new();
        for (name, [cell]) in self.named(row, "deviation", ["deviation_value"])? {
            let value = view("deviation_value").number(cell).ok_or_else(|| missing_value(&name))?;
            deviation.insert(name, value);
        }
        let mut outcomes = BTreeMap::new();
        for (name, [cell]) in self.named(row, "outcome", ["outcome_count"])? {
            let count = view("outcome_count").whole(cell).ok_or_else(|| missing_value(&name))?;
            outcomes.insert(name, count.into());
        }
        let mut notes = BTreeMap::new();
        if self.views.contains_key("note") {
            for (id, [count, detail]) in self.named(row, "note", ["note_count", "note_detail"])? {
                let count = view("note_count").whole(count).ok_or_else(|| missing_value(&id))?;
                let detail = view("note_detail").text(detail).map(str::to_owned);
                notes.insert(id, RowNote { count, detail });
            }
        }
        let frames = |name: &str| self.views.get(name).and_then(|view| view.whole(row));
        let length = frames("history").zip(frames("steps"));
        let number = |name: &str| view(name).whole(row).ok_or_else(|| missing_value(name));
        let text = |name: &str| view(name).text(row).map(str::to_owned);
        let stated = |name: &str| text(name).ok_or_else(|| missing_value(name));
        Ok(Row {
            input: number("input")? as usize,
            record: number("record")? as usize,
            scenario: stated("scenario")?,
            digest: stated("digest")?,
            simulator: stated("simulator")?,
            rollout: view("rollout").whole(row),
            category: text("category"),
            difficulty: text("difficulty"),
            direction_tracking: text("direction_tracking"),
            metrics,
            deviation,
            outcomes,
            notes,
            length: length
                .map(|(history, steps)| RowLength { history: history as usize, steps: steps as usize }),
        })
    }

    /// Returns the names in a list, each with the cells of the parallel lists.
    fn named<const N: usize>(
        &self,
        row: usize,
        names: &str,
        others: [&str; N],
    ) -> Result<Vec<(String, [usize; N])>, Cause> {
        let (names, others) = (&self.views[names], others.map(|other| &self.views[other]));
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

    fn value(&self, name: &str, kind: &str, numerator: usize, denominator: usize) -> Result<Score, Cause> {
        let above = self.views["numerator"]
            .number(numerator)
            .filter(|v| v.is_finite())
            .ok_or_else(|| missing_value(name))?;
        let below =
            || self.views["denominator"].whole(denominator).map(u64::from).ok_or_else(|| missing_value(name));
        let count = || match above >= 0.0 && above <= MAX_COUNT as f64 && above.fract() == 0.0 {
            true => Ok(above as u64),
            false => Err(Cause::value(format!("`numerator` of `{name}`"), above, "a count")),
        };
        Ok(match kind {
            "rate" => Score::Rate { hits: count()?, valid: below()? },
            "count" => Score::Count(count()?),
            "mean" => Score::Mean { sum: above, n: below()? },
            "value" => Score::Value(above),
            other => {
                return Err(Cause::value(format!("`kind` of `{name}`"), other, "rate, count, mean or value"));
            }
        })
    }
}

fn missing_value(name: &str) -> Cause {
    Cause::value(format!("`{name}`"), "null", "a value")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(record: usize) -> Row {
        let metrics = [
            ("a", Some(Score::Rate { hits: 3, valid: 7 })),
            ("b", Some(Score::Count(2))),
            ("c", Some(Score::Mean { sum: 0.1 + 0.2, n: 11 })),
            ("d", Some(Score::Value(-1.0 / 3.0))),
            ("e", None),
            ("f", Some(Score::Rate { hits: 0, valid: 0 })),
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
        for value in [
            Score::Rate { hits: 1, valid: 1 << 32 },
            Score::Count(1 << 54),
            Score::Mean { sum: 0.0, n: 1 << 32 },
        ] {
            let many = Row { metrics: [("a".to_owned(), Some(value))].into(), ..row(0) };
            let refused = write(&path, &[many]).unwrap_err().to_string();
            assert!(refused.contains("scène-0") && refused.contains("2^"), "{refused}");
            assert!(!path.exists());
        }
    }
}
