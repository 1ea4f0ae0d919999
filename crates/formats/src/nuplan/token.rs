//! Tokens, which identify rows in nuPlan.

use std::fmt;

/// Identifier of a row: 8 bytes, displayed as 16 hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Token([u8; 8]);

impl Token {
    /// Creates a token from 8 bytes; `None` for another number of bytes.
    pub(super) fn of_bytes(bytes: &[u8]) -> Option<Self> {
        bytes.try_into().ok().map(Self)
    }

    /// Parses a token of 16 hexadecimal digits.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let good = text.len() == 16 && text.bytes().all(|b| b.is_ascii_hexdigit());
        good.then(|| u64::from_str_radix(text, 16).ok()).flatten().map(|n| Self(n.to_be_bytes()))
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", u64::from_be_bytes(self.0))
    }
}
