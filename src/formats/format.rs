//! The list of formats, detection and opening.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::argoverse2::Argoverse2;
use super::error::{Cause, FormatError};
use super::gpudrive::GpuDrive;
use super::json::Json;
use super::native::Native;
use super::nuplan::NuPlan;
use super::scenarionet::ScenarioNet;
use super::womd::Womd;
use crate::scene::Scenario;

/// Scenarios in file order. An error that [`FormatError::ends_file`] ends the file, others concern one record.
pub type Scenarios = Box<dyn Iterator<Item = Result<Scenario, FormatError>> + Send>;

/// A record that was split off its file: decoding it is the longer part of the work and can be done on any thread.
pub type Undecoded = Box<dyn FnOnce() -> Result<Scenario, FormatError> + Send>;

/// Records in file order, not yet decoded. Errors as of [`Scenarios`]; those of one record may come with its decoding.
pub type PendingScenarios = Box<dyn Iterator<Item = Result<Undecoded, FormatError>> + Send>;

/// A scenario in the form of one that is still to be decoded.
pub fn decoded(scenario: Scenario) -> Undecoded {
    Box::new(move || Ok(scenario))
}

/// A kind of scenario file.
pub trait ScenarioFormat: Sync {
    /// The name on the command line.
    fn id(&self) -> &'static str;
    /// One line for people.
    fn title(&self) -> &'static str;
    /// Whether a file looks like this format: by its first bytes, and where these are damaged by its name.
    fn recognises(&self, path: &Path) -> bool;
    /// Whether a file is no scenario but belongs to those of this format, such as a map: in a folder nothing is said of it.
    fn accompanies(&self, _path: &Path) -> bool {
        false
    }
    /// Opens one file.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be read at all.
    fn open(&self, path: &Path) -> Result<Scenarios, FormatError>;
    /// Opens one file for reading by several threads: a format whose decoding is slow leaves it to them.
    ///
    /// # Errors
    /// As [`ScenarioFormat::open`].
    fn open_undecoded(&self, path: &Path) -> Result<PendingScenarios, FormatError> {
        let scenarios = self.open(path)?;
        Ok(Box::new(scenarios.map(|scenario| scenario.map(decoded))))
    }
    /// Reads the scenario of a file that holds one, with another of its frames (counted from 0) as the current one. Most formats do not leave
    /// that open.
    ///
    /// # Errors
    /// As [`ScenarioFormat::open`], and where the format says what the current frame is.
    fn read_at(&self, path: &Path, current_frame: usize) -> Result<Scenario, FormatError> {
        let expected = format!("left out: scenarios of the format {} say which frame it is", self.id());
        Err(FormatError::file(path, Cause::value("the current frame", current_frame, expected)))
    }
    /// Other files that the scenarios of a file are read from, such as maps, in a fixed order. What can not be told is left out: opening
    /// the file will say why.
    fn companions(&self, _path: &Path) -> Vec<PathBuf> {
        Vec::new()
    }
}

/// All formats.
pub const FORMATS: &[&dyn ScenarioFormat] =
    &[&Womd, &Native, &NuPlan, &Json, &GpuDrive, &Argoverse2, &ScenarioNet];

/// A file, its format, and how it is read.
#[derive(Clone)]
pub struct Input {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: &'static dyn ScenarioFormat,
    /// Which frame (counted from 0) becomes the current one, where it is not the one that the format says: [`ScenarioFormat::read_at`].
    pub current_frame: Option<usize>,
}

impl Input {
    /// Opens the file.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be read at all, or not in this way.
    pub fn open(&self) -> Result<Scenarios, FormatError> {
        let Some(frame) = self.current_frame else { return self.format.open(&self.path) };
        let scenario = self.format.read_at(&self.path, frame)?;
        Ok(Box::new(std::iter::once(Ok(scenario))))
    }

    /// Opens the file for reading by several threads: [`ScenarioFormat::open_undecoded`].
    ///
    /// # Errors
    /// As [`Input::open`]; where a current frame is asked for, decoding tells them.
    pub fn open_undecoded(&self) -> Result<PendingScenarios, FormatError> {
        let Some(frame) = self.current_frame else { return self.format.open_undecoded(&self.path) };
        let Self { path, format, .. } = self.clone();
        let decode: Undecoded = Box::new(move || format.read_at(&path, frame));
        Ok(Box::new(std::iter::once(Ok(decode))))
    }
}

/// What lies at a path.
#[derive(Clone)]
pub struct Survey {
    /// The scenario files, sorted by name; at least one.
    pub inputs: Vec<Input>,
    /// Files of a folder that are named like scenarios but are of no known kind: whoever tells people what was read should say
    /// so.
    pub passed_over: Vec<PathBuf>,
}

/// The scenario files at a path: the file itself, or those in the folder and its subfolders. Files of other kinds in a folder are
/// passed over.
///
/// # Errors
/// [`FormatError`] when the path can not be read, a file is of no known format, or a folder holds no scenario file.
pub fn survey(path: &Path) -> Result<Survey, FormatError> {
    let (mut inputs, mut passed_over) = (Vec::new(), Vec::new());
    for path in files_at(path)? {
        if let Some(format) = FORMATS.iter().copied().find(|f| f.recognises(&path)) {
            inputs.push(Input { path, format, current_frame: None });
        } else if LIKE_SCENARIOS.iter().any(|ending| named(&path, ending) || zipped(&path, ending))
            && !FORMATS.iter().any(|f| f.accompanies(&path))
        {
            passed_over.push(path);
        }
    }
    if !inputs.is_empty() {
        return Ok(Survey { inputs, passed_over });
    }
    let known: Vec<String> = FORMATS.iter().map(|f| format!("{} ({})", f.id(), f.title())).collect();
    let known = known.join(", ");
    Err(FormatError::file(
        path,
        if path.is_dir() {
            Cause::NoInput { known }
        } else {
            let found = kind_of(path).map_err(|e| FormatError::file(path, Cause::read(e)))?;
            Cause::Unrecognised { found, known }
        },
    ))
}

