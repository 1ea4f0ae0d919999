//! Next-token prediction: agents move by tokens of half a second, drawn from what a network thinks probable.

pub mod smart;
pub mod tokens;
