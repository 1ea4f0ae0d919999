//! The files of a reference, from a folder or embedded in the program.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use reactsim_references::SHIPPED;

use super::ReferenceError;
use crate::folder::cannot_read;
use crate::layout::REFERENCE_RECORD;

/// The content of all files of a reference, by name.
pub(super) struct Files {
    /// Name of the folder, for messages.
    pub(super) place: String,
    pub(super) content: BTreeMap<String, Cow<'static, [u8]>>,
}

impl Files {
    /// Reads all files of a folder. A subfolder is listed as a file without content.
    pub(super) fn of_folder(folder: &Path) -> Result<Self, ReferenceError> {
        let place = folder.display().to_string();
        if !folder.join(REFERENCE_RECORD).is_file() {
            return Err(no_reference(&place));
        }
        let mut content = BTreeMap::new();
        for entry in fs::read_dir(folder).map_err(cannot_read(folder))? {
            let path = entry.map_err(cannot_read(folder))?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let bytes = match path.is_dir() {
                true => Vec::new(),
                false => fs::read(&path).map_err(cannot_read(&path))?,
            };
            content.insert(name, bytes.into());
        }
        Ok(Self { place, content })
    }

    pub(super) fn embedded(name: &str) -> Option<Self> {
        let (name, files) = SHIPPED.iter().find(|(embedded, _)| *embedded == name)?;
        let content = files.iter().map(|(file, bytes)| ((*file).to_owned(), Cow::Borrowed(*bytes)));
        Some(Self { place: format!("references/{name}"), content: content.collect() })
    }
}

/// Refuses a folder without a reference.
pub(super) fn no_reference(place: &str) -> ReferenceError {
    ReferenceError::Unfit(format!("{place} is not a reference: it has no reference.toml"))
}

#[cfg(test)]
mod tests {
    use crate::reference::Reference;

    #[test]
    fn embedded_references_are_consistent() {
        for (name, _) in super::SHIPPED {
            let reference = Reference::embedded(name).unwrap().unwrap();
            assert_eq!(reference.record.name, *name);
        }
        assert!(Reference::embedded("no such reference").is_none());
    }
}