/// How files are named that may be meant as scenarios.
const LIKE_SCENARIOS: &[&str] = &[".json", ".parquet", ".pkl", ".db"];

/// Whether a file is named so with the ending of a compressed one.
fn zipped(path: &Path, ending: &str) -> bool {
    [".gz", ".zst"].iter().any(|zip| named(path, &format!("{ending}{zip}")))
}

/// The scenario files of a [`survey`].
///
/// # Errors
/// As [`survey`].
pub fn find_inputs(path: &Path) -> Result<Vec<Input>, FormatError> {
    survey(path).map(|found| found.inputs)
}

/// The file at a path, or the files below a folder.
fn files_at(path: &Path) -> Result<Vec<PathBuf>, FormatError> {
    let about = fs::metadata(path).map_err(|e| FormatError::file(path, Cause::read(e)))?;
    if !about.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut files = Vec::new();
    collect(path, &mut Vec::new(), &mut files)?;
    Ok(files)
}

/// Reads all scenarios at a path: a file or a folder. A file of a folder that can not be read is reported once, and the next
/// one is read.
///
/// # Errors
/// As [`find_inputs`]; for a single file also when it can not be opened.
pub fn open(path: &Path) -> Result<Scenarios, FormatError> {
    open_all(find_inputs(path)?)
}

/// Reads all scenarios of these files, one after the other. One that can not be read is reported once, and the next one is read.
///
/// # Errors
/// [`FormatError`] when there is one file only and it can not be opened.
pub fn open_all(inputs: Vec<Input>) -> Result<Scenarios, FormatError> {
    if let [only] = inputs.as_slice() {
        return only.open();
    }
    Ok(Box::new(inputs.into_iter().flat_map(|input| match input.open() {
        Ok(scenarios) => scenarios,
        Err(error) => Box::new(std::iter::once(Err(error))),
    })))
}

/// The files below a folder, in the order of their names. A link to one of the folders `above` it is not followed.
fn collect(folder: &Path, above: &mut Vec<PathBuf>, files: &mut Vec<PathBuf>) -> Result<(), FormatError> {
    let refuse = |e| FormatError::file(folder, Cause::read(e));
    let real = folder.canonicalize().map_err(refuse)?;
    if above.contains(&real) {
        return Ok(());
    }
    above.push(real);
    let mut entries = Vec::new();
    for entry in fs::read_dir(folder).map_err(refuse)? {
        entries.push(entry.map_err(refuse)?.path());
    }
    entries.sort();
    for path in entries {
        let hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        if path.is_dir() {
            collect(&path, above, files)?;
        } else if !hidden {
            files.push(path);
        }
    }
    above.pop();
    Ok(())
}

/// The first bytes of Parquet, gzip and zstd files.
const PARQUET: &[u8] = b"PAR1";
pub(super) const GZIP: &[u8] = &[0x1f, 0x8b];
pub(super) const ZSTD: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// Whether a file begins as Parquet files do.
///
/// # Errors
/// When the file can not be read.
pub fn is_parquet(path: &Path) -> std::io::Result<bool> {
    Ok(head(path, PARQUET.len() as u64)? == PARQUET)
}

/// The whole content of a file that holds `what`; one longer than `longest` bytes is refused.
pub(super) fn read_whole(path: &Path, longest: u64, what: &str) -> Result<Vec<u8>, FormatError> {
    let refuse = |e| FormatError::file(path, Cause::read(e));
    let mut content = Vec::new();
    File::open(path).map_err(refuse)?.take(longest + 1).read_to_end(&mut content).map_err(refuse)?;
    if content.len() as u64 > longest {
        let found = format!("more than {} MiB", longest >> 20);
        return Err(FormatError::file(path, Cause::value("the length of the file", found, what)));
    }
    Ok(content)
}

/// The first bytes of a file, fewer where it is shorter.
pub(super) fn head(path: &Path, bytes: u64) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::new();
    File::open(path)?.take(bytes).read_to_end(&mut head)?;
    Ok(head)
}

/// Whether the name of a file ends so, in any case.
pub(super) fn named(path: &Path, ending: &str) -> bool {
    path.file_name().is_some_and(|n| n.to_string_lossy().to_ascii_lowercase().ends_with(ending))
}

fn kind_of(path: &Path) -> std::io::Result<&'static str> {
    let head = head(path, 4096)?;
    let text = head.trim_ascii_start();
    Ok(match &head[..] {
        [] => "empty",
        h if h.starts_with(PARQUET) => "a Parquet file of another kind",
        h if h.starts_with(GZIP) => "a gzip file without TFRecords (decompress it first)",
        h if h.starts_with(ZSTD) => "a zstd file without TFRecords (decompress it first)",
        [0x80, 0x02..=0x05, ..] => "a Python pickle",
        _ if NuPlan.accompanies(path) => "a map of nuPlan (name the logs, `.db`, that were recorded there)",
        _ if Argoverse2.accompanies(path) => "an Argoverse 2 map (name the scenario_*.parquet beside it)",
        _ if text.starts_with(b"{") => "a JSON file without `\"format\": \"reactsim-scenario-v1\"`",
        _ if text.starts_with(b"<") => "an XML file",
        _ => "a file of an unknown kind",
    })
}
