//! The option `--source`.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::bail;

use crate::cli::{count, say};
use crate::curation::{CandidateFile, CandidateSource, CurationSettings, MAX_CANDIDATES, SOURCES};

/// A source of candidates as the command line names it.
#[derive(Clone, Debug)]
pub(super) enum SourceChoice {
    /// One of [`SOURCES`].
    Known(&'static str),
    /// A file.
    File(PathBuf),
}

impl FromStr for SourceChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.strip_prefix("file:") {
            Some("") => return Err("`file:` names no file: write file:PATH".to_owned()),
            Some(path) => return Ok(Self::File(path.into())),
            None => {}
        }
        match SOURCES.iter().find(|source| source.id() == text) {
            Some(source) => Ok(Self::Known(source.id())),
            None => {
                let known: Vec<_> = SOURCES.iter().map(|source| source.id()).collect();
                Err(format!("`{text}` is not a source: choose {} or file:PATH", known.join(", ")))
            }
        }
    }
}

impl SourceChoice {
    /// Returns the number of candidates per scenario if none is requested: all that a file has.
    pub(super) fn candidates(&self) -> u32 {
        match self {
            Self::Known(_) => CurationSettings::default().candidates,
            Self::File(_) => MAX_CANDIDATES,
        }
    }

    /// Reads the file, if it is one.
    pub(super) fn open(&self) -> anyhow::Result<OpenSource> {
        Ok(match self {
            Self::File(path) => OpenSource::File(CandidateFile::read(path)?),
            Self::Known(id) => match SOURCES.iter().find(|source| source.id() == *id) {
                Some(source) => OpenSource::Known(*source),
                None => bail!("there is no source `{id}`"),
            },
        })
    }
}

/// A source that is ready.
pub(super) enum OpenSource {
    /// One of [`SOURCES`].
    Known(&'static dyn CandidateSource),
    /// A file in memory.
    File(CandidateFile),
}

impl OpenSource {
    /// Returns the source itself.
    pub(super) fn source(&self) -> &dyn CandidateSource {
        match self {
            Self::Known(source) => *source,
            Self::File(file) => file,
        }
    }

    /// Warns about candidates for scenarios that were not read; an error if there are no others.
    pub(super) fn compare(&self, read: &BTreeSet<String>) -> anyhow::Result<()> {
        let Self::File(file) = self else { return Ok(()) };
        let unread: Vec<&str> = file.scenarios().filter(|id| !read.contains(*id)).collect();
        let Some(first) = unread.first() else { return Ok(()) };
        if unread.len() == file.scenarios().count() {
            let other = read.first().map_or("", String::as_str);
            bail!(
                "--source: no scenario of the file is among the inputs: it has `{first}`, they have `{other}`"
            );
        }
        let number = count(unread.len(), "scenario");
        say(format_args!(
            "warning: --source has candidates for {number} not among the inputs, such as `{first}`"
        ));
        Ok(())
    }
}
