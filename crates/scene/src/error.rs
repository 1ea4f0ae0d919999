//! The error of an invalid scenario.

use std::borrow::Cow;

/// The reason why parts do not form a scenario. The text names the field and the value; formats add file and
/// record.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("scenario `{scenario}`: {field} is {}, expected {expected}", brief(value))]
pub struct SceneError {
    /// Id of the scenario, possibly empty.
    pub scenario: String,
    /// Path of the field, such as `agents[3].track[17].x`.
    pub field: String,
    /// The value found.
    pub value: String,
    /// The expected value.
    pub expected: String,
}

/// Largest number of characters of a foreign text in a message.
const MAX_TEXT_LENGTH: usize = 4000;

/// Returns a text for a message: a number with more than 24 characters in exponential notation, and the
/// beginning of a very long text.
pub fn brief(text: &str) -> Cow<'_, str> {
    match text.parse::<f64>() {
        Ok(number) if text.len() > 24 => return format!("{number:e}").into(),
        _ => {}
    }
    match text.char_indices().nth(MAX_TEXT_LENGTH) {
        Some((end, _)) => format!("{} …", &text[..end]).into(),
        None => text.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_numbers_are_short() {
        assert_eq!(brief(&1e300.to_string()), "1e300");
        assert_eq!(brief(&(-1e-300).to_string()), "-1e-300");
        assert_eq!(brief("12.5"), "12.5");
        assert_eq!(
            brief("a text of more than twenty-four characters"),
            "a text of more than twenty-four characters"
        );
        assert_eq!(brief(&"ä".repeat(300_000)), format!("{} …", "ä".repeat(4000)));
    }
}
