//! `reactsim import reactsim-bench`: the deviated AVs of the data set, whatever the layout of its files.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use parking_lot::Mutex;
use rayon::prelude::*;
use serde_json::json;

use crate::cli::output::{ExitStatus, count, note, nothing, quoted, say, write_result};
use crate::curation::taxonomy_of;
use crate::evaluation::program_version;
use crate::files;
use crate::formats;
use crate::formats::reactsim_bench::{
    self as bench, Axes, BenchName, Choice, Decided, Imported, IndexedLog, Located, Point, Sample,
};
use crate::scene::{AgentState, Deviation};

/// Endings of the files of the data set.
const ENDINGS: [&str; 3] = [".pkl", ".pickle", ".pt"];
/// Endings of lists of categories.
const LISTS: [&str; 4] = [".json", ".csv", ".tsv", ".txt"];
/// Number of scenarios that are classified at once.
const CHUNK: usize = 32;
/// Number of files that are named for each reason of refusal.
const NAMED: usize = 3;

const AFTER: &str = "\
The meaning of the numbers in the files is found: of all arrays, frames of coordinates, points of the AV and \
times, those are taken with which the AVs of nearly all files continue their logs. Options state what cannot \
be found.

Next to the output, it writes NAME.selection.json, the scenarios for `reactsim run`; NAME.logs.jsonl, the \
scenes of the logs, so that the next import need not read them; NAME.refused.tsv, if files are refused.

Example:
  reactsim import reactsim-bench ReactSim-Bench-Data --nuplan nuplan-v1.1/splits/trainval \\
    --out official.parquet
  reactsim run official.selection.json --deviations official.parquet --out runs/official";

/// Arguments of `import reactsim-bench`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ImportBenchArgs {
    /// Files MAP_SCENE_SAMPLE.pkl, or folders that hold some; lists of categories in them are read as well
    #[arg(required = true, value_name = "FILES")]
    files: Vec<PathBuf>,
    /// Logs of nuPlan (`.db`), or folders that hold some; may be repeated
    #[arg(long, required = true, value_name = "LOGS")]
    nuplan: Vec<PathBuf>,
    /// Folder with the list of nuPlan's maps [default: the one above the logs]
    #[arg(long, value_name = "MAPS")]
    maps: Option<PathBuf>,
    /// The Parquet file of deviated AVs to write
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Key of the array, such as `agent.position`; `KEY[N]` for one of several trajectories [default: found]
    #[arg(long, value_name = "KEY")]
    array: Option<String>,
    /// Names of the columns of the array: x, then y, and heading, or cos and sin; others have any name
    /// [default: found]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    columns: Vec<String>,
    /// Frame of the coordinates: of the map, of the AV at the current or the first frame (offset: with the
    /// axes of the map), or as the file states it [default: found]
    #[arg(long, value_name = "FRAME", value_parser = Axes::NAMES)]
    frame: Option<String>,
    /// Point of the AV that is given [default: found]
    #[arg(long, value_name = "POSE", value_parser = ["centre", "rear-axle"])]
    pose: Option<String>,
    /// Frame that the second token of a file name names [default: found]
    #[arg(long, value_name = "FRAME", value_parser = ["current", "first"])]
    sample: Option<String>,
}

/// A file with what its name states.
type NamedFile = (PathBuf, BenchName);
/// Categories of lists, by the stem of the file.
type Categories = BTreeMap<String, Deviation>;
/// Files that are not imported, with their reasons.
type Refused = Vec<(PathBuf, String)>;

pub(super) fn import(args: &ImportBenchArgs) -> anyhow::Result<ExitStatus> {
    let choice = args.choice()?;
    args.maps.as_deref().map_or(Ok(()), bench::check_maps)?;
    let mut refused = Refused::new();
    let (named, lists) = named_files(args, &mut refused)?;
    let total = named.len() + refused.len();
    let files = located(args, &named, &mut refused)?;
    let (files, tally) = bench::measure(files, &choice, &mut refused);
    if files.is_empty() {
        report_refused(&args.out, &refused)?;
        return Err(nothing("no file could be imported"));
    }
    let decided = bench::decide(&files, &tally, &choice);
    if decided.is_err() {
        report_refused(&args.out, &refused)?;
    }
    let Decided { about, layout, tracks } = decided?;
    let mut imported = collected(args, &files, layout.sample, tracks, &lists, &mut refused)?;
    let selection = write_selection(args, &imported)?;
    let from_files = imported.iter().filter(|(one, _)| one.category.is_some()).count();
    classify(&selection, &mut imported)?;
    let deviations: Vec<Imported> = imported.into_iter().map(|(one, _)| one).collect();
    let record = json!({ "format": "ReactSim-Bench", "layout": about, "files": deviations.len(),
                         "program": program_version() });
    bench::write(&args.out, &deviations, record.to_string())?;
    report_refused(&args.out, &refused)?;
    let table = summary(args, &deviations, &about, total, from_files, &refused);
    write_result(None, |out| out.write_all(table.as_bytes()))?;
    Ok(if refused.is_empty() { ExitStatus::Done } else { ExitStatus::SomeFailed })
}

