//! List of formats; detection and opening of files.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use reactsim_files::{as_url, list_url, name_of};
use reactsim_scene::Scenario;

use super::argoverse2::Argoverse2;
use super::error::{Cause, FormatError};
use super::format::{
    GZIP, Opener, PARQUET, PendingScenarios, ScenarioFormat, Scenarios, UndecodedScenario, ZSTD, head, named,
};
use super::frames::{CurrentFrames, LengthChoice};
use super::gpudrive::GpuDrive;
use super::json::Json;
use super::native::Native;
use super::nuplan::NUPLAN;
use super::scenarionet::ScenarioNet;
use super::womd::Womd;

/// All formats.
pub const FORMATS: &[&dyn ScenarioFormat] =
    &[&Womd, &Native, &NUPLAN, &Json, &GpuDrive, &Argoverse2, &ScenarioNet];

/// A file with its format and reading options.
#[derive(Clone)]
pub struct Input {
    /// The file.
    pub path: PathBuf,
    /// Its format.
    pub format: &'static dyn ScenarioFormat,
    /// Current frames of its recordings.
    pub frames: CurrentFrames,
    /// Number of frames of its scenarios.
    pub length: LengthChoice,
    /// Whether all agents that are present at the current frame are simulated, of all kinds and any number:
    /// [`Scenario::with_all_agents`].
    pub all_agents: bool,
}

impl Input {
    /// A file that is read as its format defines it.
    pub fn new(path: PathBuf, format: &'static dyn ScenarioFormat) -> Self {
        let (frames, length) = (CurrentFrames::Stated, LengthChoice::default());
        Self { path, format, frames, length, all_agents: false }
    }

    /// Opens the file.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be read at all, or not with these current frames or this length.
    /// If a file has a single scenario, an error of reading it may come with the scenario instead.
    pub fn open(&self) -> Result<Scenarios, FormatError> {
        Ok(Box::new(self.open_undecoded()?.map(|record| record.and_then(UndecodedScenario::decode))))
    }

    /// Returns whether the file is a recording of the Waymo Open Motion Dataset, which has more than
    /// scenarios hold: [`WosacLogs`](super::wosac::WosacLogs).
    pub fn is_recording(&self) -> bool {
        self.format.id() == Womd.id()
    }

    /// Opens the file for reading by several threads.
    ///
    /// # Errors
    /// Same as [`Input::open`]; errors of given current frames may appear when a record is decoded.
    pub fn open_undecoded(&self) -> Result<PendingScenarios, FormatError> {
        self.open_from(0)
    }

    /// Opens the file as [`Self::open_undecoded`] does, from the record with this index on.
    ///
    /// # Errors
    /// Same as [`Self::open_undecoded`].
    pub fn open_from(&self, first: usize) -> Result<PendingScenarios, FormatError> {
        let is_plain = self.frames == CurrentFrames::Stated && self.length.is_default();
        let scenarios: PendingScenarios = if is_plain {
            self.format.open_from(&self.path, first)?
        } else {
            self.length.check().map_err(|cause| FormatError::file(&self.path, cause))?;
            Box::new(self.format.open_at(&self.path, self.frames, self.length)?.skip(first))
        };
        if !self.all_agents {
            return Ok(scenarios);
        }
        let with_all = |record: UndecodedScenario| {
            UndecodedScenario::new(move || record.decode().map(Scenario::with_all_agents))
        };
        Ok(Box::new(scenarios.map(move |record| record.map(with_all))))
    }

    /// Returns the other files that the scenarios are read from: [`ScenarioFormat::companions`].
    pub fn companions(&self) -> Vec<PathBuf> {
        self.format.companions(&self.path, self.length)
    }

    /// Returns what opens the file, of which at most `most` records are read.
    pub fn opener(self, most: usize) -> Opener {
        Box::new(move |first| Ok(Box::new(self.open_from(first)?.take(most.saturating_sub(first)))))
    }

    /// Returns the number of records if it can be found without reading them.
    pub fn count(&self) -> Option<usize> {
        if matches!(self.frames, CurrentFrames::Every(_)) { None } else { self.format.count(&self.path) }
    }
}

/// Files or folders that were not read, each with the reason.
pub type PassedOver = Vec<(PathBuf, String)>;

