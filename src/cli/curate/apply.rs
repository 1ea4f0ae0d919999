//! `reactsim curate apply`: applies the decisions of reviewers to a new file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Args;

use crate::cli::is_same;
use crate::cli::{ExitStatus, count, say};
use crate::curation::apply::{self, ApplyReport, FinalDecision, RefusedPick};
use crate::curation::review::{Agreement, Journal, ReviewLine};
use crate::curation::store::Store;
use crate::curation::{Application, Decision, InputFile, ScenarioRecord};
use crate::evaluation::{FileRecord, program_commit, program_version};

/// Arguments of `curate apply`.
#[derive(Debug, Args)]
pub(super) struct ApplyArgs {
    /// A file that `curate` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Journals of other reviewers, in addition to FILE.reviews.jsonl, which `curate review` writes
    #[arg(long, num_args = 1.., value_name = "JOURNAL")]
    reviews: Vec<PathBuf>,
    /// Apply what more than half of the reviewers of a scenario decided, and nothing where there is no
    /// majority [default: the latest decision]
    #[arg(long)]
    majority: bool,
    /// Also accept picked candidates that a filter rejected
    #[arg(long)]
    allow_rejected: bool,
    /// File to write, with all candidates
    #[arg(long, value_name = "FILE2")]
    out: PathBuf,
}

pub(super) fn apply(args: &ApplyArgs) -> anyhow::Result<ExitStatus> {
    // Report every input error before writing anything.
    let store = Store::open(&args.file)?;
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
        let Some((line, fits)) = opinions.verdict_for(record, args.majority) else {
            let is_decision = |l: &ReviewLine| l.decision != Decision::Clear;
            let is_current = opinions.verdict(&record.scenario_digest).is_some();
            outdated += usize::from(!is_current && opinions.0.values().any(is_decision));
            return None;
        };
        Some(FinalDecision { mark: line.mark(), candidate: line.candidate, fits })
    };
    let applied = apply::apply(&args.file, &args.out, application, decided)?;
    if let Some(agreement) = Agreement::about(store.scenarios(), &decisions) {
        say(format_args!("{agreement}"));
    }
    let disputed = Disputed { scenarios: disagreements, by_majority: args.majority };
    report(&applied, &disputed, outdated + decisions.len() - known.len());
    let n = store.scenarios().len();
    say(format_args!("{}: {} of {} chosen", args.out.display(), applied.chosen, count(n, "scenario")));
    Ok(ExitStatus::Done)
}

/// Returns the journals to read, each once: first the file's own journal if it exists, then those
/// of `--reviews`.
fn journals(args: &ApplyArgs) -> anyhow::Result<Vec<PathBuf>> {
    let beside = Journal::path_for(&args.file);
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
            "no decisions to apply: {beside} does not exist; run `reactsim curate review {file}`, \
             or give --reviews"
        );
    }
    Ok(journals)
}

/// Scenarios about which reviewers disagree.
struct Disputed {
    scenarios: usize,
    by_majority: bool,
}

/// Prints what was applied and what was not.
fn report(applied: &ApplyReport, disputed: &Disputed, unknown: usize) {
    let ApplyReport { picked, picked_rejected, refused, dropped, marked, unfit, .. } = applied;
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
    if disputed.scenarios > 0 {
        let n = count(disputed.scenarios, "scenario");
        let rule = if disputed.by_majority { "the majority decides" } else { "the latest decision holds" };
        say(format_args!("warning: reviewers disagree about {n}; {rule}"));
    }
    if let Some(first) = unfit.first() {
        let n = count(unfit.len(), "decision");
        say(format_args!(
            "warning: {n} not applied: made for other candidates, such as the one for scenario `{first}`"
        ));
    }
    if unknown > 0 {
        let n = count(unknown, "decision");
        say(format_args!(
            "warning: {n} not applied: the scenario is not in the file, or its content differs"
        ));
    }
}
