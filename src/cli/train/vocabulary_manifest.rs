//! Manifest entries of vocabularies: sources, settings and errors.

use std::path::Path;

use serde::Serialize;

use crate::evaluation::FileRecord;
use crate::models::learning::Provenance;
use crate::models::ntp::tokens::{MapVocabulary, MatchingErrors, Vocabulary};
use crate::models::perception::Class;

/// One vocabulary.
#[derive(Serialize)]
pub(super) struct Entry {
    id: String,
    file: String,
    bytes: u64,
    blake3: String,
    method: String,
    seed: u64,
    scenarios: u64,
    /// Digest of the scenarios.
    #[serde(skip_serializing_if = "String::is_empty")]
    data: String,
    /// Settings as JSON, as in the file.
    settings: String,
    tokens: Vec<Tokens>,
}

/// The tokens of one class.
#[derive(Serialize)]
struct Tokens {
    class: &'static str,
    tokens: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    error_mean: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error_p50: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error_p99: Option<f64>,
}

impl Entry {
    /// Creates the entry of a map vocabulary.
    pub(super) fn of_map_vocabulary(file: FileRecord, map: &MapVocabulary) -> Self {
        let tokens =
            Tokens { class: "map", tokens: map.tokens(), error_mean: None, error_p50: None, error_p99: None };
        Self::new(file, map.provenance(), vec![tokens])
    }

    fn new(file: FileRecord, provenance: &Provenance, tokens: Vec<Tokens>) -> Self {
        let id = Path::new(&file.name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let Provenance { method, settings, seed, scenarios, data } = provenance.clone();
        let settings = settings.to_string();
        let FileRecord { name, bytes, blake3, .. } = file;
        Self { id, file: name, bytes, blake3, method, seed, scenarios, data, settings, tokens }
    }

    /// Creates the entry of a motion vocabulary with its matching errors.
    pub(super) fn of_vocabulary(file: FileRecord, vocabulary: &Vocabulary, errors: &MatchingErrors) -> Self {
        let short = |v: f64| (v * 1e5).round() / 1e5;
        let tokens = Class::ALL.map(|class| {
            let error = errors.of(class);
            Tokens {
                class: class.name(),
                tokens: vocabulary.tokens(class),
                error_mean: error.map(|e| short(e.mean)),
                error_p50: error.map(|e| short(e.p50)),
                error_p99: error.map(|e| short(e.p99)),
            }
        });
        Self::new(file, vocabulary.provenance(), tokens.into())
    }
}
