//! Realism metrics of `reactsim study realism`.

use std::path::Path;

use anyhow::Context;

use crate::cli::output::{say, write_result};
use crate::cli::progress::Progress;
use crate::evaluation::read_summary;
use crate::evaluation::realism::{
    LogSource, REALISM_ROWS, RealismSettings, RealismSummary, RunPairs, score_all,
};
use crate::metrics::wosac::Config;
use crate::rollout::Protocol;
use crate::work::available_threads;

/// Scores the kept rollouts of the realism protocol by the metrics of the Sim Agents challenge, and writes
/// the scores into the folder of the study.
pub(super) fn score_realism(study: &Path, sources: &[LogSource]) -> anyhow::Result<()> {
    let run = study.join(Protocol::Realism.name());
    let (mut summaries, mut rows) = (Vec::new(), Vec::new());
    let settings =
        RealismSettings { configs: &[Config::CHALLENGE_2025], shares: false, jobs: available_threads() };
    for simulator in read_summary(&run)?.provenance.run.simulators {
        let progress = Progress::new();
        let mut observe = |done: usize, _: Option<&_>| progress.set_done(done);
        let pairs = RunPairs::open(&run, Some(&simulator.id), sources.to_vec())?;
        let mut scores = score_all(pairs, &settings, &mut observe);
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
    write_result(Some(&study.join(REALISM_ROWS)), |out| out.write_all(&rows))
}
