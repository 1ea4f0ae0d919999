//! The `reactsim` program.

use std::process::ExitCode;

use mimalloc::MiMalloc;

// The networks allocate tensors of megabytes at every layer, which the C library returns to the system each time.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    reactsim::cli::main()
}
