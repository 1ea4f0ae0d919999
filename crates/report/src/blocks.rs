//! Tables of references in Markdown files, between markers, so that no number is copied by hand.
//!
//! ```text
//! <!-- table references/reactsim-bench-v1 columns=aav-collision,ade models=idm,stop difficulty=hard -->
//! <!-- end -->
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use reactsim_evaluation::reference::{Part, Reference, ReferenceError};

use super::markdown::{escape, write_table};
use super::table::{self, COLUMNS, Column, Line};

const BEGIN: &str = "<!-- table ";
const CLOSE: &str = "-->";
const END: &str = "<!-- end -->";

/// A table between two markers.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Line of the opening marker, from 1.
    pub line: usize,
    /// Content of the opening marker, which names the block.
    pub name: String,
    /// Folder of the reference.
    pub reference: String,
    /// Selected part of its table.
    pub selection: Selection,
    /// Byte range of the table in the text, markers excluded.
    pub place: Range<usize>,
}

/// Selected part of a table.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Columns in order; if empty, those of a report.
    pub columns: Vec<Column>,
    /// Ids of simulators in order; if empty, all.
    pub models: Vec<String>,
    /// Scenarios that the table covers.
    pub part: Part,
}

/// Error in the blocks of a text.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BlockError {
    /// A marker is malformed.
    #[error("line {line}: {reason}")]
    Mark {
        /// Line, from 1.
        line: usize,
        /// Reason and remedy.
        reason: String,
    },
}

/// Finds the blocks of a Markdown text. Markers inside fenced code are ignored.
///
/// # Errors
/// [`BlockError`] with the line of a marker that is malformed or not closed.
pub fn blocks(text: &str) -> Result<Vec<Block>, BlockError> {
    let mut blocks: Vec<Block> = Vec::new();
    let (mut at, mut fenced) = (0, false);
    let mut open: Option<Block> = None;
    for (line, whole) in (1..).zip(text.split_inclusive('\n')) {
        let (start, trimmed) = (at, whole.trim());
        at += whole.len();
        fenced ^= trimmed.starts_with("```");
        let wrong = |reason: &str| BlockError::Mark { line, reason: reason.to_owned() };
        if fenced {
            continue;
        }
        if let Some(mark) = trimmed.strip_prefix(BEGIN) {
            let mark = mark.strip_suffix(CLOSE).ok_or_else(|| wrong("the marker does not end with `-->`"))?;
            if let Some(earlier) = &open {
                return Err(wrong(&format!("the table of line {} is not ended with `{END}`", earlier.line)));
            }
            open = Some(parse(line, mark.trim(), at).map_err(|reason| wrong(&reason))?);
        } else if trimmed == END {
            let mut block = open.take().ok_or_else(|| wrong("no table begins before this end"))?;
            block.place.end = start;
            blocks.push(block);
        }
    }
    match open {
        Some(Block { line, .. }) => {
            Err(BlockError::Mark { line, reason: format!("the table is not ended with `{END}`") })
        }
        None => Ok(blocks),
    }
}

fn parse(line: usize, mark: &str, at: usize) -> Result<Block, String> {
    let mut words = mark.split_whitespace();
    let reference =
        words.next().ok_or("the marker names no reference: write `<!-- table references/NAME -->`")?;
    let (mut selection, mut keys) = (Selection::default(), BTreeSet::new());
    for word in words {
        let (key, value) = word.split_once('=').ok_or_else(|| format!("`{word}` is not KEY=VALUE"))?;
        if !keys.insert(key) {
            return Err(format!("`{key}` is given twice"));
        }
        match key {
            "columns" => {
                for id in value.split(',') {
                    let known = || COLUMNS.iter().map(|c| c.metric).collect::<Vec<_>>().join(", ");
                    let column = Column::of(id);
                    let column = column.ok_or_else(|| format!("no column `{id}`; there are: {}", known()))?;
                    selection.columns.push(column);
                }
            }
            "models" => selection.models = value.split(',').map(str::to_owned).collect(),
            "category" | "difficulty" if selection.part != Part::All => {
                return Err("give either a category or a difficulty".to_owned());
            }
            "category" => selection.part = Part::Category(value.to_owned()),
            "difficulty" => selection.part = Part::Difficulty(value.to_owned()),
            _ => return Err(format!("no key `{key}`; there are: columns, models, category, difficulty")),
        }
    }
    let (name, reference) = (mark.to_owned(), reference.to_owned());
    Ok(Block { line, name, reference, selection, place: at..at })
}

