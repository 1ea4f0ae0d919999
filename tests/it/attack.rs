//! Attacks with a fixed seed: changed files of every kind, kills at chosen moments, folders that two
//! processes want, silent children, hostile texts, and small limits of the system. The whole of it takes long
//! and is for releases (`cargo test --release -- --ignored attack parameters`); a part of it runs always.

pub(crate) mod call;
mod changes;
mod children;
mod files;
mod kills;
mod limits;
mod locks;
mod texts;
mod trainings;
