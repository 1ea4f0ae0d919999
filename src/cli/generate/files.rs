//! The files that a command has generated.

use std::path::PathBuf;

/// Files of one generation and how it went.
pub(super) struct GeneratedFiles {
    /// Paths; the first one is `--out`, or the part of it that an interrupted command has finished.
    pub(super) files: Vec<PathBuf>,
    /// Number of scenarios in them.
    pub(super) written: usize,
    /// Number of scenarios that could not be generated.
    pub(super) failed: usize,
    /// Whether quotas of a benchmark could not be filled.
    pub(super) unfilled: bool,
    /// Whether the user interrupted the generation.
    pub(super) interrupted: bool,
}