/// Scenario files found at a path.
#[derive(Clone)]
pub struct Survey {
    /// The scenario files, sorted by name; at least one.
    pub inputs: Vec<Input>,
    /// Files of a folder that are named like scenarios but cannot be read or have no known format, and
    /// folders in it that cannot be read, with the reason. Callers that report what was read should list
    /// them.
    pub passed_over: PassedOver,
}

/// Finds the scenario files at a path or URL: the file itself, or those in the folder and its subfolders.
/// Other files in a folder are skipped.
///
/// # Errors
/// [`FormatError`] if the path cannot be read, a file has no known format, or a folder holds no scenario
/// file; also if all files behind a URL are of formats that are read from file systems only.
pub fn survey(path: &Path) -> Result<Survey, FormatError> {
    let mut inputs = Vec::new();
    let (files, mut passed_over) = files_at(path)?;
    let is_folder = files.first().is_none_or(|first| first != path);
    let mut refused = None;
    for (path, format) in with_formats(files, as_url(path).is_some()) {
        if let Some(format) = format {
            if as_url(&path).is_some() && !format.reads_urls() {
                let error = FormatError::file(&path, Cause::LocalOnly { format: format.id() });
                passed_over.push((path, format!("it {}", error.cause)));
                refused.get_or_insert(error);
                continue;
            }
            inputs.push(Input::new(path, format));
        } else if SCENARIO_ENDINGS.iter().any(|ending| named(&path, ending) || zipped(&path, ending))
            && !FORMATS.iter().any(|f| f.accompanies(&path))
        {
            let reason = head(&path, 1).err().map(|error| format!("it cannot be read: {error}"));
            passed_over.push((path, reason.unwrap_or_else(|| "it is not a scenario file".to_owned())));
        }
    }
    if !inputs.is_empty() {
        return Ok(Survey { inputs, passed_over });
    }
    if let Some(error) = refused {
        return Err(error);
    }
    let known: Vec<String> = FORMATS.iter().map(|f| format!("{} ({})", f.id(), f.title())).collect();
    let known = known.join(", ");
    Err(FormatError::file(
        path,
        if is_folder {
            Cause::NoInput { known }
        } else {
            let found = describe_content(path).map_err(|e| FormatError::file(path, Cause::read(e)))?;
            Cause::Unrecognised { found, known }
        },
    ))
}

/// Number of files behind a URL whose formats are recognised at the same time: an answer takes long to come.
const RECOGNISED_AT_ONCE: usize = 16;

type FileWithFormat = (PathBuf, Option<&'static dyn ScenarioFormat>);

/// Returns the files with their formats, as far as these are known.
fn with_formats(files: Vec<PathBuf>, is_remote: bool) -> Box<dyn Iterator<Item = FileWithFormat>> {
    let recognise = |path: &Path| FORMATS.iter().copied().find(|f| f.recognises(path));
    if !is_remote || files.len() < 2 {
        return Box::new(files.into_iter().map(move |path| {
            let format = recognise(&path);
            (path, format)
        }));
    }
    let formats: Vec<OnceLock<_>> = files.iter().map(|_| OnceLock::new()).collect();
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        for _ in 0..RECOGNISED_AT_ONCE.min(files.len()) {
            scope.spawn(|| {
                while let Some(index) =
                    Some(next.fetch_add(1, Ordering::Relaxed)).filter(|i| *i < files.len())
                {
                    formats[index].set(recognise(&files[index])).ok();
                }
            });
        }
    });
    let formats = formats.into_iter().map(|format| format.into_inner().flatten());
    Box::new(files.into_iter().zip(formats.collect::<Vec<_>>()))
}

/// Returns whether a file name has this ending followed by that of a compressed file.
fn zipped(path: &Path, ending: &str) -> bool {
    [".gz", ".zst"].iter().any(|zip| named(path, &format!("{ending}{zip}")))
}

/// Returns the scenario files of a [`survey`].
///
/// # Errors
/// Same as [`survey`].
pub fn find_inputs(path: &Path) -> Result<Vec<Input>, FormatError> {
    survey(path).map(|found| found.inputs)
}

