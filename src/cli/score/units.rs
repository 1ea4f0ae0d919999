//! Realism metrics in units: ranges of the logs of a run, or of the scenarios of a submission.

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use anyhow::{Context, bail};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::ScoreArgs;
use super::wosac::{
    check, describe_run, describe_submission, finish, is_run, observer, run_pairs, submitted_pairs,
};
use crate::cli::progress::Progress;
use crate::cli::sharded::{Sharded, WorkSettings};
use crate::cli::{ExitStatus, lock_folder, log_sources};
use crate::evaluation::realism::{LogSource, RealismScores, SubmittedPairs, UNIT_SCORES, score_all};
use crate::evaluation::{
    CompanionRecord, EvaluationError, FileRecord, ROLLOUTS, SUMMARY, program_commit, program_version,
};
use crate::formats::wosac::SubmissionReader;
use crate::shards::{FinishedUnits, RecordRange, ShardError, ShardPlan, Unit, UnitResults, Work};

/// Settings and files that determine the scores.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RealismSubject {
    version: String,
    commit: String,
    configs: Vec<String>,
    partial: bool,
    simulator: Option<String>,
    /// Files with the rollouts.
    rollouts: Vec<CompanionRecord>,
    /// Files with the logs.
    logs: Vec<FileRecord>,
}

impl RealismSubject {
    /// Describes what would be scored. `known` may give the record of a file of logs by its index; other
    /// files are read for their digests.
    fn of(
        args: &ScoreArgs,
        path: &Path,
        known: impl Fn(usize, &LogSource) -> Option<FileRecord>,
    ) -> anyhow::Result<Self> {
        let mut logs = Vec::new();
        for (index, source) in log_sources::recorded(&args.scenarios)?.iter().enumerate() {
            logs.push(known(index, source).map_or_else(|| source.record(), Ok)?);
        }
        let rollouts: Result<_, EvaluationError> =
            files_of(path)?.iter().map(|file| CompanionRecord::of(file)).collect();
        Ok(Self {
            version: program_version().to_owned(),
            commit: program_commit().to_owned(),
            configs: args.wosac.configs.iter().map(|config| config.id.to_owned()).collect(),
            partial: args.wosac.partial,
            simulator: args.wosac.simulator.clone(),
            rollouts: rollouts?,
            logs,
        })
    }
}

/// Returns the files with the rollouts.
fn files_of(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if is_run(path) {
        return Ok(vec![path.join(SUMMARY), path.join(ROLLOUTS)]);
    }
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = fs::read_dir(path).and_then(|entries| entries.map(|e| Ok(e?.path())).collect());
    let mut files: Vec<PathBuf> = entries.with_context(|| format!("could not read {}", path.display()))?;
    files.retain(|file| file.is_file());
    files.sort();
    Ok(files)
}

impl Sharded for ScoreArgs {
    fn check(&self) -> anyhow::Result<()> {
        if !self.wosac.wosac {
            bail!("`score` can be divided into units with --wosac only");
        }
        if self.out.is_none() {
            bail!("give --out FOLDER for the scores: `shard merge` writes it");
        }
        Ok(())
    }

    fn divide(&self, arguments: Vec<String>, records: usize) -> anyhow::Result<ShardPlan> {
        let path = check(self)?;
        let counts: Vec<usize> = if is_run(path) {
            run_pairs(self, path)?;
            log_sources::recorded(&self.scenarios)?.par_iter().map(LogSource::count).collect()
        } else {
            submitted_pairs(self, path)?;
            vec![SubmissionReader::open(path)?.count()]
        };
        let subject = RealismSubject::of(self, path, |_, _| None)?;
        Ok(ShardPlan::divide(arguments, &subject, &counts, records)?)
    }

    fn jobs(&self) -> usize {
        self.wosac.jobs()
    }

