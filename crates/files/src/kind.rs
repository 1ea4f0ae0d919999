//! Kinds of content, which the first bytes tell apart.

use std::io::Read;
use std::path::Path;

use super::regular::open_local;

/// Number of bytes that tell the kind.
pub(super) const HEAD: usize = 8;

/// Returns the kind of the content that begins with these bytes; `None` without content.
pub(super) fn kind_of(head: &[u8]) -> Option<&'static str> {
    let is_text = |byte: &u8| !byte.is_ascii_control() || byte.is_ascii_whitespace();
    match head {
        [] => None,
        [b'P', b'A', b'R', b'1', ..] => Some("Parquet"),
        [b'G', b'I', b'F', b'8', ..] => Some("a GIF"),
        [0x1f, 0x8b, ..] => Some("a gzip archive"),
        [b'<', ..] => Some("an SVG or HTML document"),
        [b'{' | b'[', ..] => Some("JSON"),
        text if text.iter().all(is_text) => Some("text"),
        _ => Some("binary data"),
    }
}

/// Returns the kind of the content of a file; `None` if it is empty or cannot be read.
pub(super) fn kind_at(path: &Path) -> Option<&'static str> {
    let mut head = Vec::new();
    open_local(path).and_then(|file| file.take(HEAD as u64).read_to_end(&mut head)).ok()?;
    kind_of(&head)
}
