//! `study.json`: the members of a study.

use std::fs;
use std::io;
use std::path::Path;

use serde::Deserialize;
use serde::de::Error as _;

use super::Study;
use crate::error::EvaluationError;
use crate::folder::cannot_read;
use crate::layout::{STUDY, SUMMARY};

/// Kind of studies that only earlier versions have.
const REMOVED_KIND: &str = "vocabulary";

/// The kind of a study.
#[derive(Deserialize)]
struct Kind {
    kind: String,
}

/// Returns whether a folder contains a study, finished or not.
pub fn is_study(folder: &Path) -> bool {
    folder.join(STUDY).is_file()
}

/// Reads the study in a folder, whose members are finished runs in its subfolders.
///
/// # Errors
/// [`EvaluationError`] if there is none, it is damaged, or members are not finished; names these members.
pub fn read_study(folder: &Path) -> Result<Study, EvaluationError> {
    let study = read(folder)?;
    let names = study.members.iter().map(|m| m.folder.as_str());
    let unfinished: Vec<&str> = names.filter(|name| !folder.join(name).join(SUMMARY).is_file()).collect();
    if !unfinished.is_empty() {
        let (place, members) = (folder.display(), unfinished.join(", "));
        let text = format!("the study in {place} is not finished ({members})");
        return Err(EvaluationError::Resumable(text));
    }
    Ok(study)
}

/// Reads the study in a folder, finished or not.
pub(super) fn read(folder: &Path) -> Result<Study, EvaluationError> {
    let path = folder.join(STUDY);
    let text = match fs::read_to_string(&path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            let text = format!("{} is not a study: it has no study.json", folder.display());
            return Err(EvaluationError::Refused(text));
        }
        other => other.map_err(cannot_read(&path))?,
    };
    let damaged = |source| EvaluationError::Damaged { path: path.clone(), source };
    let Kind { kind } = serde_json::from_str(&text).map_err(damaged)?;
    if kind == REMOVED_KIND {
        let gone =
            "studies of motion tokens are of earlier versions: show the runs in its subfolders one by one";
        return Err(damaged(serde_json::Error::custom(format_args!("its kind is `{kind}`; {gone}"))));
    }
    let study: Study = serde_json::from_str(&text).map_err(damaged)?;
    match study.fault() {
        Some(fault) => Err(damaged(serde_json::Error::custom(fault))),
        None => Ok(study),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn studies_of_earlier_versions_are_refused_by_their_kind() {
        let folder = tempfile::tempdir().unwrap();
        let text = r#"{ "version": 1, "kind": "vocabulary", "members": [] }"#;
        fs::write(folder.path().join(STUDY), text).unwrap();
        let error = read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("its kind is `vocabulary`; studies of motion tokens are"), "{error}");
    }
}