/// Renders the table of a block as in a report of the reference, with a line on its source below.
///
/// # Errors
/// [`ReferenceError`] if the reference lacks a simulator or has no scenarios of this part.
pub fn render(reference: &Reference, selection: &Selection) -> Result<String, ReferenceError> {
    let summary = &reference.summary;
    let part = reference.part(&selection.part)?;
    let order: Vec<&str> = match selection.models.as_slice() {
        [] => summary.order().map(|(id, _, _)| id).collect(),
        models => models.iter().map(String::as_str).collect(),
    };
    let titles: BTreeMap<&str, &str> = summary.order().map(|(id, title, _)| (id, title)).collect();
    let mut lines = Vec::new();
    for id in order {
        let (Some(title), Some(simulator)) = (titles.get(id), summary.simulators.get(id)) else {
            let known = titles.keys().copied().collect::<Vec<_>>().join(", ");
            let reason = format!("no simulator `{id}`; there are: {known}");
            return Err(ReferenceError::unfit(&reference.place, reason));
        };
        let Some(of_part) = part.get(id) else { continue };
        lines.push(Line {
            run: None,
            av: None,
            group: 0,
            title,
            marks: simulator.marks(),
            scenarios: of_part.scenarios,
            failed: 0,
            metrics: &of_part.metrics,
        });
    }
    let columns = match selection.columns.as_slice() {
        [] => Column::used(&[summary], &[]),
        columns => columns.to_vec(),
    };
    let scenarios = lines.iter().map(|l| l.scenarios).max().unwrap_or(0);
    let mut text = Vec::new();
    write_table(&mut text, &columns, &lines, false).expect("writing to memory does not fail");
    let mut text = String::from_utf8_lossy(&text).into_owned();
    let what = match &selection.part {
        Part::All => String::new(),
        Part::Category(name) => format!("{name} deviations, "),
        Part::Difficulty(name) => format!("difficulty {name}, "),
    };
    let run = &summary.provenance.run;
    let benchmark = run.benchmark.as_ref().map(|b| format!("{b}, ")).unwrap_or_default();
    let (scenarios, program) = (table::count(scenarios, "scenario"), table::program(run));
    text.push_str(&format!("\n{}.\n", escape(&format!("{benchmark}{what}{scenarios}, {program}"))));
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_found_but_not_in_code() {
        let text = "# a\n<!-- table references/x columns=ade,progress models=idm difficulty=hard -->\nold\n\
                    <!-- end -->\n```\n<!-- table y -->\n```\n<!-- table y -->\n<!-- end -->\n";
        let found = blocks(text).unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].line, found[0].reference.as_str()), (2, "references/x"));
        assert_eq!(&text[found[0].place.clone()], "old\n");
        assert_eq!(
            found[0].selection.columns.iter().map(|c| c.metric).collect::<Vec<_>>(),
            ["ade", "progress"]
        );
        assert_eq!(found[0].selection.part, Part::Difficulty("hard".into()));
        assert_eq!((found[1].line, &text[found[1].place.clone()]), (8, ""));
    }

    #[test]
    fn wrong_marks_are_named() {
        for (text, part) in [
            ("<!-- table x -->\n", "line 1: the table is not ended"),
            ("<!-- end -->\n", "no table begins"),
            ("<!-- table x -->\n<!-- table y -->\n", "the table of line 1 is not ended"),
            ("<!-- table x columns=speed -->\n<!-- end -->\n", "no column `speed`; there are: aav-collision"),
            ("<!-- table x rows=1 -->\n<!-- end -->\n", "no key `rows`"),
            ("<!-- table x hard -->\n<!-- end -->\n", "`hard` is not KEY=VALUE"),
            ("<!-- table x category=a difficulty=b -->\n<!-- end -->\n", "either a category or a difficulty"),
            ("<!-- table x\n", "does not end with"),
        ] {
            let refused = blocks(text).unwrap_err().to_string();
            assert!(refused.contains(part), "{text}: {refused}");
        }
    }
}
