//! Changes to the content of a file.

use rand::{Rng, RngExt};

/// Returns a content with one change, drawn at random: bytes flipped, cut out, repeated, inserted or zeroed,
/// the end cut off, a number or a word of a text replaced.
pub(crate) fn changed(content: &[u8], rng: &mut impl Rng) -> Vec<u8> {
    let mut bytes = content.to_vec();
    if bytes.is_empty() {
        return b"x".to_vec();
    }
    let at = rng.random_range(0..bytes.len());
    let end = (at + rng.random_range(1..64)).min(bytes.len());
    match rng.random_range(0..8) {
        0 => bytes[at] ^= 1 << rng.random_range(0..8),
        1 => bytes.truncate(at),
        2 => drop(bytes.drain(at..end)),
        3 => {
            let part = bytes[at..end].to_vec();
            bytes.splice(at..at, part);
        }
        4 => bytes[at..end].fill(0),
        5 => bytes.extend_from_slice(&content[at..end]),
        6 => replace_number(&mut bytes, at, rng),
        _ => replace_word(&mut bytes, at, rng),
    }
    bytes
}

/// Numbers that programs stumble over.
const NUMBERS: [&str; 12] = [
    "0",
    "-1",
    "1e300",
    "-1e300",
    "1e-300",
    "NaN",
    "null",
    "18446744073709551616",
    "-0.0",
    "\"1\"",
    "[]",
    "1e9",
];

/// Replaces the first number after a position in a text.
fn replace_number(bytes: &mut Vec<u8>, at: usize, rng: &mut impl Rng) {
    let is_part = |b: &u8| b.is_ascii_digit() || matches!(b, b'.' | b'-' | b'e');
    let Some(first) = bytes[at..].iter().position(u8::is_ascii_digit).map(|n| at + n) else {
        bytes[at] = b'{';
        return;
    };
    let length = bytes[first..].iter().take_while(|b| is_part(b)).count();
    bytes.splice(first..first + length, NUMBERS[rng.random_range(0..NUMBERS.len())].bytes());
}

/// Replaces the first word in quotation marks after a position in a text.
fn replace_word(bytes: &mut Vec<u8>, at: usize, rng: &mut impl Rng) {
    let Some(first) = bytes[at..].iter().position(|b| *b == b'"').map(|n| at + n + 1) else {
        bytes[at] = b'"';
        return;
    };
    let length = bytes[first..].iter().take_while(|b| **b != b'"').count();
    let words = ["", "x", "../../x", "\\u0000", "é\\n", "idm", "log-replay"];
    bytes.splice(first..first + length, words[rng.random_range(0..words.len())].bytes());
}
