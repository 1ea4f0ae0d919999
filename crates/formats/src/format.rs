//! The interface of a format, and what its implementations share.

use std::io::Read;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use reactsim_files::{name_of, open_regular};
use reactsim_scene::Scenario;

use super::error::{Cause, FormatError};
use super::frames::{CurrentFrames, LengthChoice};

/// Iterator over scenarios in file order. An error with [`FormatError::ends_file`] ends the file; other
/// errors concern one record.
pub type Scenarios = Box<dyn Iterator<Item = Result<Scenario, FormatError>> + Send>;

/// Record that was read from its file but not decoded. Decoding is the longer part of the work and can run on
/// any thread.
pub struct UndecodedScenario(Box<dyn FnOnce() -> Result<WithDigest, FormatError> + Send>);

/// A scenario, with its digest if the file states it.
type WithDigest = (Scenario, Option<String>);

impl UndecodedScenario {
    /// A record that this function decodes.
    pub fn new(decode: impl FnOnce() -> Result<Scenario, FormatError> + Send + 'static) -> Self {
        Self::with_digest(|| decode().map(|scenario| (scenario, None)))
    }

    /// A record that this function decodes; the digest must be that of the scenario.
    pub(super) fn with_digest(
        decode: impl FnOnce() -> Result<WithDigest, FormatError> + Send + 'static,
    ) -> Self {
        Self(Box::new(decode))
    }

    /// Decodes the record.
    ///
    /// # Errors
    /// [`FormatError`] if it cannot be decoded, or is no valid scenario.
    pub fn decode(self) -> Result<Scenario, FormatError> {
        self.decode_with_digest().map(|(scenario, _)| scenario)
    }

    /// Decodes the record. Also returns [`Scenario::digest`] if decoding has computed it.
    ///
    /// # Errors
    /// As for [`Self::decode`].
    pub fn decode_with_digest(self) -> Result<WithDigest, FormatError> {
        (self.0)()
    }
}

/// Iterator over undecoded records in file order. Errors as in [`Scenarios`]; an error of one record may
/// appear when it is decoded.
pub type PendingScenarios = Box<dyn Iterator<Item = Result<UndecodedScenario, FormatError>> + Send>;

/// Opens a source for reading from the record with the given index on.
pub type Opener = Box<dyn Fn(usize) -> Result<PendingScenarios, FormatError> + Send + Sync>;

/// Reads a source through and returns the number of its records, damaged ones included. A source that cannot
/// be opened has one, so that whoever reads it reports the reason.
pub fn count_records(open: &Opener) -> usize {
    open(0).map_or(1, Iterator::count)
}

/// Name of the repair that counts the frames after the last one of a recording; they are absent.
pub(super) const UNRECORDED_FRAMES: &str = "frames at the end that are not recorded";

/// Adds counts of repairs, by name, to the counts of a scenario. Counts of 0 are left out.
pub(super) fn add_repairs(
    scenario: &mut Scenario,
    counted: impl IntoIterator<Item = (impl Into<String>, u32)>,
) {
    for (what, count) in counted.into_iter().filter(|(_, count)| *count > 0) {
        *scenario.repairs.entry(what.into()).or_default() += count;
    }
}

/// Wraps a scenario as an [`UndecodedScenario`] record.
pub fn decoded(scenario: Scenario) -> UndecodedScenario {
    UndecodedScenario::new(move || Ok(scenario))
}

/// A scenario file format.
pub trait ScenarioFormat: Sync {
    /// Returns the name on the command line.
    fn id(&self) -> &'static str;
    /// Returns a one-line description for people.
    fn title(&self) -> &'static str;
    /// Returns whether a file looks like this format, by its first bytes or, if these are damaged, by its
    /// name.
    fn recognises(&self, path: &Path) -> bool;
    /// Returns whether a file accompanies scenarios of this format, such as a map. In a folder, such files
    /// are skipped without a warning.
    fn accompanies(&self, _path: &Path) -> bool {
        false
    }
    /// Returns whether files behind URLs can be read: each scenario comes from one file, by [`open_regular`].
    fn reads_urls(&self) -> bool {
        true
    }
    /// Opens one file for reading by several threads, with these current frames and this length. Formats that
    /// are slow to decode leave decoding to the threads.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be read at all, or not with these current frames or this length.
    /// Errors of files with one scenario may appear when it is decoded.
    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError>;
    /// Opens one file as [`ScenarioFormat::open_at`] does without choices, from the record with this index on.
    /// Earlier records need not be read, nor be readable.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be read at all.
    fn open_from(&self, path: &Path, first: usize) -> Result<PendingScenarios, FormatError> {
        let whole = self.open_at(path, CurrentFrames::Stated, LengthChoice::default())?;
        Ok(Box::new(whole.skip(first)))
    }
    /// Returns the number of records of a file if it can be found without reading them; for progress.
    fn count(&self, _path: &Path) -> Option<usize> {
        None
    }
    /// Returns the other files that the scenarios of a file are read from, such as maps, in a fixed order.
    /// Files that cannot be determined are left out; opening the file reports the reason.
    fn companions(&self, _path: &Path, _length: LengthChoice) -> Vec<PathBuf> {
        Vec::new()
    }
}

