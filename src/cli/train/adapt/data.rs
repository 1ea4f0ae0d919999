//! Training data of an adaptation: a part of the logs, their reactions and certificates, and a part to judge by.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use serde_json::json;

use crate::cli::output::{count, nothing, say, write_result};
use crate::cli::progress::Progress;
use crate::cli::train::data::{recording_of, write_absent};
use crate::cli::train::deviated::{deviated, several, with_certificate, with_rollout};
use crate::cli::train::exclusion::Exclusion;
use crate::cli::train::reader::Reader;
use crate::evaluation::Registrar;
use crate::files::read_regular;
use crate::formats::Input;
use crate::formats::native::{ByNumber, Writer};
use crate::generation::{GenerationSettings, Generator, Preset};
use crate::rollout::Controller;
use crate::scene::{DeviatedTrack, Scenario};
use crate::training::{leading_bits, unit_interval};

/// Share of the recordings that the table is about, and nothing else.
const JUDGED: f64 = 0.2;
/// Largest number of AVs of a log, and of a generated one.
const MOST_AVS: f64 = 8.0;
const AVS_OF_GENERATED: usize = 2;
/// Number of generated logs of which one has an AV that can deviate.
const GENERATED_PER_LOG: usize = 3;
/// Seed of the generated logs, none of which a shipped network learned from.
const GENERATED_SEED: u64 = 77;
/// What follows the id of the log in the ids of its scenarios with further AVs, before their number.
const AV: &str = "+av";
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
    /// Those with AVs that deviate: several scenarios of each log.
    pub(super) deviated: PathBuf,
    /// Generated scenarios with AVs that deviate.
    pub(super) generated: PathBuf,
    /// The recordings of the logs that are not learned from, by id.
    recordings: PathBuf,
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
            generated: file("generated"),
            recordings: folder.join("recordings.json"),
        }
    }

    /// Returns the function from the id of a scenario to judge by to the name of its recording; a generated
    /// scenario is one of its own.
    pub(super) fn recordings(&self) -> anyhow::Result<impl Fn(&str) -> String> {
        let path = &self.recordings;
        let by_id: BTreeMap<String, String> = serde_json::from_slice(&read_regular(path)?)
            .with_context(|| format!("{} is damaged: give another --out", path.display()))?;
        Ok(move |id: &str| {
            let log = log_of(id);
            by_id.get(log).map_or(log, String::as_str).to_owned()
        })
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
    /// Rollouts with AVs that deviate to judge by, each with another AV if there are so many.
    pub(super) reactions: usize,
    /// Number of generated logs to judge by, about.
    pub(super) most_generated: usize,
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
    let is_split = [&files.logs, &files.held_out, &files.recordings].iter().all(|path| path.exists());
    if !is_split && !split(logs, &files)? {
        return Ok(None);
    }
    let (name, simulator) = reacting;
    let (learned, held_out) = (ByNumber::open(&files.logs)?, ByNumber::open(&files.held_out)?);
    let learn = |number: u64| -> anyhow::Result<[Vec<Scenario>; 3]> {
        let mut scenario = learned.read(number as usize)?;
        let Some(chosen) = deviated(&scenario, logs.seed) else { return Ok(Default::default()) };
        let reactions = with_rollout(scenario.clone(), &chosen, name, simulator)?;
        let certificate = with_certificate(scenario.clone(), &chosen)?;
        scenario.deviation = Some(chosen);
        Ok([vec![reactions], certificate.into_iter().collect(), vec![scenario]])
    };
    let learned_from = learned.len().min(logs.most_deviated);
    let made = [&files.reactions, &files.certificates, &files.tuning];
    if !write_absent(made, learned_from, logs.jobs, logs.stop, learn)? {
        return Ok(None);
    }
    let judged = held_out.len().min(logs.most_judged);
    let can_deviate = ByNumber::open(&files.tuning)?.len() as f64 / learned_from as f64;
    let avs = avs_per_log(judged as f64 * can_deviate, logs.reactions);
    let judge = |number: u64| -> anyhow::Result<[Vec<Scenario>; 2]> {
        let scenario = held_out.read(number as usize)?;
        Ok([vec![scenario.clone()], with_several(&scenario, logs.seed, avs)])
    };
    let generator = Generator::new(GenerationSettings {
        preset: Preset::Sensed,
        seed: GENERATED_SEED,
        ..GenerationSettings::default()
    })?;
    let generate = |number: u64| -> anyhow::Result<[Vec<Scenario>; 1]> {
        let scenario = generator.scenario(number).ok();
        Ok([scenario.map(|log| with_several(&log, logs.seed, AVS_OF_GENERATED)).unwrap_or_default()])
    };
    let generated = GENERATED_PER_LOG * logs.most_generated;
    let done = write_absent([&files.judged, &files.deviated], judged, logs.jobs, logs.stop, judge)?
        && write_absent([&files.generated], generated, logs.jobs, logs.stop, generate)?;
    Ok(done.then_some(files))
}

