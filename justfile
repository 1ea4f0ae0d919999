# Short names for the commands of everyday work: `just check`, `just test metrics`. See CONTRIBUTING.md.

# Lists the commands.
default:
    @'{{ just_executable() }}' --list

# Type checks and lints everything.
check:
    cargo fmt --check
    cargo clippy --locked --release --workspace --all-targets -- -D warnings

# Runs the tests of one area, such as `metrics` or `idm`; without one, all tests.
test AREA="":
    cargo test --release {{ if AREA == "" { "" } else { "-p reactsim-" + AREA } }}

# Runs the benchmarks, or one of them: `just bench throughput`.
bench NAME="":
    cargo bench {{ if NAME == "" { "" } else { "--bench " + NAME } }}

# Builds the documentation of all crates.
docs:
    RUSTDOCFLAGS=-Dwarnings cargo doc --locked --release --workspace --no-deps

# Compares this program with the published numbers, and the tables in the documents with the references.
reference:
    cargo run --release -- verify --quick
    cargo run --release -- reference tables --check README.md docs/*.md docs/*/*.md

# Runs everything that must hold before a change is taken.
ci:
    .ci/run