/// Returns what reads the only scenario of a file with the given current frame, if it is chosen.
pub(super) fn single(
    format: &dyn ScenarioFormat,
    path: &Path,
    frames: CurrentFrames,
    read: impl FnOnce(&Path, Option<usize>) -> Result<Scenario, FormatError> + Send + 'static,
) -> Result<PendingScenarios, FormatError> {
    let current = match frames {
        CurrentFrames::Stated => None,
        CurrentFrames::At(frame) => Some(frame),
        CurrentFrames::Every(step) => return Err(has_one_window(format, path, step)),
    };
    let path = path.to_owned();
    Ok(Box::new(std::iter::once(Ok(UndecodedScenario::new(move || read(&path, current))))))
}

/// Opens a file with the current frames that its format defines; refuses others.
pub(super) fn with_stated_frames(
    format: &dyn ScenarioFormat,
    path: &Path,
    frames: CurrentFrames,
    open: impl FnOnce() -> Result<PendingScenarios, FormatError>,
) -> Result<PendingScenarios, FormatError> {
    match frames {
        CurrentFrames::Stated => open(),
        CurrentFrames::At(frame) => {
            let expected = format!("none: the format {} fixes the current frame", format.id());
            let error = FormatError::file(path, Cause::value("the current frame", frame, expected));
            Ok(Box::new(std::iter::once(Err(error))))
        }
        CurrentFrames::Every(step) => Err(has_one_window(format, path, step)),
    }
}

fn has_one_window(format: &dyn ScenarioFormat, path: &Path, step: NonZeroUsize) -> FormatError {
    let expected = format!("none: the format {} has one window per recording", format.id());
    FormatError::file(path, Cause::value("the number of frames between windows", step, expected))
}

/// First bytes of Parquet files.
pub(super) const PARQUET: &[u8] = b"PAR1";
/// First bytes of gzip files.
pub(super) const GZIP: &[u8] = &[0x1f, 0x8b];
/// First bytes of zstd files.
pub(super) const ZSTD: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// Returns whether a file begins like a Parquet file.
///
/// # Errors
/// If the file cannot be read.
pub fn is_parquet(path: &Path) -> std::io::Result<bool> {
    Ok(head(path, PARQUET.len() as u64)? == PARQUET)
}

pub(super) fn is_gzip(path: &Path) -> std::io::Result<bool> {
    Ok(head(path, GZIP.len() as u64)? == GZIP)
}

/// Reads the whole content of a file. Files longer than `max_size` bytes are refused; `expected` describes a
/// valid file in the error.
pub(super) fn read_whole(path: &Path, max_size: u64, expected: &str) -> Result<Vec<u8>, FormatError> {
    let refuse = |e| FormatError::file(path, Cause::read(e));
    let mut content = Vec::new();
    open_regular(path).map_err(refuse)?.take(max_size + 1).read_to_end(&mut content).map_err(refuse)?;
    if content.len() as u64 > max_size {
        let found = format!("more than {} MiB", max_size >> 20);
        return Err(FormatError::file(path, Cause::value("the length of the file", found, expected)));
    }
    Ok(content)
}

/// Reads the first `bytes` bytes of a file, or all of a shorter file.
pub(super) fn head(path: &Path, bytes: u64) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::new();
    open_regular(path)?.take(bytes).read_to_end(&mut head)?;
    Ok(head)
}

/// Returns the beginning of a file that looks like a JSON object.
pub(super) fn json_head(path: &Path) -> Option<String> {
    let head = head(path, 4096).ok()?;
    head.trim_ascii_start().starts_with(b"{").then(|| String::from_utf8_lossy(&head).into_owned())
}

/// Returns whether a file name has this ending, ignoring case.
pub(super) fn named(path: &Path, ending: &str) -> bool {
    name_of(path).to_ascii_lowercase().ends_with(ending)
}
