//! Training data of an adaptation: a part of the logs, their reactions and certificates, and a part to judge by.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::bail;

use crate::cli::output::{count, nothing, say};
use crate::cli::progress::Progress;
use crate::cli::train::data::recording_of;
use crate::cli::train::deviated::{deviated, with_certificate, with_rollout};
use crate::cli::train::exclusion::Exclusion;
use crate::cli::train::reader::Reader;
use crate::curation::driver::CurationObserver;
use crate::evaluation::Registrar;
use crate::formats::Input;
use crate::formats::native::{ByNumber, Writer};
use crate::generation::{Ending, in_order};
use crate::rollout::Controller;
use crate::scene::Scenario;
use crate::training::{leading_bits, unit_interval};

/// Share of the recordings that the table is about, and nothing else.
const JUDGED: f64 = 0.2;
/// Number of scenarios below which a warning says that they are few.
const FEW: usize = 100;

/// Files of an adaptation.
pub(super) struct Files {
    /// Logs to learn from.
    pub(super) logs: PathBuf,
    /// Those with agents that react to an AV that deviates.
    pub(super) reactions: PathBuf,
    /// Those with the mildest motion that avoids such an AV.
    pub(super) certificates: PathBuf,
    /// Logs to learn from, with the deviated AV; settings are chosen on them.
    pub(super) tuning: PathBuf,
    /// Logs that are not learned from.
    held_out: PathBuf,
    /// Those of them to judge by.
    pub(super) judged: PathBuf,
    /// Those with an AV that deviates.
    pub(super) deviated: PathBuf,
}

impl Files {
    fn of(folder: &Path) -> Self {
        let file = |name: &str| folder.join(format!("{name}.parquet"));
        Self {
            logs: file("logs"),
            reactions: file("reactions"),
            certificates: file("certificates"),
            tuning: file("tuning"),
            held_out: file("held-out"),
            judged: file("judged"),
            deviated: file("deviated"),
        }
    }
}

/// The logs, and how much is made of them.
pub(super) struct Logs<'a> {
    pub(super) inputs: &'a [Input],
    /// Files of scenarios that are left out.
    pub(super) exclude: &'a [PathBuf],
    /// Largest number of scenarios that are read.
    pub(super) most: usize,
    /// Largest number of scenarios to learn from whose AV deviates.
    pub(super) most_deviated: usize,
    /// Largest number of scenarios to judge by.
    pub(super) most_judged: usize,
    pub(super) seed: u64,
    /// Number of threads.
    pub(super) jobs: usize,
    pub(super) stop: &'a AtomicBool,
}

/// Makes the files that the folder does not have yet. `None` if it was stopped. Other agents react as the
/// simulator `reacting` does.
pub(super) fn make(
    logs: &Logs<'_>,
    folder: &Path,
    reacting: (&str, &Controller),
) -> anyhow::Result<Option<Files>> {
    let files = Files::of(folder);
    let is_split = files.logs.exists() && files.held_out.exists();
    if !is_split && !split(logs, &files)? {
        return Ok(None);
    }
    let (name, simulator) = reacting;
    let learned = |scenario: &Scenario| -> anyhow::Result<[Option<Scenario>; 3]> {
        let Some(chosen) = deviated(scenario, logs.seed) else { return Ok([None, None, None]) };
        let reactions = with_rollout(scenario.clone(), &chosen, name, simulator)?;
        let certificate = with_certificate(scenario.clone(), &chosen)?;
        Ok([Some(reactions), certificate, Some(chosen.put_into(scenario.clone()))])
    };
    let judged = |scenario: &Scenario| -> anyhow::Result<[Option<Scenario>; 2]> {
        let deviated = deviated(scenario, logs.seed).map(|chosen| chosen.put_into(scenario.clone()));
        Ok([Some(scenario.clone()), deviated])
    };
    let made = [&files.reactions, &files.certificates, &files.tuning];
    let done = derive(&files.logs, made, logs.most_deviated, logs, learned)?
        && derive(&files.held_out, [&files.judged, &files.deviated], logs.most_judged, logs, judged)?;
    Ok(done.then_some(files))
}

