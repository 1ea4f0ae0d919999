//! Runs the members of a study one after the other and writes the table.

use std::path::Path;

use anyhow::Context;

use super::realism::score_realism;
use super::{PlannedStudy, SharedArgs};
use crate::cli::external::{keep_stderr, report_faults};
use crate::cli::finished::{put_table, report_left_out, report_notes};
use crate::cli::output::{ExitStatus, nothing, say, stop_on_interrupt, write_result};
use crate::cli::partition::{self, Partitions};
use crate::cli::progress::Progress;
use crate::cli::subject::log_sources;
use crate::evaluation::{
    self, LogErrors, Outcome, PlannerRanks, RunFolder, STUDY_TABLE, StudyFolder, StudyKind, StudyResults,
    Summary,
};
use crate::report::{TableStyle, study_tables, training_paths};

/// Name of the picture of networks along trainings in the folder of a study.
const TRAINING_PATHS: &str = "paths.svg";

pub(super) fn carry_out(
    (mut plan, programs): PlannedStudy,
    shared: &SharedArgs,
) -> anyhow::Result<ExitStatus> {
    for i in (0..plan.study().members.len()).rev() {
        plan.select(i).spec.to_toml_in(&shared.out)?;
    }
    let folder = match shared.resume {
        true => StudyFolder::resume(&shared.out, &mut plan)?,
        false => StudyFolder::create(&shared.out, plan.study())?,
    };
    keep_stderr(&programs, Some(folder.path()))?;
    let stop = stop_on_interrupt("writing what is finished")?;
    let members = plan.study().members.clone();
    let mut failed = 0;
    for (i, member) in members.iter().enumerate() {
        let plan = plan.select(i);
        let provenance = plan.provenance();
        let which = format!("{} of {}: {}", i + 1, members.len(), member.label);
        if folder.finished(member, &provenance)?.is_some() {
            say(format_args!("{which}: already finished"));
            continue;
        }
        say(format_args!("{which}"));
        let mut tally = provenance.tally();
        let run = RunFolder::resume(&folder.member(member), &provenance, &mut tally)?;
        plan.spec.write(run.path())?;
        let progress = Progress::new();
        let outcome = evaluation::run(plan, shared.work.execution(), Some(&run), tally, &progress, &stop);
        progress.end();
        let Outcome::Finished(summary) = outcome? else {
            say(format_args!(
                "interrupted; finished rows are in {}; to continue, repeat the command with --resume",
                folder.path().display()
            ));
            return Ok(ExitStatus::Interrupted);
        };
        finish_member(&run, &summary, shared, i == 0)?;
        // A partition may have none.
        if shared.partition.partition.is_none() {
            refuse_empty(&summary)?;
        }
        failed += summary.provenance.failures.len();
    }
    report_faults(&programs, Some(folder.path()));
    if let Some(partition) = shared.partition.partition {
        return partition::finish(folder.path(), partition, failed, &());
    }
    finish(&folder, shared, (plan, programs), failed)
}

/// Joins the partitions of all members and writes the table.
pub(super) fn merge(
    (plan, programs): PlannedStudy,
    shared: &SharedArgs,
    partitions: &Partitions,
    out: &Path,
) -> anyhow::Result<ExitStatus> {
    let folder = StudyFolder::create(out, plan.study())?;
    let mut failed = 0;
    for (i, member) in plan.study().members.iter().enumerate() {
        let folders: Vec<_> = partitions.folders.iter().map(|of| of.join(&member.folder)).collect();
        let (run, summary) = evaluation::merge(&folders, &folder.member(member))?;
        finish_member(&run, &summary, shared, i == 0)?;
        refuse_empty(&summary)?;
        failed += summary.provenance.failures.len();
    }
    finish(&folder, shared, (plan, programs), failed)
}

fn refuse_empty(summary: &Summary) -> anyhow::Result<()> {
    if summary.provenance.scenarios == 0 {
        return Err(nothing("no scenario could be run"));
    }
    Ok(())
}

/// Writes the table of a member and reports what it left out.
fn finish_member(
    run: &RunFolder,
    summary: &Summary,
    shared: &SharedArgs,
    is_first: bool,
) -> anyhow::Result<()> {
    let style = TableStyle { also: shared.table.style().also, ..TableStyle::default() };
    put_table(run, summary, style)?;
    // All members leave out the same.
    if is_first || summary.provenance.scenarios == 0 {
        report_left_out(summary);
        report_notes(summary);
    }
    Ok(())
}

/// Computes the realism metrics of a study of realism, the ranks of a study of planners, or the displacements of a
/// study of errors, and writes and prints the table. `failed` is the number of failures of all members.
fn finish(
    folder: &StudyFolder,
    shared: &SharedArgs,
    (mut plan, programs): PlannedStudy,
    failed: usize,
) -> anyhow::Result<ExitStatus> {
    let kind = plan.study().kind;
    if kind == StudyKind::Realism && plan.select(0).spec.keeps_rollouts() {
        score_realism(folder.path(), &log_sources(&shared.spec.value.subject)?)?;
    }
    if kind == StudyKind::Planners {
        PlannerRanks::of_study(folder.path())?.write(folder.path())?;
    }
    if kind == StudyKind::Errors {
        LogErrors::of_study(folder.path(), plan.sources())?.write(folder.path())?;
    }
    // Standard output may belong to one of the programs until it has ended.
    drop((plan, programs));
    let results = StudyResults::read(folder.path())?;
    let (mut text, style) = (Vec::new(), shared.table.style());
    study_tables::write_markdown(&results, style, &mut text).context("could not make the table")?;
    folder.put(STUDY_TABLE, &String::from_utf8_lossy(&text))?;
    if let Some(paths) = training_paths::draw(&results)? {
        folder.put(TRAINING_PATHS, &paths)?;
        say(format_args!("picture: {}", folder.path().join(TRAINING_PATHS).display()));
    }
    write_result(None, |out| match shared.format.as_str() {
        "json" => study_tables::write_json(&results, style, out),
        "latex" => study_tables::write_latex(&results, style, out),
        _ => out.write_all(&text),
    })?;
    if failed > 0 {
        say(format_args!("warning: {failed} failed; the others are in the table"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}
