//! The scenarios that ship with the program.

use crate::evaluation::{FileRecord, Source};
use crate::formats::{decoded, parse_json};

/// Names and texts of the files in `scenarios/mini`, in the order of their names.
const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// One source per shipped file.
pub(super) fn sources() -> Vec<Source> {
    let source = |&(name, text): &(&'static str, &'static str)| Source {
        file: FileRecord::of_text(name, "json", text),
        open: Box::new(move || {
            let scenario = parse_json(name.as_ref(), text.as_bytes());
            Ok(Box::new(std::iter::once(scenario.map(decoded))))
        }),
    };
    FILES.iter().map(source).collect()
}
