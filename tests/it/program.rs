//! The program as its user calls it.

use std::process::{Command, Output};

/// Returns a command for the program that was built with these tests.
pub(crate) fn program() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin!("reactsim"))
}

/// Runs the program with these arguments.
pub(crate) fn reactsim(arguments: &[&str]) -> Output {
    program().args(arguments).output().unwrap()
}
