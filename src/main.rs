//! The `reactsim` program.
fn main() {}
