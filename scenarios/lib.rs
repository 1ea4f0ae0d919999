//! The scenarios that ship with `reactsim`, as data. A crate of their own keeps packages below the size limit
//! of the registry.

#![no_std]

/// `bench.parquet`: the shipped benchmark. Generated; the manifest states the command that makes it.
pub static BENCH: &[u8] = include_bytes!("bench.parquet");

/// `manifest.toml`: sizes, digests and commands of all scenario files, including known benchmarks that do
/// not ship.
pub static MANIFEST: &str = include_str!("manifest.toml");