impl ImportBenchArgs {
    fn choice(&self) -> anyhow::Result<Choice> {
        if !(self.columns.is_empty() || self.columns.windows(2).any(|pair| *pair == ["x", "y"])) {
            bail!("--columns {}: expected x, and y after it", self.columns.join(","));
        }
        let is = |value: &Option<String>, name: &str| value.as_deref().map(|value| value == name);
        let axle = is(&self.pose, "rear-axle");
        let current = is(&self.sample, "current");
        Ok(Choice {
            array: self.array.clone(),
            columns: self.columns.clone(),
            frame: self.frame.clone(),
            point: axle.map(|axle| if axle { Point::Axle } else { Point::Center }),
            sample: current.map(|current| if current { Sample::Current } else { Sample::First }),
        })
    }
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    endings.iter().any(|ending| name.ends_with(ending))
}

/// Lists the files, parses their names, and reads the lists of categories among them.
fn named_files(
    args: &ImportBenchArgs,
    refused: &mut Refused,
) -> anyhow::Result<(Vec<NamedFile>, Categories)> {
    let found = bench::files_in(&args.files, &[&ENDINGS[..], &LISTS[..]].concat())?;
    let (lists, found): (Vec<_>, Vec<_>) = found.into_iter().partition(|path| has_ending(path, &LISTS));
    let mut categories = BTreeMap::new();
    for path in lists {
        let text = std::fs::read(&path).with_context(|| path.display().to_string())?;
        categories.extend(bench::sidecar(&String::from_utf8_lossy(&text)));
    }
    let mut named = Vec::new();
    for path in found {
        match BenchName::of(&path) {
            Ok(name) => named.push((path, name)),
            Err(reason) => refused.push((path, reason)),
        }
    }
    if named.is_empty() && refused.is_empty() {
        bail!("there are no files with the ending {} at the given paths", ENDINGS.join(", "));
    }
    Ok((named, categories))
}

/// Reads the scenes of all logs, those from the cache that are unchanged.
fn index(args: &ImportBenchArgs) -> anyhow::Result<Vec<IndexedLog>> {
    let logs = bench::files_in(&args.nuplan, &[".db"])?;
    if logs.is_empty() {
        bail!("--nuplan: there are no logs with the ending .db at the given paths");
    }
    let cache = args.out.with_extension("logs.jsonl");
    let text = std::fs::read_to_string(&cache).unwrap_or_default();
    // A line that was cut is read again.
    let known = text.lines().filter_map(|line| serde_json::from_str::<IndexedLog>(line).ok());
    let known: BTreeMap<PathBuf, IndexedLog> = known.map(|log| (log.path.clone(), log)).collect();
    let failed = || format!("could not write {}", cache.display());
    let mut file = OpenOptions::new().create(true).append(true).open(&cache).with_context(failed)?;
    if !text.is_empty() && !text.ends_with('\n') {
        file.write_all(b"\n").with_context(failed)?;
    }
    let file = Mutex::new(file);
    note(format_args!("reading the scenes of {}", count(logs.len(), "log")));
    let one = |path: &PathBuf| -> anyhow::Result<IndexedLog> {
        let path = std::path::absolute(path)?;
        if let Some(log) = known.get(&path).filter(|log| log.is_current()) {
            return Ok(log.clone());
        }
        let log = IndexedLog::read(&path)?;
        let line = format!("{}\n", serde_json::to_string(&log)?);
        file.lock().write_all(line.as_bytes()).with_context(failed)?;
        Ok(log)
    };
    let read: Vec<anyhow::Result<IndexedLog>> = logs.par_iter().map(one).collect();
    let mut indexed = Vec::new();
    for log in read {
        match log {
            Ok(log) => indexed.push(log),
            Err(error) => say(format_args!("warning: a log is skipped: {error}")),
        }
    }
    Ok(indexed)
}

