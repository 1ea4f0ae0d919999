//! Training scenarios, read by number from native files, and files of scenarios that are made for a training.

use std::collections::BTreeSet;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail};
use rayon::prelude::*;

use super::exclusion::Exclusion;
use crate::cli::inputs::find_inputs;
use crate::cli::output::say;
use crate::cli::progress::Progress;
use crate::curation::driver::CurationObserver;
use crate::evaluation::{FileRecord, Registrar};
use crate::formats::native::{ByNumber, Writer};
use crate::formats::{FormatError, Input, UndecodedScenario};
use crate::generation::{Ending, in_order};
use crate::scene::Scenario;
use crate::training::Source;

/// Number of records decoded in parallel before they are written.
const CHUNK: usize = 32;

/// Scenarios at several paths, each path with its repetitions per epoch.
pub(super) struct Data {
    files: Vec<ByNumber>,
    /// Index of the file and number in it, for every scenario.
    places: Vec<(usize, usize)>,
    /// Scenarios of every path, and how often each is seen per epoch.
    parts: Vec<(Vec<usize>, f64)>,
    digest: String,
}

/// Parses `PATH` or `PATH=TIMES`: a path and how often its scenarios are seen per epoch.
fn part(text: &str) -> anyhow::Result<(PathBuf, f64)> {
    let Some((path, times)) = text.rsplit_once('=').filter(|_| !Path::new(text).exists()) else {
        return Ok((text.into(), 1.0));
    };
    match times.parse::<f64>() {
        Ok(times) if times > 0.0 && times <= 1000.0 => Ok((path.into(), times)),
        _ => {
            bail!("`{text}`: {times} is not a weight: write a number above 0, up to 1000, such as {path}=2.5")
        }
    }
}

impl Data {
    /// Opens the scenarios at these paths, except for those that are excluded. Converts files of other
    /// formats to native files in the folder `cache`, named by their content, so that later trainings
    /// reuse them.
    pub(super) fn open(parts: &[String], mut exclusion: Exclusion, cache: &Path) -> anyhow::Result<Self> {
        // Find all inputs before converting any.
        let mut inputs = Vec::new();
        for text in parts {
            let (path, times) = part(text)?;
            inputs.push((find_inputs(&[path])?, times));
        }
        let mut data =
            Self { files: Vec::new(), places: Vec::new(), parts: Vec::new(), digest: String::new() };
        let (mut hasher, mut registrar) = (blake3::Hasher::new(), Registrar::default());
        for (inputs, times) in inputs {
            hasher.update(&times.to_le_bytes());
            let first = data.places.len();
            for input in inputs {
                let record = registrar.record(&input)?;
                exclusion.refuse_benchmark(&record)?;
                let file = open(&input, &record, cache)?;
                for number in 0..file.len() {
                    if !exclusion.admits(file.id(number), &input.path.display().to_string())? {
                        continue;
                    }
                    data.places.push((data.files.len(), number));
                    hasher.update(file.id(number).as_bytes());
                    hasher.update(file.digest(number).as_bytes());
                }
                data.files.push(file);
            }
            data.parts.push(((first..data.places.len()).collect(), times));
        }
        if let Some(text) = exclusion.report() {
            say(format_args!("{text}"));
        }
        data.digest = hasher.finalize().to_hex().to_string();
        if data.places.is_empty() {
            bail!("{}: no scenario to learn from", parts.join(", "));
        }
        Ok(data)
    }

    /// Returns the number of scenarios per epoch, with repetitions.
    pub(super) fn length(&self) -> f64 {
        self.parts.iter().map(|(numbers, times)| numbers.len() as f64 * times).sum()
    }

    /// Returns whether a scenario is among them.
    pub(super) fn contains(&self, id: &str) -> bool {
        (0..self.len()).any(|number| self.id(number) == id)
    }
}

/// Returns the id of the recording that a scenario is a window of: `a` for the window `a@60` and for its futures
/// `a@60+idm`.
pub(super) fn recording_of(id: &str) -> &str {
    let log = id.split('+').next().unwrap_or(id);
    let is_frame = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    match log.rsplit_once('@') {
        Some((recording, frame)) if is_frame(frame) => recording,
        _ => log,
    }
}

