//! Realism metrics in partitions: logs of a run, or scenarios of a submission.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::ScoreArgs;
use super::wosac::{
    check, describe_submission, finish, is_run, observer, run_pairs, score_run, settings, submitted_pairs,
};
use crate::cli::inputs::recorded_logs;
use crate::cli::output::{ExitStatus, lock_folder, write_result};
use crate::cli::partition::{self, Partitions};
use crate::cli::progress::Progress;
use crate::evaluation::realism::{LogSource, RealismScores, score_all};
use crate::evaluation::{ROLLOUTS, SUMMARY, program_commit, program_version};
use crate::files::name_of;
use crate::formats::Partition;
use crate::formats::wosac::SubmissionReader;

/// Name of the file with the scores of a partition.
const SCORES: &str = "scores.json";

/// Settings and files that determine the scores. Files have a name and a size: they are large, and their
/// content is not part of the result.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RealismSubject {
    version: String,
    commit: String,
    configs: Vec<String>,
    shares: bool,
    partial: bool,
    simulator: Option<String>,
    files: Vec<(String, u64)>,
}

impl RealismSubject {
    fn of(args: &ScoreArgs, path: &Path, logs: &[LogSource]) -> anyhow::Result<Self> {
        let mut paths = match is_run(path) {
            true => vec![path.join(SUMMARY), path.join(ROLLOUTS)],
            false => vec![path.to_owned()],
        };
        paths.extend(logs.iter().filter_map(|log| log.path().map(Path::to_owned)));
        let sized = |path: PathBuf| {
            let size = fs::metadata(&path).with_context(|| format!("could not read {}", path.display()))?;
            Ok((name_of(&path).into_owned(), size.len()))
        };
        Ok(Self {
            version: program_version().to_owned(),
            commit: program_commit().to_owned(),
            configs: args.wosac.configs.iter().map(|config| config.id.to_owned()).collect(),
            shares: settings(args)?.shares,
            partial: args.wosac.partial,
            simulator: args.wosac.simulator.clone(),
            files: paths.into_iter().map(sized).collect::<anyhow::Result<_>>()?,
        })
    }
}

/// Computes the scores of a partition.
pub(super) fn score(args: &ScoreArgs, partition: Partition, out: &Path) -> anyhow::Result<ExitStatus> {
    let path = check(args)?;
    let _lock = partition::folder(out)?;
    let logs = recorded_logs(&args.scenarios)?;
    let subject = RealismSubject::of(args, path, &logs)?;
    let (settings, progress) = (settings(args)?, Progress::new());
    let mut observe = observer(&progress);
    let scores = if is_run(path) {
        let pairs = run_pairs(args, path)?;
        let counts: Vec<usize> = match logs.len() < partition.count() {
            true => logs.par_iter().map(LogSource::count).collect(),
            false => Vec::new(),
        };
        let ranges = partition.of_inputs(logs.len(), 1, |i| counts[i]);
        score_run(args, pairs.within(ranges), &settings, &mut observe)
    } else {
        let own = partition.of(SubmissionReader::open(path)?.count());
        let mut pairs = submitted_pairs(args, path)?;
        pairs.pass_over(own.start);
        score_all(pairs.by_ref().take(own.len()), &settings, &mut observe)
    };
    progress.end();
    let (file, text) = (out.join(SCORES), scores.to_text());
    write_result(Some(&file), |out| writeln!(out, "{text}"))?;
    partition::finish(out, partition, scores.failures.len(), &subject)
}

/// Joins the scores of all partitions.
pub(in crate::cli) fn merge(
    mut args: ScoreArgs,
    partitions: &Partitions,
    out: PathBuf,
) -> anyhow::Result<ExitStatus> {
    partitions.subject(|_: &mut RealismSubject, _| ())?;
    args.out = Some(out.clone());
    let (args, path) = (&args, check(&args)?);
    let _lock = lock_folder(&out)?;
    let mut scores = RealismScores { configs: args.wosac.configs.clone(), ..RealismScores::default() };
    for folder in &partitions.folders {
        let file = folder.join(SCORES);
        let text = fs::read(&file).with_context(|| format!("could not read {}", file.display()))?;
        let added = scores.add_text(&text);
        added.map_err(|reason| anyhow!("{}: {reason}; run the partition again", file.display()))?;
    }
    if is_run(path) {
        run_pairs(args, path)?.simulator().clone_into(&mut scores.method);
    } else {
        let progress = Progress::new();
        let mut pairs = submitted_pairs(args, path)?;
        pairs.pass_over(usize::MAX);
        describe_submission(args, &mut scores, &mut pairs, &mut observer(&progress));
        progress.end();
    }
    finish(args, &scores)
}
