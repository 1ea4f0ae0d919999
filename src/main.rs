//! The `reactsim` program.

use std::process::ExitCode;

fn main() -> ExitCode {
    reactsim::cli::main()
}
