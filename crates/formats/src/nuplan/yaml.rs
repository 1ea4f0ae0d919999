//! YAML mappings of texts and lists of texts. Values keep their text: a token of digits is no number.

use std::collections::BTreeSet;
use std::fmt;

use saphyr_parser::{Event, Parser, ScalarStyle, Span};

/// A value of a mapping.
#[derive(Debug)]
pub(super) enum Node {
    Scalar(Scalar),
    List(Vec<Scalar>),
    /// A mapping, or a list of other things than texts.
    Nested,
}

#[derive(Debug)]
pub(super) struct Scalar {
    pub(super) text: String,
    /// Whether it stands without quotes, so that it may be a number or null.
    is_plain: bool,
}

impl Node {
    pub(super) fn text(&self) -> Option<&str> {
        if let Self::Scalar(scalar) = self { Some(&scalar.text) } else { None }
    }

    /// Returns the text of a scalar without quotes.
    pub(super) fn plain(&self) -> Option<&str> {
        if let Self::Scalar(Scalar { text, is_plain: true }) = self { Some(text) } else { None }
    }

    pub(super) fn is_null(&self) -> bool {
        matches!(self.plain(), Some("" | "~" | "null" | "Null" | "NULL"))
    }
}

impl fmt::Display for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scalar(scalar) => write!(f, "`{}`", scalar.text),
            Self::List(items) => write!(f, "a list of {}", items.len()),
            Self::Nested => f.write_str("nested"),
        }
    }
}

/// Returns the entries of the mapping that a text is, in order.
///
/// # Errors
/// A text that states what is wrong, and the line.
pub(super) fn entries(text: &str) -> Result<Vec<(String, Node)>, String> {
    let mut parser = Parser::new_from_str(text);
    let mut next = || {
        let event = parser.next().unwrap_or(Ok((Event::StreamEnd, Span::default())));
        let (event, span) = event.map_err(|error| format!("not YAML: {error}"))?;
        let wrong = move |expected: &str| format!("line {}: expected {expected}", span.start.line());
        Ok::<_, String>((event, wrong))
    };
    let (mut entries, mut keys) = (Vec::new(), BTreeSet::new());
    let (event, wrong) = loop {
        let (event, wrong) = next()?;
        if !matches!(event, Event::Nothing | Event::StreamStart | Event::DocumentStart(_)) {
            break (event, wrong);
        }
    };
    if !matches!(event, Event::MappingStart(..)) {
        return Err(wrong("a mapping such as `scenario_types: null`"));
    }
    loop {
        let key = match next()? {
            (Event::MappingEnd, _) => break,
            (Event::Scalar(key, ..), _) if keys.insert(key.to_string()) => key.into_owned(),
            (_, wrong) => return Err(wrong("a key that is a text and occurs once")),
        };
        // Parts below a value that are open, and whether it is a list of texts so far.
        let (mut depth, mut items, mut is_nested) = (0_usize, Vec::new(), false);
        let node = loop {
            let (event, wrong) = next()?;
            match event {
                Event::Scalar(text, style, ..) => {
                    let scalar = Scalar { text: text.into_owned(), is_plain: style == ScalarStyle::Plain };
                    if depth == 0 {
                        break Node::Scalar(scalar);
                    }
                    items.push(scalar);
                }
                Event::SequenceStart(..) | Event::MappingStart(..) => {
                    is_nested |= depth > 0 || matches!(event, Event::MappingStart(..));
                    depth += 1;
                }
                Event::SequenceEnd | Event::MappingEnd => depth = depth.saturating_sub(1),
                _ => return Err(wrong("a value, not a reference to one")),
            }
            if depth == 0 {
                break if is_nested { Node::Nested } else { Node::List(items) };
            }
        };
        entries.push((key, node));
    }
    Ok(entries)
}