    fn prepare<'a>(
        &'a self,
        plan: &ShardPlan,
        units: &[usize],
        settings: WorkSettings<'a>,
    ) -> anyhow::Result<Box<dyn Work + 'a>> {
        let path = check(self)?;
        let planned: RealismSubject = plan.subject()?;
        let used = plan.inputs_of(units)?;
        // A unit of a submission may need any log.
        let is_used = |index: usize| !is_run(path) || used.contains(&index);
        let known = |index: usize, source: &LogSource| {
            let record = planned.logs.get(index).filter(|record| source.is_named(record))?;
            (!is_used(index)).then(|| record.clone())
        };
        let subject = RealismSubject::of(self, path, known);
        let subject = subject.context("paths in the plan are relative to the folder in which it was made")?;
        if !is_run(path) {
            // Its files are checked before the first unit.
            submitted_pairs(self, path)?;
        }
        Ok(Box::new(RealismWork {
            args: self,
            path,
            planned,
            subject,
            how: settings,
            open: RefCell::new(None),
        }))
    }

    fn merge(&self, _: &ShardPlan, units: &FinishedUnits, progress: &Progress) -> anyhow::Result<ExitStatus> {
        let path = check(self)?;
        let _lock = self.out.as_deref().map(lock_folder).transpose()?;
        let mut scores = RealismScores { configs: self.wosac.configs.clone(), ..RealismScores::default() };
        for unit in &units.units {
            scores.add_unit(unit)?;
            progress.set_done(scores.rows.len() + scores.failures.len());
        }
        if is_run(path) {
            run_pairs(self, path)?.simulator().clone_into(&mut scores.method);
            if self.wosac.partial {
                scores.missing.clear();
            }
        } else {
            let mut pairs = submitted_pairs(self, path)?;
            pairs.pass_over(usize::MAX);
            describe_submission(self, &mut scores, &mut pairs, &mut observer(progress));
        }
        progress.end();
        finish(self, &scores)
    }
}

/// Scores, prepared in this process.
struct RealismWork<'a> {
    args: &'a ScoreArgs,
    path: &'a Path,
    /// The settings and files as the plan knows them, and as this process does.
    planned: RealismSubject,
    subject: RealismSubject,
    how: WorkSettings<'a>,
    /// A submission that is open, and the number of scenarios that were read.
    open: RefCell<Option<(SubmittedPairs, usize)>>,
}

impl RealismWork<'_> {
    /// Returns the scores of a range, and the number of records in it that are there.
    fn scores(&self, range: RecordRange) -> anyhow::Result<Option<(RealismScores, usize)>> {
        let (configs, jobs, stop) = (&self.args.wosac.configs, self.how.jobs, self.how.stop);
        let mut observe = observer(self.how.progress);
        let going = || !stop.load(Ordering::Relaxed);
        let (scores, records) = if is_run(self.path) {
            let mut pairs = run_pairs(self.args, self.path)?.within(range);
            let mut scores = score_all(pairs.by_ref().take_while(|_| going()), configs, jobs, &mut observe);
            describe_run(self.args, &mut scores, &pairs);
            (scores, pairs.logs())
        } else {
            let mut open = self.open.borrow_mut();
            let earlier = open.take().filter(|(_, read)| *read <= range.first);
            let (mut pairs, read) = match earlier {
                Some(earlier) => earlier,
                None => (submitted_pairs(self.args, self.path)?, 0),
            };
            pairs.pass_over(range.first - read);
            let of_unit = pairs.by_ref().take(range.count).take_while(|_| going());
            let scores = score_all(of_unit, configs, jobs, &mut observe);
            let records = scores.rows.len() + scores.failures.len();
            *open = Some((pairs, range.end()));
            (scores, records)
        };
        Ok(going().then_some((scores, records)))
    }
}

impl Work for RealismWork<'_> {
    fn check(&self, plan: &ShardPlan, unit: &Unit) -> Result<(), ShardError> {
        let mut now = self.subject.clone();
        if is_run(self.path) {
            unit.trust_other_inputs(&self.planned.logs, &mut now.logs);
        }
        plan.check(&now)
    }

    fn carry_out(&self, unit: &Unit, folder: &Path) -> Result<Option<UnitResults>, ShardError> {
        let scores = self.scores(unit.range).map_err(|error| ShardError::Work(error.into()))?;
        let Some((scores, records)) = scores else { return Ok(None) };
        scores.write_unit(folder)?;
        Ok(Some(UnitResults { records, failed: scores.failures.len(), files: vec![UNIT_SCORES] }))
    }
}