/// Lists the file at a path, or the files below a folder. Hidden files are left out.
///
/// The second list has the folders below it that cannot be read, with the reason.
fn files_at(path: &Path) -> Result<(Vec<PathBuf>, PassedOver), FormatError> {
    let refuse = |e| FormatError::file(path, Cause::read(e));
    if let Some(url) = as_url(path) {
        let mut files = list_url(url).map_err(refuse)?;
        files.retain(|file| file == path || !name_of(file).starts_with('.'));
        return Ok((files, Vec::new()));
    }
    if !fs::metadata(path).map_err(refuse)?.is_dir() {
        return Ok((vec![path.to_owned()], Vec::new()));
    }
    let (mut files, mut unread) = (Vec::new(), Vec::new());
    collect(path, &mut Vec::new(), &mut files, &mut unread).map_err(refuse)?;
    Ok((files, unread))
}

/// Reads all scenarios at a path, which is a file or a folder. A file of a folder that cannot be read is
/// reported once, and reading continues with the next file.
///
/// # Errors
/// Same as [`find_inputs`]; for a single file also if it cannot be opened.
pub fn open(path: &Path) -> Result<Scenarios, FormatError> {
    open_all(find_inputs(path)?)
}

/// Reads all scenarios of these files in order. A file that cannot be read is reported once, and reading
/// continues with the next file.
///
/// # Errors
/// [`FormatError`] if there is only one file and it cannot be opened.
pub fn open_all(inputs: Vec<Input>) -> Result<Scenarios, FormatError> {
    if let [only] = inputs.as_slice() {
        return only.open();
    }
    Ok(Box::new(inputs.into_iter().flat_map(|input| match input.open() {
        Ok(scenarios) => scenarios,
        Err(error) => Box::new(std::iter::once(Err(error))),
    })))
}

/// Collects the files below a folder in the order of their names. Links to one of the folders `above` it are
/// not followed. Folders below it that cannot be read are added to `unread`.
fn collect(
    folder: &Path,
    above: &mut Vec<PathBuf>,
    files: &mut Vec<PathBuf>,
    unread: &mut PassedOver,
) -> io::Result<()> {
    let real = folder.canonicalize()?;
    if above.contains(&real) {
        return Ok(());
    }
    let entries = fs::read_dir(folder)?.map(|entry| Ok(entry?.path()));
    let mut entries = entries.collect::<io::Result<Vec<PathBuf>>>()?;
    entries.sort();
    above.push(real);
    for path in entries {
        let hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        if path.is_dir() {
            if let Err(error) = collect(&path, above, files, unread) {
                unread.push((path, format!("it cannot be read: {error}")));
            }
        } else if !hidden {
            files.push(path);
        }
    }
    above.pop();
    Ok(())
}

/// Describes the content of a file without a known format.
fn describe_content(path: &Path) -> std::io::Result<&'static str> {
    let head = head(path, 4096)?;
    let text = head.trim_ascii_start();
    Ok(match &head[..] {
        [] => "empty",
        h if h.starts_with(PARQUET) => "a Parquet file of another kind",
        h if h.starts_with(GZIP) => "a gzip file without TFRecords (decompress it first)",
        h if h.starts_with(ZSTD) => "a zstd file without TFRecords (decompress it first)",
        [0x80, 0x02..=0x05, ..] => "a Python pickle",
        _ if NUPLAN.accompanies(path) => "a nuPlan map (give the logs, `.db`, that use it)",
        _ if Argoverse2.accompanies(path) => "an Argoverse 2 map (give the scenario_*.parquet next to it)",
        _ if text.starts_with(b"{") => "a JSON file without `\"format\": \"reactsim-scenario-v1\"`",
        _ if text.starts_with(b"<") => "an XML file",
        _ if text.windows(15).any(|part| part == b"scenario_types:") => {
            "a scenario filter of nuPlan (give it as `filter`, and the logs as `nuplan`)"
        }
        _ if text.starts_with(b"version https://git-lfs") => {
            "a pointer of Git LFS (run `git lfs pull` in its repository)"
        }
        _ => "a file of an unknown kind",
    })
}

/// Name endings of files that may be intended as scenarios.
const SCENARIO_ENDINGS: &[&str] = &[".json", ".parquet", ".pkl", ".db"];
