//! Motion tokens: vocabularies, how they are built, and how recorded motion is matched to them.