/// Divides the logs by their recordings: scenarios of one recording are in the same part. Returns whether the
/// files are complete.
fn split(logs: &Logs<'_>, files: &Files) -> anyhow::Result<bool> {
    let Some(first) = divide(logs, files, JUDGED)? else { return Ok(false) };
    let division = if first.counts.contains(&0) {
        // Few recordings: the one with the lowest place is judged by.
        let (Some(lowest), Some(highest)) = (first.places.first(), first.places.last()) else {
            return Err(nothing("none of the logs could be read"));
        };
        if lowest == highest {
            bail!(
                "{} of one recording: give logs of several, because those to judge by must be of others than \
                 those to learn from",
                count(first.counts.iter().sum(), "scenario")
            );
        }
        let Some(second) = divide(logs, files, f64::from_bits(*lowest).next_up())? else { return Ok(false) };
        second
    } else {
        first
    };
    let [learned, judged] = division.counts;
    say(format_args!(
        "{} to learn from and {judged} to judge by, of {}",
        count(learned, "scenario"),
        count(division.places.len(), "recording")
    ));
    if let Some(excluded) = &division.excluded {
        say(format_args!("{excluded}"));
    }
    if division.repeated > 0 {
        let repeated = count(division.repeated, "scenario");
        say(format_args!("warning: {repeated} left out: earlier ones have their ids"));
    }
    if learned + judged >= logs.most {
        say(format_args!(
            "the other scenarios were not read: there is no time to learn from more; give more --minutes"
        ));
    }
    if learned < FEW {
        say(format_args!(
            "warning: {} to learn from is little: expect small changes, and wide intervals in the table",
            count(learned, "scenario")
        ));
    }
    Ok(true)
}

/// A division of logs into scenarios to learn from and to judge by.
#[derive(Default)]
struct Division {
    counts: [usize; 2],
    /// Number of scenarios that were left out because of their ids.
    repeated: usize,
    /// Places of the recordings in [0, 1), as bits.
    places: BTreeSet<u64>,
    /// Text about scenarios that were left out because `--exclude` names them.
    excluded: Option<String>,
}

/// Divides the logs: recordings with places below `bound` are judged by. `None` if it was stopped.
fn divide(logs: &Logs<'_>, files: &Files, bound: f64) -> anyhow::Result<Option<Division>> {
    let mut writers = [Writer::create(&files.logs)?, Writer::create(&files.held_out)?];
    let (mut division, mut ids, mut failure) = (Division::default(), BTreeSet::new(), None::<anyhow::Error>);
    let (mut registrar, mut exclusion) = (Registrar::default(), Exclusion::read(logs.exclude)?);
    let progress = Progress::new();
    for input in logs.inputs {
        let read = division.counts.iter().sum::<usize>();
        if read >= logs.most || logs.stop.load(Ordering::Relaxed) {
            break;
        }
        exclusion.refuse_benchmark(&registrar.record(input)?)?;
        let mut reader = Reader::new(std::slice::from_ref(input), None, &progress, logs.stop);
        reader.each(logs.most - read, |scenario| {
            if failure.is_some() {
                return;
            }
            match exclusion.admits(&scenario.id, &input.path.display().to_string()) {
                Ok(true) => {}
                Ok(false) => return,
                Err(error) => {
                    failure = Some(error);
                    return;
                }
            }
            if !ids.insert(scenario.id.clone()) {
                division.repeated += 1;
                return;
            }
            let place = place(&recording(input, &scenario.id), logs.seed);
            let part = usize::from(place < bound);
            match writers[part].write(scenario) {
                Ok(()) => division.counts[part] += 1,
                Err(error) => failure = Some(error.into()),
            }
            division.places.insert(place.to_bits());
        });
        progress.set_done(division.counts.iter().sum());
    }
    progress.end();
    if let Some(error) = failure {
        return Err(error);
    }
    if logs.stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    for writer in writers {
        writer.finish()?;
    }
    division.excluded = exclusion.report();
    Ok(Some(division))
}

/// Returns the name of the recording of a scenario: of nuPlan the file, which has one drive; of windows their id
/// without the frame.
fn recording(input: &Input, id: &str) -> String {
    if input.format.id() == "nuplan" {
        return input.path.display().to_string();
    }
    recording_of(id).to_owned()
}

/// Returns a place in [0, 1), by a hash of seed and name.
pub(super) fn place(name: &str, seed: u64) -> f64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(b"reactsim-adapt").update(&seed.to_le_bytes()).update(name.as_bytes());
    unit_interval(leading_bits(&hasher.finalize()))
}

/// Writes the scenarios that `make` returns for each of the first `most` scenarios of a file, unless they are there already. Returns
/// whether the files are complete.
fn derive<const N: usize>(
    from: &Path,
    to: [&PathBuf; N],
    most: usize,
    logs: &Logs<'_>,
    make: impl Fn(&Scenario) -> anyhow::Result<[Option<Scenario>; N]> + Sync,
) -> anyhow::Result<bool> {
    if to.iter().all(|path| path.exists()) {
        return Ok(true);
    }
    let source = ByNumber::open(from)?;
    let scenarios = source.len().min(most);
    let progress = Progress::new();
    progress.set_total(Some(scenarios));
    let mut writers = to.iter().map(Writer::create).collect::<Result<Vec<_>, _>>()?;
    let ending = in_order(
        scenarios as u64,
        logs.jobs,
        logs.stop,
        &mut (),
        |(), number| make(&source.read(number as usize)?),
        |(), number, made| {
            for (writer, scenario) in writers.iter_mut().zip(made?) {
                scenario.map_or(Ok(()), |scenario| writer.write(&scenario))?;
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
