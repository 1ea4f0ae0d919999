//! Reading of submissions: an archive, a folder, or a single file.

use std::collections::VecDeque;
use std::io::{BufReader, Chain, Cursor, Read};
use std::path::{Path, PathBuf};

use reactsim_scene::wosac::ScenarioRollouts;

use super::archive::{self, Archive};
use super::metadata::SubmissionMetadata;
use super::rollouts::read_rollouts;
use super::shards::Shards;
use super::stream::{Event, SubmissionStream};
use crate::error::{Cause, FormatError};
use crate::format::is_gzip;
use crate::womd::record::source;

/// Expected content, for errors.
const EXPECTED: &str = "files named `NAME.binproto-00000-of-00150` or `NAME.binproto`";

/// The rollouts of a scenario and their place in the submission.
#[derive(Clone, Debug)]
pub struct SubmittedRollouts {
    /// The file; for a file of an archive, the path of the archive followed by that of the file.
    pub file: PathBuf,
    /// Index of the scenario in the file, from 0.
    pub record: u64,
    /// The rollouts, not validated.
    pub rollouts: ScenarioRollouts,
}

/// Iterator over the rollouts of a submission, one scenario in memory at a time. An error with
/// [`FormatError::ends_file`] ends one file of the submission; the next files are still read.
pub struct SubmissionReader {
    path: PathBuf,
    files: Files,
    current: Option<Current>,
    shards: Shards,
    metadata: Option<(PathBuf, SubmissionMetadata)>,
    /// Whether it is an archive that is not compressed with gzip.
    is_plain: bool,
}

/// The files that are not yet read.
enum Files {
    Archive(Archive),
    Paths {
        paths: VecDeque<PathBuf>,
        open: Option<Source>,
    },
    /// The file is a message with the rollouts of one scenario.
    OneScenario,
    Ended,
}

/// A file with the bytes that were read to recognise it.
type Source = Chain<Cursor<Vec<u8>>, Box<dyn Read + Send>>;

/// The file that is being read.
struct Current {
    file: PathBuf,
    stream: SubmissionStream,
    next: u64,
}

impl SubmissionReader {
    /// Opens a submission: a tar archive, plain or compressed, a folder with its files, one of these files,
    /// or the message with the rollouts of one scenario, which has no metadata.
    ///
    /// # Errors
    /// [`FormatError`] if the file or folder cannot be opened, or the folder has no file of a submission.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let refuse = |cause| FormatError::file(path, cause);
        let files = if path.is_dir() {
            Files::Paths { paths: files_of(path).map_err(refuse)?, open: None }
        } else {
            let source = start(path).map_err(refuse)?;
            let head = source.get_ref().0.get_ref();
            match archive::header(head) {
                Some(_) => Files::Archive(Archive::new(Box::new(source))),
                None if archive::ends(head) => {
                    return Err(refuse(Cause::value("the archive", "empty", EXPECTED)));
                }
                None if archive::is_damaged(head) => {
                    return Err(refuse(archive::damaged("the checksum of the first header does not match")));
                }
                None if is_of_one_scenario(head) => Files::OneScenario,
                None => Files::Paths { paths: VecDeque::from([path.to_owned()]), open: Some(source) },
            }
        };
        let is_archive = matches!(files, Files::Archive(_));
        let is_plain = is_archive && !is_gzip(path).map_err(|e| refuse(Cause::read(e)))?;
        let shards = Shards::default();
        Ok(Self { path: path.to_owned(), files, current: None, shards, metadata: None, is_plain })
    }

    /// Returns whether the submission is an archive that is not compressed with gzip, whatever its name: the
    /// server takes only those that are.
    pub fn is_plain_archive(&self) -> bool {
        self.is_plain
    }

    /// Returns the metadata of the files read so far.
    pub fn metadata(&self) -> Option<&SubmissionMetadata> {
        self.metadata.as_ref().map(|(_, metadata)| metadata)
    }

    /// Goes to the next file; `false` at the end of the submission.
    fn next_file(&mut self) -> Result<bool, FormatError> {
        let is_folder = self.path.is_dir();
        let (file, name) = match &mut self.files {
            Files::Ended | Files::OneScenario => return Ok(false),
            Files::Archive(archive) => match archive.next_file() {
                Ok(Some(name)) => (self.path.join(&name), Some(name)),
                Ok(None) => return self.end(),
                Err(cause) => {
                    self.files = Files::Ended;
                    return Err(FormatError::file(&self.path, cause));
                }
            },
            Files::Paths { paths, open } => {
                let Some(file) = paths.pop_front() else { return self.end() };
                if open.is_none() || is_folder {
                    match start(&file) {
                        Ok(source) => *open = Some(source),
                        Err(cause) => return Err(FormatError::file(&file, cause)),
                    }
                }
                let name = file.file_name().filter(|_| is_folder).map(|n| n.to_string_lossy().into_owned());
                (file, name)
            }
        };
        if let Some(name) = name {
            self.shards.add(&name).map_err(|cause| FormatError::file(&file, cause))?;
        }
        self.current = Some(Current { file, stream: SubmissionStream::default(), next: 0 });
        Ok(true)
    }

    fn end(&mut self) -> Result<bool, FormatError> {
        let is_archive = matches!(self.files, Files::Archive(_));
        self.files = Files::Ended;
        if is_archive && self.shards.is_empty() {
            return Err(FormatError::file(
                &self.path,
                Cause::value("the archive", "without files", EXPECTED),
            ));
        }
        self.shards.check().map_err(|cause| FormatError::file(&self.path, cause))?;
        Ok(false)
    }

    /// Reads the next rollouts of the current file; `None` at its end.
    fn next_rollouts(&mut self) -> Option<Result<SubmittedRollouts, FormatError>> {
        let current = self.current.as_mut()?;
        let source: &mut dyn Read = match &mut self.files {
            Files::Archive(archive) => archive,
            Files::Paths { open: Some(source), .. } => source,
            _ => return None,
        };
        match current.stream.next(source) {
            Ok(Event::Rollouts(rollouts)) => {
                let (file, record) = (current.file.clone(), current.next);
                current.next += 1;
                let place = |cause| FormatError::record(&current.file, record, None, cause);
                Some(rollouts.map_err(place).map(|rollouts| SubmittedRollouts { file, record, rollouts }))
            }
            Ok(Event::End(metadata)) => {
                let file = std::mem::take(&mut current.file);
                self.current = None;
                self.compare(file, metadata).err().map(Err)
            }
            Err(cause) => {
                let error = FormatError::file(&current.file, cause).at(current.next);
                self.current = None;
                Some(Err(error))
            }
        }
    }

    /// Compares the metadata of a file with those of the first one.
    fn compare(&mut self, file: PathBuf, metadata: SubmissionMetadata) -> Result<(), FormatError> {
        match &self.metadata {
            None => self.metadata = Some((file, metadata)),
            Some((first, expected)) if *expected != metadata => {
                let expected = format!("those of {}, as in every file of a submission", first.display());
                return Err(FormatError::file(&file, Cause::value("the metadata", "different", expected)));
            }
            Some(_) => (),
        }
        Ok(())
    }
}