/// Returns how many AVs of each log are judged by if about so many logs have an AV that can deviate, for a
/// number of rollouts in all: one with another AV tells more than a second one with the same.
fn avs_per_log(logs: f64, rollouts: usize) -> usize {
    (rollouts as f64 / logs.max(1.0)).clamp(1.0, MOST_AVS) as usize
}

/// Returns a scenario for each of up to `most` deviated AVs of a log.
fn with_several(log: &Scenario, seed: u64, most: usize) -> Vec<Scenario> {
    let with_av = |(number, chosen): (usize, DeviatedTrack)| {
        let mut scenario = log.clone();
        scenario.deviation = Some(chosen);
        if number > 1 {
            scenario.id = format!("{}{AV}{number}", log.id);
        }
        scenario
    };
    (1..).zip(several(log, seed, most)).map(with_av).collect()
}

/// Returns the id of the log of a scenario that [`with_several`] made.
fn log_of(id: &str) -> &str {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    id.rsplit_once(AV).filter(|(_, number)| is_number(number)).map_or(id, |(log, _)| log)
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
    let mut recordings: BTreeMap<String, String> = BTreeMap::new();
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
            let recording = recording(input, &scenario.id);
            let place = place(&recording, logs.seed);
            let part = usize::from(place < bound);
            if part == 1 {
                recordings.insert(scenario.id.clone(), recording);
            }
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
    write_result(Some(&files.recordings), |out| writeln!(out, "{:#}", json!(recordings)))?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_logs_have_more_avs() {
        assert_eq!([avs_per_log(150.0, 300), avs_per_log(70.0, 300), avs_per_log(0.0, 300)], [2, 4, 8]);
    }

    #[test]
    fn the_avs_of_a_log_are_scenarios_of_its_own() {
        let settings = GenerationSettings { preset: Preset::Sensed, ..GenerationSettings::default() };
        let generator = Generator::new(settings).unwrap();
        let made = (0..40).find_map(|number| {
            let log = generator.scenario(number).ok()?;
            let made = with_several(&log, 0, 3);
            (made.len() == 3).then_some((log, made))
        });
        let (log, made) = made.expect("none of 40 AVs can deviate in three ways");
        let ids: Vec<&str> = made.iter().map(|scenario| scenario.id.as_str()).collect();
        assert_eq!(ids, [log.id.clone(), format!("{}+av2", log.id), format!("{}+av3", log.id)]);
        assert!(ids.iter().all(|id| log_of(id) == log.id));
        assert_eq!(["a+av", "a+avx", "a+idm", "a+av2+av10"].map(log_of), ["a+av", "a+avx", "a+idm", "a+av2"]);
        // The first one is that of the training, and no two are the same.
        assert_eq!(made[0].deviation, deviated(&log, 0));
        let track = |scenario: &Scenario| scenario.deviation.clone().unwrap().track;
        assert!(track(&made[0]) != track(&made[1]) && track(&made[1]) != track(&made[2]));
        assert!(track(&made[0]) != track(&made[2]));
    }
}