/// Opens a native file directly, and a file of another format through the cache.
fn open(input: &Input, record: &FileRecord, cache: &Path) -> anyhow::Result<ByNumber> {
    if input.format.id() == "native" {
        return Ok(ByNumber::open(&input.path)?);
    }
    let digest = record.digest();
    let converted = cache.join(format!("{}.parquet", &digest[..32]));
    if !converted.exists() {
        fs::create_dir_all(cache).with_context(|| format!("could not write {}", cache.display()))?;
        convert(input, &converted)?;
    }
    Ok(ByNumber::open(&converted)?)
}

/// Writes all readable scenarios of a file to a native file. Warns of the others and leaves them out.
fn convert(input: &Input, out: &Path) -> anyhow::Result<()> {
    let mut writer = Writer::create(out)?;
    let mut ids = BTreeSet::new();
    let warn = |error: &FormatError| say(format_args!("warning: skipped: {error}"));
    let mut records = input.open_undecoded()?;
    loop {
        let chunk: Vec<_> = records.by_ref().take(CHUNK).collect();
        if chunk.is_empty() {
            break;
        }
        let decoded: Vec<Result<Scenario, FormatError>> =
            chunk.into_par_iter().map(|record| record.and_then(UndecodedScenario::decode)).collect();
        for scenario in decoded {
            match scenario {
                Ok(scenario) if ids.insert(scenario.id.clone()) => writer.write(&scenario)?,
                Ok(scenario) => {
                    let (file, id) = (input.path.display(), &scenario.id);
                    say(format_args!(
                        "warning: skipped: {file}: scenario `{id}`: an earlier one has this id"
                    ));
                }
                Err(error) => warn(&error),
            }
        }
    }
    writer.finish()?;
    Ok(())
}

/// Writes the scenarios that `make` returns for each number below `end`, unless the files are there already.
/// Returns whether they are complete.
pub(super) fn write_absent<const N: usize>(
    to: [&PathBuf; N],
    end: usize,
    jobs: usize,
    stop: &AtomicBool,
    make: impl Fn(u64) -> anyhow::Result<[Vec<Scenario>; N]> + Sync,
) -> anyhow::Result<bool> {
    if to.iter().all(|path| path.exists()) {
        // A file has its name only when it is complete.
        to.into_iter().try_for_each(|path| ByNumber::open(path).map(|_| ()))?;
        return Ok(true);
    }
    let progress = Progress::new();
    progress.set_total(Some(end));
    let mut writers = to.iter().map(Writer::create).collect::<Result<Vec<_>, _>>()?;
    let ending = in_order(
        0..end as u64,
        jobs,
        stop,
        &mut (),
        |(), number| (number, make(number)),
        |(), (number, made)| {
            for (writer, scenarios) in writers.iter_mut().zip(made?) {
                scenarios.iter().try_for_each(|scenario| writer.write(scenario))?;
            }
            progress.scenario_done(number as usize + 1);
            Ok::<_, anyhow::Error>(ControlFlow::Continue(()))
        },
    );
    progress.end();
    if ending? == Ending::Stopped {
        return Ok(false);
    }
    for writer in writers {
        writer.finish()?;
    }
    Ok(true)
}

impl Source for Data {
    type Example = Scenario;

    fn len(&self) -> usize {
        self.places.len()
    }

    fn id(&self, number: usize) -> &str {
        let (file, number) = self.places[number];
        self.files[file].id(number)
    }

    fn origin(&self, number: usize) -> &str {
        recording_of(self.id(number))
    }

    fn read(&self, number: usize) -> Result<Scenario, String> {
        let (file, number) = self.places[number];
        self.files[file].read(number).map_err(|e| e.to_string())
    }

    fn digest(&self) -> String {
        self.digest.clone()
    }

    fn parts(&self) -> Vec<(Vec<usize>, f64)> {
        self.parts.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::recording_of;

    #[test]
    fn windows_and_futures_are_of_their_recording() {
        let of = |id| recording_of(id).to_owned();
        assert_eq!(
            ["a", "a@60", "a@60+idm", "a+idm", "a@b", "a@", "a@b@3"].map(of),
            ["a", "a", "a", "a", "a@b", "a@", "a@b"]
        );
    }
}
