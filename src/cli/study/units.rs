//! A study in units: those of all members.

use anyhow::bail;

use super::StudyArgs;
use super::carry_out::{finish, finish_member};
use crate::cli::ExitStatus;
use crate::cli::progress::Progress;
use crate::cli::run::units::{divide, known_sources, refuse_stdout, work};
use crate::cli::sharded::{Sharded, WorkSettings, refuse};
use crate::evaluation::shards::{ShardedRuns, merge};
use crate::evaluation::{STUDY_TABLE, StudyFolder, read_summary};
use crate::shards::{FinishedUnits, ShardError, ShardPlan, Work};

impl Sharded for StudyArgs {
    fn check(&self) -> anyhow::Result<()> {
        let shared = self.shared();
        refuse(&[("--resume", shared.resume)])?;
        refuse_stdout(&shared.subject)?;
        shared.table.check(&shared.format, &super::FORMATS)
    }

    fn divide(&self, arguments: Vec<String>, records: usize) -> anyhow::Result<ShardPlan> {
        let (mut plan, _outside) = self.plan(self.shared().subject.sources()?)?;
        divide(&mut plan, arguments, records)
    }

    fn jobs(&self) -> usize {
        self.shared().work.execution().jobs
    }

    fn prepare<'a>(
        &'a self,
        shards: &ShardPlan,
        units: &[usize],
        settings: WorkSettings<'a>,
    ) -> anyhow::Result<Box<dyn Work + 'a>> {
        let planned: ShardedRuns = shards.subject()?;
        let shared = self.shared();
        let (plan, outside) = self.plan(known_sources(&shared.subject, shards, &planned, units)?)?;
        work(Box::new(plan), &outside, planned, shared.work.execution(), settings)
    }

    fn merge(
        &self,
        plan: &ShardPlan,
        units: &FinishedUnits,
        progress: &Progress,
    ) -> anyhow::Result<ExitStatus> {
        let (planned, shared) = (plan.subject::<ShardedRuns>()?, self.shared());
        if shared.out.join(STUDY_TABLE).exists() {
            return Err(ShardError::Merged { path: shared.out.clone() }.into());
        }
        // Nothing is run, so no file has to be read for its digest.
        let (mut study, _outside) = self.plan(known_sources(&shared.subject, plan, &planned, &[])?)?;
        let members = study.study().members.clone();
        if members.len() != planned.runs.len() {
            bail!("the plan is of another study than its arguments: plan again");
        }
        let folder = StudyFolder::resume(&shared.out, &mut study)?;
        let (mut failed, mut done) = (0, 0);
        for (part, (member, run)) in members.iter().zip(&planned.runs).enumerate() {
            let (units, out) = (units.of_part(part), folder.member(member));
            let summary = match merge(units, run, &out, &|records| progress.set_done(done + records)) {
                Ok((run, summary)) => {
                    finish_member(&run, &summary, shared, part == 0)?;
                    summary
                }
                // By an earlier merge that was interrupted.
                Err(ShardError::Merged { path }) => read_summary(&path)?,
                Err(error) => return Err(error.into()),
            };
            done += units.iter().map(|unit| unit.record.records).sum::<usize>();
            failed += summary.provenance.failures.len();
        }
        progress.end();
        finish(&folder, shared, &study, failed)
    }
}
