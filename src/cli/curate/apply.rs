//! `reactsim curate apply`: applies the decisions of reviewers to a new file.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::cli::output::{ExitStatus, count, say};
use crate::curation::apply::{self, ApplyReport, RefusedPick};
use crate::curation::decisions::Decisions;
use crate::curation::{Application, InputFile, store};
use crate::evaluation::{FileRecord, program_commit, program_version};

/// Arguments of `curate apply`.
#[derive(Debug, Args)]
pub(super) struct ApplyArgs {
    /// A file that `curate` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Decisions that the page of `curate review` exported; of several about a scenario, the latest counts
    #[arg(required = true, value_name = "DECISIONS")]
    decisions: Vec<PathBuf>,
    /// Also accept picked candidates that a filter rejected
    #[arg(long)]
    allow_rejected: bool,
    /// File to write, with all candidates
    #[arg(long, value_name = "FILE2")]
    out: PathBuf,
}

pub(super) fn apply(args: &ApplyArgs) -> anyhow::Result<ExitStatus> {
    // Report every input error before writing anything.
    store::read(&args.file)?;
    let decisions = Decisions::read(&args.decisions)?;
    let file = |path: &Path| -> anyhow::Result<InputFile> {
        let FileRecord { name, blake3: digest, .. } = FileRecord::of(path, "")?;
        Ok(InputFile { name, digest })
    };
    let application = Application {
        version: program_version().to_owned(),
        commit: program_commit().to_owned(),
        file: file(&args.file)?,
        reviews: args.decisions.iter().map(|path| file(path)).collect::<Result<_, _>>()?,
        allow_rejected: args.allow_rejected,
    };
    let applied = apply::apply(&args.file, &args.out, application, &decisions)?;
    report(&applied);
    let scenarios = count(applied.scenarios, "scenario");
    say(format_args!("{}: {} of {scenarios} chosen", args.out.display(), applied.chosen));
    Ok(ExitStatus::Done)
}

/// Prints what was applied and what was not.
fn report(applied: &ApplyReport) {
    let ApplyReport { picked, picked_rejected, refused, dropped, marked, unfit, unknown, .. } = applied;
    say(format_args!("{picked} picked, {dropped} dropped, {marked} only marked"));
    if *picked_rejected > 0 {
        say(format_args!(
            "warning: {} picked despite rejection by a filter",
            count(*picked_rejected, "candidate")
        ));
    }
    if let Some(first) = refused.first() {
        let n = count(refused.len(), "pick");
        let RefusedPick { scenario_id, candidate, rejected_by } = first;
        say(format_args!(
            "warning: {n} not applied: rejected by a filter, such as candidate {candidate} of scenario \
             `{scenario_id}` by `{rejected_by}`; give --allow-rejected to accept them"
        ));
    }
    if let Some(first) = unfit.first() {
        let n = count(unfit.len(), "decision");
        say(format_args!(
            "warning: {n} not applied: made for other candidates, such as the one for scenario `{first}`"
        ));
    }
    if *unknown > 0 {
        let n = count(*unknown, "decision");
        say(format_args!(
            "warning: {n} not applied: the scenario is not in the file, or its content differs"
        ));
    }
}
