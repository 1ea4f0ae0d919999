//! `reactsim study realism`: whether simulators that resemble the log also react to the AV.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use clap::Args;

use super::{PlannedStudy, SharedArgs};
use crate::cli::output::{say, write_file};
use crate::cli::progress::Progress;
use crate::cli::subject::plan;
use crate::evaluation::realism::{LogSource, REALISM_ROWS, RealismSummary, RunPairs, score_all};
use crate::evaluation::{RolloutSpec, Source, StudyPlan, read_summary};
use crate::external::RunOutline;
use crate::metrics::wosac::Config;
use crate::rollout::{Protocol, Replan};
use crate::work::available_threads;

/// Arguments of `study realism`.
#[derive(Debug, Args)]
pub(super) struct RealismArgs {
    /// Replan rate or interval, such as 2hz or 5steps
    #[arg(long, default_value = "2hz", value_name = "RATE")]
    replan: Replan,
    /// Rollouts per scenario and simulator in the realism protocol
    #[arg(long, default_value_t = 32, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
    /// Rollouts per scenario and simulator in the reactive protocol
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    reactive_rollouts: u32,
    #[command(flatten)]
    pub shared: SharedArgs,
}

pub(super) fn study(args: &RealismArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let protocols = vec!["reactive", "realism"];
    let outline = RunOutline { intervals: vec![args.replan.steps()], protocols };
    let (simulators, programs) = args.shared.simulators(&outline)?;
    let rollout =
        RolloutSpec { replan: args.replan, rollouts: args.reactive_rollouts, ..RolloutSpec::default() };
    let plan = plan(&args.shared.spec(rollout), sources, simulators, &programs, None)?;
    Ok((StudyPlan::realism(plan, args.rollouts), programs))
}

/// Scores the kept rollouts of the realism protocol by the metrics of the Sim Agents challenge, and writes
/// the scores into the folder of the study.
pub(super) fn score_realism(study: &Path, sources: &[LogSource]) -> anyhow::Result<()> {
    let run = study.join(Protocol::Realism.name());
    let (mut summaries, mut rows) = (Vec::new(), Vec::new());
    for simulator in read_summary(&run)?.provenance.run.simulators {
        let progress = Progress::new();
        let mut observe = |done: usize, _: Option<&_>| progress.set_done(done);
        let pairs = RunPairs::open(&run, Some(&simulator.id), sources.to_vec())?;
        let mut scores = score_all(pairs, &[Config::CHALLENGE_2025], available_threads(), &mut observe);
        progress.end();
        simulator.title.clone_into(&mut scores.method);
        if let Some(first) = scores.failures.first() {
            let (title, n) = (&simulator.title, scores.failures.len());
            say(format_args!(
                "warning: {title}: {n} scenarios have no realism metrics, first: {}",
                first.error
            ));
        }
        summaries.extend(RealismSummary::of(&simulator.id, &scores));
        scores.write_rows(&mut rows).context("could not make the rows")?;
    }
    RealismSummary::write_all(&summaries, study)?;
    let path = study.join(REALISM_ROWS);
    write_file(&path, |out: &mut dyn Write| out.write_all(&rows))
        .with_context(|| format!("could not write {}", path.display()))
}
