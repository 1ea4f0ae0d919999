//! Rows of text as aligned columns.

use std::io::{self, Write};

use crate::report::wrap;

/// Largest number of columns of a wrapped line.
const MAX_WIDTH: usize = 80;
/// Smallest width of the wrapped last column, whatever the others take.
const MIN_LAST_WIDTH: usize = 20;

/// Writes rows as aligned columns; the last column is not padded.
pub(super) fn aligned(rows: &[Vec<String>], out: &mut dyn Write) -> io::Result<()> {
    write_rows(rows, None, out)
}

/// Writes rows as aligned columns; the last column is wrapped at 80 columns.
pub(super) fn wrapped(rows: &[Vec<String>], out: &mut dyn Write) -> io::Result<()> {
    let before: usize = widths(rows).iter().rev().skip(1).map(|width| width + 2).sum();
    write_rows(rows, Some(MAX_WIDTH.saturating_sub(before).max(MIN_LAST_WIDTH)), out)
}

/// Returns the width of every column.
fn widths(rows: &[Vec<String>]) -> Vec<usize> {
    let columns = rows.first().map_or(0, Vec::len);
    (0..columns).map(|c| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0)).collect()
}

/// Writes rows whose last column has at most `last_width` characters per line, or any number.
fn write_rows(rows: &[Vec<String>], last_width: Option<usize>, out: &mut dyn Write) -> io::Result<()> {
    let widths = widths(rows);
    for row in rows {
        let Some((last, before)) = row.split_last() else { continue };
        let mut indent = 0;
        for (text, width) in before.iter().zip(&widths) {
            write!(out, "{text}{}  ", " ".repeat(width - text.chars().count()))?;
            indent += width + 2;
        }
        let lines = last_width.map_or_else(|| vec![last.clone()], |width| wrap::wrapped(last, width));
        for (n, line) in lines.iter().enumerate() {
            let indent = if n == 0 { 0 } else { indent };
            writeln!(out, "{}{line}", " ".repeat(indent))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<Vec<String>> {
        let long = "one two three four five six seven eight nine ten eleven twelve thirteen fourteen";
        vec![vec!["a".into(), "m/s²".into(), long.into()], vec!["abc".into(), "1".into(), "x".into()]]
    }

    #[test]
    fn the_last_column_is_wrapped_between_words() {
        let mut out = Vec::new();
        wrapped(&rows(), &mut out).unwrap();
        let expected = "a    m/s²  one two three four five six seven eight nine ten eleven twelve\n\
                        \u{20}          thirteen fourteen\n\
                        abc  1     x\n";
        assert_eq!(String::from_utf8(out).unwrap(), expected);
    }

    #[test]
    fn aligned_rows_are_one_line_each() {
        let mut out = Vec::new();
        aligned(&rows(), &mut out).unwrap();
        assert_eq!(String::from_utf8(out).unwrap().lines().count(), 2);
    }
}
