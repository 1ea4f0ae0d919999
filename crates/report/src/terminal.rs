//! Tables for terminals: as wide as the window, with the best values highlighted.

use std::borrow::Cow;
use std::io::{self, Write};

use super::table::{self, Column, Division, Line};
use super::wrap::wrapped;
use super::{Run, TableStyle, markdown};

/// Returns a foreign text for a terminal: characters that control it are shown as `\u{1b}`. Ends of lines and
/// tabs stay.
pub fn plain(text: &str) -> Cow<'_, str> {
    let is_shown = |c: char| c == '\n' || c == '\t' || !is_unsafe(c);
    if text.chars().all(is_shown) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if is_shown(c) { shown.push(c) } else { shown.extend(c.escape_unicode()) }
    }
    Cow::Owned(shown)
}

/// Returns whether a character controls terminals, or the direction of the text around it.
pub(super) fn is_unsafe(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Settings of a table for a terminal.
#[derive(Clone, Copy, Debug)]
pub struct TerminalStyle<'a> {
    /// Width of the window, in characters.
    pub width: usize,
    /// Whether the best values are highlighted.
    pub coloured: bool,
    /// Division of the scenarios whose parts get tables of their own.
    pub by: Option<Division>,
    /// The columns.
    pub table: TableStyle<'a>,
}

/// Largest width of the names of simulators; longer ones are cut.
const MAX_NAME: usize = 34;
/// Largest width of what drives the AV, behind the name of a simulator.
const MAX_AV: usize = 20;
/// Space between two columns.
const GAP: usize = 2;

/// Starts a highlighted value: bold and green.
const HIGHLIGHT: &str = "\x1b[1;32m";
/// Ends it.
const PLAIN: &str = "\x1b[0m";

/// Writes the results of runs.
///
/// # Errors
/// If `out` cannot be written.
pub fn write(runs: &[Run<'_>], style: TerminalStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    let (columns, lines) = (style.table.columns_of(runs), table::lines(runs, None));
    write_table(&columns, &lines, style, out)?;
    let of_av = Column::of_av(runs);
    if !of_av.is_empty() {
        writeln!(out, "\n{}\n", plain(&table::av_title(runs)))?;
        write_table(&of_av, &table::av_lines(runs), style, out)?;
    }
    if let Some(division) = style.by {
        for part in division.parts(runs) {
            let lines = table::lines(runs, Some((division, &part)));
            let n = lines.iter().map(|l| l.scenarios).max().unwrap_or(0);
            let title = markdown::capital(&plain(&division.title(&part)));
            writeln!(out, "\n{title} ({})\n", table::count(n, "scenario"))?;
            write_table(&columns, &lines, style, out)?;
        }
    }
    writeln!(out)?;
    for text in markdown::marks(lines.iter().map(|l| l.marks)) {
        write_wrapped(&format!("{text}."), style.width, out)?;
    }
    if let Some(note) = table::fewer(runs, &columns, None) {
        write_wrapped(&format!("{note}."), style.width, out)?;
    }
    for provenance in table::provenances(runs) {
        write_wrapped(&format!("{provenance}."), style.width, out)?;
    }
    Ok(())
}

/// Writes one table. Columns that do not fit into the window follow in further tables below it.
fn write_table(
    columns: &[Column],
    lines: &[Line<'_>],
    style: TerminalStyle<'_>,
    out: &mut dyn Write,
) -> io::Result<()> {
    let names: Vec<String> = lines.iter().map(name).collect();
    let name_width = names.iter().map(|name| length(name)).max().unwrap_or(0);
    let columns: Vec<TextColumn> = columns.iter().map(|column| TextColumn::new(column, lines)).collect();
    let mut rest = &columns[..];
    while !rest.is_empty() {
        let mut left = style.width.saturating_sub(name_width);
        let fits = |column: &&TextColumn| {
            let fits = column.width <= left;
            left = left.saturating_sub(column.width);
            fits
        };
        // A window narrower than a name and a number gets one column at a time.
        let (block, others) = rest.split_at(rest.iter().take_while(fits).count().max(1));
        write_block(&names, name_width, block, style.coloured, out)?;
        rest = others;
        if !rest.is_empty() {
            writeln!(out)?;
        }
    }
    Ok(())
}

/// Writes columns next to each other: heads of several lines, then a row per simulator.
fn write_block(
    names: &[String],
    name_width: usize,
    columns: &[TextColumn],
    coloured: bool,
    out: &mut dyn Write,
) -> io::Result<()> {
    let heads = columns.iter().map(|column| column.head.len()).max().unwrap_or(0);
    for i in 0..heads {
        // Heads end in the same line.
        let parts = columns.iter().map(|column| {
            let own = (i + column.head.len()).checked_sub(heads);
            own.map_or("", |own| column.head[own].as_str())
        });
        let text: String = columns.iter().zip(parts).map(|(column, part)| column.padded(part)).collect();
        writeln!(out, "{}{text}", " ".repeat(name_width))?;
    }
    for (row, name) in names.iter().enumerate() {
        write!(out, "{name}{}", " ".repeat(name_width - length(name)))?;
        for column in columns {
            let text = column.padded(&column.cells[row]);
            match coloured && column.best[row] {
                true => write!(out, "{HIGHLIGHT}{text}{PLAIN}")?,
                false => write!(out, "{text}")?,
            }
        }
        writeln!(out)?;
    }
    Ok(())
}

/// A column with its texts.
struct TextColumn {
    head: Vec<String>,
    cells: Vec<String>,
    /// Whether the value of a row is highlighted.
    best: Vec<bool>,
    /// Characters of the widest text and the gap to its left.
    width: usize,
}

impl TextColumn {
    fn new(column: &Column, lines: &[Line<'_>]) -> Self {
        let cells: Vec<String> =
            lines.iter().map(|line| markdown::cell(column, line.metrics.get(column.metric))).collect();
        let head: Vec<String> = column.head().split(' ').map(str::to_owned).collect();
        let widest = head.iter().chain(&cells).map(|text| length(text)).max().unwrap_or(0);
        Self { head, best: table::best(column, lines), cells, width: widest + GAP }
    }

    /// Returns a text aligned to the right.
    fn padded(&self, text: &str) -> String {
        format!("{}{text}", " ".repeat(self.width - length(text)))
    }
}

/// Returns the name of a simulator with its mark, and its run and AV if there are several.
fn name(line: &Line<'_>) -> String {
    let run = line.run.map(|run| format!("{run}: ")).unwrap_or_default();
    let mark = line.marks.signs();
    let name = format!("{run}{}", line.title);
    let room = MAX_NAME - if mark.is_empty() { 0 } else { length(&mark) + 1 };
    let name = cut(&name, room);
    let av = line.av.map(|av| format!(" · {}", cut(av, MAX_AV))).unwrap_or_default();
    format!("{}{av}", format!("{name} {mark}").trim_end())
}

/// Returns a name of at most `room` characters, none of which controls terminals.
fn cut(name: &str, room: usize) -> String {
    let mut shown: String = name.chars().take(room).collect();
    if length(name) > room {
        shown.pop();
        shown.push('…');
    }
    shown.retain(|c| !is_unsafe(c));
    shown
}

/// Writes a text in lines of the width of the window.
fn write_wrapped(text: &str, width: usize, out: &mut dyn Write) -> io::Result<()> {
    wrapped(&plain(text), width).iter().try_for_each(|line| writeln!(out, "{line}"))
}

fn length(text: &str) -> usize {
    text.chars().count()
}
