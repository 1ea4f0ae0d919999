//! Rows of text as aligned columns.

use std::io::{self, Write};

/// Largest number of columns of a wrapped line.
const MAX_WIDTH: usize = 80;
/// Smallest width of the wrapped last column, whatever the others take.
const MIN_LAST_WIDTH: usize = 20;

/// Writes rows as aligned columns; the last column is not padded.
pub(super) fn aligned(rows: &[Vec<String>], out: &mut dyn Write) -> io::Result<()> {
    write_rows(rows, usize::MAX, out)
}

/// Writes rows as aligned columns; the last column is wrapped at 80 columns.
pub(super) fn wrapped(rows: &[Vec<String>], out: &mut dyn Write) -> io::Result<()> {
    let before: usize = widths(rows).iter().rev().skip(1).map(|width| width + 2).sum();
    write_rows(rows, MAX_WIDTH.saturating_sub(before).max(MIN_LAST_WIDTH), out)
}

/// Returns the width of every column.
fn widths(rows: &[Vec<String>]) -> Vec<usize> {
    let columns = rows.first().map_or(0, Vec::len);
    (0..columns).map(|c| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0)).collect()
}

/// Writes rows whose last column has at most `last_width` characters per line.
fn write_rows(rows: &[Vec<String>], last_width: usize, out: &mut dyn Write) -> io::Result<()> {
    let widths = widths(rows);
    for row in rows {
        let Some((last, before)) = row.split_last() else { continue };
        let mut indent = 0;
        for (text, width) in before.iter().zip(&widths) {
            write!(out, "{text}{}  ", " ".repeat(width - text.chars().count()))?;
            indent += width + 2;
        }
        for (n, line) in lines(last, last_width).iter().enumerate() {
            let indent = if n == 0 { 0 } else { indent };
            writeln!(out, "{}{line}", " ".repeat(indent))?;
        }
    }
    Ok(())
}

/// Splits a text into lines of at most `width` characters between words; a longer word is not split.
fn lines(text: &str, width: usize) -> Vec<String> {
    if width == usize::MAX {
        return vec![text.to_owned()];
    }
    let mut lines: Vec<String> = vec![String::new()];
    for word in text.split_whitespace() {
        let last = lines.len() - 1;
        let line = &mut lines[last];
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= width {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
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
