//! `reactsim generate`: synthetic scenarios.

mod bench;
mod files;
mod make;
mod manifest;
mod partition;
mod scenario_file;
mod tried;

pub(super) use make::{GenerateArgs, generate};
pub(super) use partition::merge;

const AFTER: &str = "\
The preset train writes scenarios as they are generated. The preset sensed makes traffic with the \
speeds of recordings, and adds the noise and the gaps of sensors. The preset bench curates \
scenarios and keeps those with a deviated AV until the quotas of all categories and map types are \
filled. It writes the candidates, as `curate` does, to a second file next to FILE.

Examples:
  reactsim generate --preset bench --count 150 --out bench.parquet
  reactsim run bench.parquet
  reactsim curate stats bench.deviations.parquet

The manifest entry of the files is printed to stdout (TOML): command, settings and digests.";