/// Finds the frames of the files in the logs with the scenes that their names state; each log is read once.
fn located(
    args: &ImportBenchArgs,
    named: &[NamedFile],
    refused: &mut Refused,
) -> anyhow::Result<Vec<Located>> {
    let logs = index(args)?;
    let scenes = logs.iter().flat_map(|log| log.scenes.iter().map(move |scene| (scene.as_str(), &log.path)));
    let scenes: BTreeMap<&str, &PathBuf> = scenes.collect();
    let mut by_log: BTreeMap<&PathBuf, Vec<&NamedFile>> = BTreeMap::new();
    for file in named {
        let scene = file.1.scene();
        match scenes.get(scene.as_str()) {
            Some(log) => by_log.entry(log).or_default().push(file),
            None => {
                let reason = format!("no log of --nuplan has the scene {scene}; add the log that has it");
                refused.push((file.0.clone(), reason));
            }
        }
    }
    let one = |(log, files): (&&PathBuf, &Vec<&NamedFile>)| {
        let found = bench::locate(log, files);
        let found = found.unwrap_or_else(|e| files.iter().map(|_| Err(e.to_string())).collect());
        files.iter().map(|(path, _)| path.clone()).zip(found).collect::<Vec<_>>()
    };
    let mut files = Vec::new();
    for (path, found) in by_log.par_iter().map(one).collect::<Vec<_>>().into_iter().flatten() {
        match found {
            Ok(located) if located.windows.iter().all(Option::is_none) => {
                refused.push((path, format!("its scenario is not in the log: {}", located.missing[0])));
            }
            Ok(located) => files.push(located),
            Err(reason) => refused.push((path, reason)),
        }
    }
    files.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(files)
}

/// Takes the trajectories of the files that fit, one per scenario, with the categories that files state.
fn collected(
    args: &ImportBenchArgs,
    files: &[Located],
    sample: Sample,
    tracks: Vec<Option<Vec<AgentState>>>,
    lists: &Categories,
    refused: &mut Refused,
) -> anyhow::Result<Vec<(Imported, PathBuf)>> {
    let mut imported: Vec<(Imported, PathBuf)> = Vec::new();
    let mut ids: BTreeMap<String, usize> = BTreeMap::new();
    let mut moved = 0;
    for (file, track) in files.iter().zip(tracks) {
        let sample = sample as usize;
        let Some(track) = track else {
            let reason = match &file.windows[sample] {
                Some(_) => {
                    "its array does not continue the logged AV as those of the other files do".to_owned()
                }
                None => format!("its scenario is not in the log: {}", file.missing[sample]),
            };
            refused.push((file.path.clone(), reason));
            continue;
        };
        let Some(id) = file.current[sample].clone() else { continue };
        let name = file.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let digest = files::digest(&file.path).with_context(|| file.path.display().to_string())?.blake3;
        let stem = file.path.file_stem().unwrap_or_default().to_string_lossy();
        let category = file
            .category
            .or_else(|| lists.get(stem.as_ref()).copied())
            .or_else(|| bench::category_of_path(&file.path));
        if let Some(earlier) = ids.get(&id).map(|at| &mut imported[*at].0) {
            let same = if earlier.source.1 == digest {
                earlier.category = earlier.category.or(category);
                "the same file as"
            } else {
                "another file of the scenario of"
            };
            refused
                .push((file.path.clone(), format!("it is {same} {}, which is imported", earlier.source.0)));
            continue;
        }
        moved += usize::from(file.other_scene);
        ids.insert(id.clone(), imported.len());
        imported
            .push((Imported { scenario_id: id, category, source: (name, digest), track }, file.log.clone()));
    }
    if moved > 0 {
        say(format_args!("warning: {} of another scene than their names state", count(moved, "frame")));
    }
    if imported.is_empty() {
        report_refused(&args.out, refused)?;
        return Err(nothing("no file could be imported"));
    }
    Ok(imported)
}

/// Writes the selection of the scenarios.
fn write_selection(args: &ImportBenchArgs, imported: &[(Imported, PathBuf)]) -> anyhow::Result<PathBuf> {
    let logs: BTreeSet<&PathBuf> = imported.iter().map(|(_, log)| log).collect();
    let tokens: Vec<&str> = imported.iter().map(|(one, _)| one.scenario_id.as_str()).collect();
    let mut selection = json!({ "format": "reactsim-nuplan-v1", "logs": logs, "tokens": tokens });
    if let Some(maps) = &args.maps {
        selection["maps"] = json!(std::path::absolute(maps)?);
    }
    let path = args.out.with_extension("selection.json");
    write_result(Some(&path), |out| writeln!(out, "{selection:#}"))?;
    Ok(path)
}

