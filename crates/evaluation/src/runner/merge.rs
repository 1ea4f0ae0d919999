//! Partitions of a run, joined into the folder that the whole run would have written.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use reactsim_formats::rollouts::{Writer, read};

use crate::error::EvaluationError;
use crate::folder::{
    RunFolder, cannot_read, for_parsed_lines, read_provenance, read_summary, read_tally, replace,
};
use crate::layout::{EVENTS, FAILURES, LEFT_OUT, ROLLOUTS, ROWS, SUMMARY};
use crate::provenance::Provenance;
use crate::runner::omissions::Omissions;
use crate::runner::refuse_repeated;
use crate::source::file_record::FileRecord;
use crate::spec::RunSpec;
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// Joins the folders of all partitions of a run, in their order, into a new run folder, byte-identical to
/// that of the whole run. Returns it with its summary, which is written.
///
/// # Errors
/// [`EvaluationError`] if a folder has no finished run, or one of another run, if `out` is not empty, or if a
/// file cannot be read or written.
pub fn merge(partitions: &[PathBuf], out: &Path) -> Result<(RunFolder, Summary), EvaluationError> {
    let provenance = whole(partitions)?;
    let mut tallies = Vec::with_capacity(partitions.len());
    for path in partitions {
        let tally = read_tally(path)?;
        if !read_summary(path)?.is_of(&tally) {
            let text = format!("rows.jsonl has fewer scenarios than {SUMMARY}; run the partition again");
            return Err(EvaluationError::Refused(format!("{}: {text}", path.display())));
        }
        tallies.push(tally);
    }
    let mut tally = provenance.tally();
    tally.entries.extend(tallies.iter().flat_map(|of| of.entries.clone()));
    let spec = RunSpec::of_run(&partitions[0])?;
    spec.iter().try_for_each(|spec| spec.to_toml_in(out).map(drop))?;
    let run = RunFolder::create(out, &provenance)?;
    spec.iter().try_for_each(|spec| spec.write(out))?;
    let (mut failures, mut omissions) = (Vec::new(), Omissions::default());
    for folder in partitions {
        for_parsed_lines(&folder.join(FAILURES), |failure| failures.push(failure))?;
        for_parsed_lines(&folder.join(LEFT_OUT), |of_partition| omissions.add(of_partition))?;
    }
    failures.extend(refuse_repeated(&provenance, &mut tally));
    failures.sort();
    for name in [ROWS, EVENTS] {
        replace(&run.path().join(name), |out| {
            partitions.iter().map(|folder| folder.join(name)).try_for_each(|path| {
                let named =
                    |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
                io::copy(&mut File::open(&path).map_err(named)?, out).map(drop)
            })
        })?;
    }
    if provenance.keep_rollouts == Some(true) {
        join_rollouts(partitions, &tallies, &tally, run.path())?;
    }
    let mut summary = Summary::new(&tally, &failures, &provenance);
    omissions.describe(&mut summary.provenance);
    run.complete(&tally, &failures, &summary, false)?;
    Ok((run, summary))
}

fn whole(partitions: &[PathBuf]) -> Result<Provenance, EvaluationError> {
    let Some(first) = partitions.first() else {
        return Err(EvaluationError::NoRun { path: PathBuf::new() });
    };
    let mut joined = Provenance { partition: None, ..read_provenance(first)? };
    for path in &partitions[1..] {
        let mut other = Provenance { partition: None, ..read_provenance(path)? };
        unite(&mut joined.inputs, &mut other.inputs, |file: &FileRecord| file.blake3.is_empty());
        if let Some(difference) = joined.difference(&other) {
            return Err(EvaluationError::other_partition(path, first, difference));
        }
    }
    Ok(joined)
}

/// Completes two lists of records of the same files: where one partition has not read a file, it gets the
/// record of the other one.
pub fn unite<T: Clone>(some: &mut [T], others: &mut [T], is_unread: impl Fn(&T) -> bool) {
    for (one, other) in some.iter_mut().zip(others) {
        match (is_unread(one), is_unread(other)) {
            (true, _) => one.clone_from(other),
            (_, true) => other.clone_from(one),
            _ => {}
        }
    }
}

/// Joins the rollouts, which have the order of the tallies of their partitions. Those of scenarios that are
/// not in the tally of the whole run are left out.
fn join_rollouts(
    partitions: &[PathBuf],
    tallies: &[Tally],
    tally: &Tally,
    out: &Path,
) -> Result<(), EvaluationError> {
    let mut writer = Writer::create(out.join(ROLLOUTS))?;
    for (folder, of_partition) in partitions.iter().zip(tallies) {
        let pairs = of_partition.entries.iter().flat_map(|(place, entry)| {
            (0..entry.cells.len()).filter(|s| entry.cells[*s].is_some()).map(|_| *place)
        });
        let places = pairs.flat_map(|place| (0..tally.rollouts).map(move |_| place));
        let path = folder.join(ROLLOUTS);
        // Tells an absent file from a damaged one.
        File::open(&path).map_err(cannot_read(&path))?;
        for (record, place) in read(&path)?.zip(places) {
            let record = record?;
            if tally.entries.contains_key(&place) {
                writer.write(&record)?;
            }
        }
    }
    Ok(writer.finish()?)
}
