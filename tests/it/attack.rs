//! Attacks with a fixed seed: changed files of every kind, and kills at chosen moments. The whole of it takes
//! long and is for releases (`cargo test --release -- --ignored attack parameters`); a part of it runs
//! always.

pub(crate) mod call;
mod changes;
mod files;
mod kills;
mod trainings;