/// Classifies the deviations without a category by the taxonomy.
fn classify(selection: &Path, imported: &mut [(Imported, PathBuf)]) -> anyhow::Result<()> {
    if imported.iter().all(|(one, _)| one.category.is_some()) {
        return Ok(());
    }
    note(format_args!("classifying the deviations by the taxonomy of the program"));
    let places: BTreeMap<String, usize> =
        imported.iter().enumerate().map(|(at, (one, _))| (one.scenario_id.clone(), at)).collect();
    let mut failed = BTreeMap::new();
    for input in formats::find_inputs(selection)? {
        let mut records = input.open_undecoded()?.peekable();
        while records.peek().is_some() {
            let chunk: Vec<_> = records.by_ref().take(CHUNK).collect();
            let classified = |record: Result<formats::UndecodedScenario, formats::FormatError>| {
                let scenario =
                    record.and_then(formats::UndecodedScenario::decode).map_err(|error| error.to_string())?;
                let at = *places.get(&scenario.id).ok_or("an unknown scenario")?;
                let (one, origin) = (&imported[at].0, scenario.origin);
                let by = |s: &AgentState| AgentState { x: s.x - origin.x, y: s.y - origin.y, ..*s };
                let track: Vec<AgentState> = one.track.iter().map(by).collect();
                let taxonomy = taxonomy_of(&scenario, &track).map_err(|error| error.to_string())?;
                Ok::<_, String>((at, taxonomy.category))
            };
            let found: Vec<_> = chunk.into_par_iter().map(classified).collect();
            for one in found {
                match one {
                    Ok((at, category)) => {
                        imported[at].0.category.get_or_insert(category);
                    }
                    Err(reason) => *failed.entry(reason).or_insert(0_usize) += 1,
                }
            }
        }
    }
    let without = imported.iter().filter(|(one, _)| one.category.is_none()).count();
    if let Some((reason, _)) = failed.iter().next() {
        say(format_args!("warning: {} without a category; the first: {reason}", count(without, "deviation")));
    }
    Ok(())
}

/// Writes and prints which files are refused, by reason.
fn report_refused(out: &Path, refused: &Refused) -> anyhow::Result<()> {
    let path = out.with_extension("refused.tsv");
    if refused.is_empty() {
        // That of an earlier import would mislead.
        std::fs::remove_file(&path).ok();
        return Ok(());
    }
    let lines: String =
        refused.iter().map(|(file, reason)| format!("{}\t{reason}\n", file.display())).collect();
    write_result(Some(&path), |to| to.write_all(lines.as_bytes()))?;
    for (file, reason) in refused.iter().take(NAMED) {
        say(format_args!("warning: {} is not imported: {reason}", file.display()));
    }
    let more = refused.len().saturating_sub(NAMED);
    if more > 0 {
        say(format_args!("warning: {more} more not imported; {} has all with reasons", path.display()));
    }
    Ok(())
}

/// Returns the table of what was found, and how to run it.
fn summary(
    args: &ImportBenchArgs,
    deviations: &[Imported],
    layout: &str,
    total: usize,
    from_files: usize,
    refused: &Refused,
) -> String {
    let mut text = format!("{} of {}: {layout}\n", deviations.len(), count(total, "file"));
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for (_, reason) in refused {
        // Tokens and names differ from file to file.
        let is_own = |word: &str| word.len() > 15 && word.contains(|c: char| c.is_ascii_digit());
        let words = reason.split(' ').map(|word| if is_own(word) { "…" } else { word });
        *reasons.entry(words.collect::<Vec<_>>().join(" ")).or_default() += 1;
    }
    reasons.iter().for_each(|(reason, n)| {
        writeln!(text, "{n} not imported: {reason}").ok();
    });
    let of = |category: Option<Deviation>| deviations.iter().filter(|d| d.category == category).count();
    let counts = Deviation::ALL.map(|category| format!("{} {}", of(Some(category)), category.name()));
    let without = match of(None) {
        0 => String::new(),
        n => format!(", {n} without"),
    };
    let from = match from_files {
        n if n == deviations.len() => "as the files, their lists or folders state".to_owned(),
        0 => "by the taxonomy of this program: the files state none".to_owned(),
        n => format!("{n} as the files state, the others by the taxonomy of this program"),
    };
    writeln!(text, "categories: {}{without} ({from})", counts.join(", ")).ok();
    let [selection, out] =
        [&args.out.with_extension("selection.json"), &args.out].map(|path| quoted(&path.to_string_lossy()));
    writeln!(text, "reactsim run {selection} --deviations {out} --out runs/official").ok();
    text
}
