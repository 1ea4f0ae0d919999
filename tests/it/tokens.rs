//! Motion tokens: vocabularies, their files, and the matching of recorded motion.

mod vocabulary;
