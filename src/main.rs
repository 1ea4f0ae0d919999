//! The `reactsim` program.

use std::process::ExitCode;

use mimalloc::MiMalloc;

// Networks allocate tensors of megabytes at every layer; the C library returns each of them to the system.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    reactsim::cli::main()
}
