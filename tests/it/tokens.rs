//! Motion tokens: vocabularies, their files, and the matching of recorded motion.

mod building;
mod command;
mod golden;
mod map;
mod matching;
mod vocabulary;