impl Iterator for SubmissionReader {
    type Item = Result<SubmittedRollouts, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if matches!(self.files, Files::OneScenario) {
                self.files = Files::Ended;
                let file = self.path.clone();
                return Some(read_rollouts(&file).map(|rollouts| SubmittedRollouts {
                    file,
                    record: 0,
                    rollouts,
                }));
            }
            if let Some(rollouts) = self.next_rollouts() {
                return Some(rollouts);
            }
            match self.next_file() {
                Ok(true) => (),
                Ok(false) => return None,
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

/// Returns whether a file begins like the rollouts of one scenario. Both messages begin with their field 1:
/// here the scenario id, in a submission a message, which begins with its own field 1.
fn is_of_one_scenario(head: &[u8]) -> bool {
    const FIELD_1: u8 = 1 << 3 | 2;
    // The length is a varint of few bytes, of which all but the last have the highest bit.
    let length = head.iter().skip(1).take_while(|byte| **byte & 0x80 != 0).count() + 1;
    head.first() == Some(&FIELD_1) && head.get(1 + length).is_some_and(|byte| *byte != FIELD_1)
}

/// Opens a file, decompressed, and reads as many bytes as the header of an archive has.
fn start(path: &Path) -> Result<Source, Cause> {
    let mut source: Box<dyn Read + Send> = Box::new(BufReader::new(source(path).map_err(Cause::read)?));
    let mut head = Vec::new();
    (&mut source).take(archive::BLOCK as u64).read_to_end(&mut head).map_err(Cause::read)?;
    if head.is_empty() {
        return Err(Cause::value("the content", "empty", "a submission"));
    }
    Ok(Cursor::new(head).chain(source))
}

/// Returns the files of a submission in a folder, sorted.
fn files_of(folder: &Path) -> Result<VecDeque<PathBuf>, Cause> {
    let mut paths = Vec::new();
    for entry in folder.read_dir().map_err(Cause::read)? {
        let path = entry.map_err(Cause::read)?.path();
        if path.file_name().is_some_and(|name| Shards::is_name(&name.to_string_lossy())) {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(Cause::value("the content of the folder", "no file of a submission", EXPECTED));
    }
    paths.sort();
    Ok(paths.into())
}
