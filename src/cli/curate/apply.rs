//! `reactsim curate apply`: decisions of reviewers into a new file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;

use super::is_same;
use crate::cli::{ExitStatus, count, say};
use crate::curation::apply::{self, Applied, Decided, Refused};
use crate::curation::review::{Journal, ReviewLine};
use crate::curation::store::Store;
use crate::curation::{Application, Decision, InputFile, ScenarioRecord};
use crate::evaluation::{FileRecord, program_commit, program_version};

/// Arguments of `curate apply`.
#[derive(Debug, Args)]
pub(super) struct ApplyArgs {
    /// A file that `curate` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Decisions of other reviewers, besides FILE.reviews.jsonl, which `curate review` writes
    #[arg(long, num_args = 1.., value_name = "JOURNAL")]
    reviews: Vec<PathBuf>,
    /// Take in picked candidates that a filter had rejected too
    #[arg(long)]
    allow_rejected: bool,
    /// The file to write, with all candidates
    #[arg(long, value_name = "FILE2")]
    out: PathBuf,
}

pub(super) fn apply(args: &ApplyArgs) -> anyhow::Result<ExitStatus> {
    // Everything that can be wrong is found before a byte is written.
    let store = Store::open(&args.file)?;
    if is_same(&args.file, &args.out) {
        bail!("{} is both input and output; choose another --out", args.file.display());
    }
    let journals = journals(args)?;
    let (decisions, warnings) = Journal::read_all(&journals)?;
    for warning in warnings {
        say(format_args!("warning: {warning}"));
    }
    let file = |path: &Path| -> anyhow::Result<InputFile> {
        let FileRecord { name, blake3: digest, .. } = FileRecord::of(path, "")?;
        Ok(InputFile { name, digest })
    };
    let application = Application {
        version: program_version().to_owned(),
        commit: program_commit().to_owned(),
        file: file(&args.file)?,
        reviews: journals.iter().map(|journal| file(journal)).collect::<Result<_, _>>()?,
        allow_rejected: args.allow_rejected,
    };
    let (mut known, mut disagreements, mut outdated) = (BTreeSet::new(), 0, 0);
    let decided = |record: &ScenarioRecord| {
        let (id, opinions) = decisions.get_key_value(&record.scenario_id)?;
        known.insert(id);
        disagreements += usize::from(opinions.disagree(&record.scenario_digest));
        let Some((line, fits)) = opinions.verdict_for(record) else {
            let stands = |l: &ReviewLine| l.decision != Decision::Clear;
            outdated += usize::from(opinions.0.values().any(stands));
            return None;
        };
        Some(Decided { mark: line.mark(), candidate: line.candidate, fits })
    };
    let applied = apply::apply(&args.file, &args.out, application, decided)?;
    tell(&applied, disagreements, outdated + decisions.len() - known.len());
    let n = store.scenarios().len();
    say(format_args!("{}: {} of {} chosen", args.out.display(), applied.chosen, count(n, "scenario")));
    Ok(ExitStatus::Done)
}

/// The journals to be read, each once: that beside the file where there is one, then those that are named.
fn journals(args: &ApplyArgs) -> anyhow::Result<Vec<PathBuf>> {
    let beside = Journal::beside(&args.file);
    let mut journals = Vec::new();
    if beside.exists() {
        journals.push(beside.clone());
    }
    for path in &args.reviews {
        if !journals.iter().any(|known| is_same(known, path)) {
            journals.push(path.clone());
        }
    }
    if journals.is_empty() {
        let (file, beside) = (args.file.display(), beside.display());
        bail!(
            "nothing was decided: {beside} is not there; run `reactsim curate review {file}`, or give --reviews"
        );
    }
    Ok(journals)
}

/// Says what became of the decisions.
fn tell(applied: &Applied, disagreements: usize, unknown: usize) {
    let Applied { picked, picked_rejected, refused, dropped, marked, unfit, .. } = applied;
    say(format_args!("{picked} picked, {dropped} dropped, {marked} only marked"));
    if *picked_rejected > 0 {
        say(format_args!(
            "warning: {} picked that a filter had rejected",
            count(*picked_rejected, "candidate")
        ));
    }
    if let Some(first) = refused.first() {
        let n = count(refused.len(), "pick");
        let Refused { scenario_id, candidate, rejected_by } = first;
        say(format_args!(
            "warning: {n} not applied: rejected by a filter, such as candidate {candidate} of scenario \
             `{scenario_id}` by `{rejected_by}`; give --allow-rejected to take them all the same"
        ));
    }
    if disagreements > 0 {
        let n = count(disagreements, "scenario");
        say(format_args!("warning: reviewers disagree about {n}; the latest decision holds"));
    }
    if let Some(first) = unfit.first() {
        let n = count(unfit.len(), "decision");
        say(format_args!(
            "warning: {n} not applied: made about other candidates, such as that about scenario `{first}`"
        ));
    }
    if unknown > 0 {
        let n = count(unknown, "decision");
        say(format_args!(
            "warning: {n} not applied: the file does not have the scenario, or another content of it"
        ));
    }
}
