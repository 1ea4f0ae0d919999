//! Curation in units.

use std::path::Path;

use anyhow::{Context, bail};
use rayon::prelude::*;

use super::make::{MakeArgs, finish};
use super::source::OpenSource;
use super::{CurateArgs, CurateCommand};
use crate::cli::ExitStatus;
use crate::cli::progress::Progress;
use crate::cli::sharded::{Sharded, WorkSettings};
use crate::curation::driver::{Curation, Input};
use crate::curation::shards::merge;
use crate::curation::store::Writer;
use crate::curation::{CurationProvenance, CurationSettings};
use crate::files::name_of;
use crate::formats::{self, count_records};
use crate::shards::{FinishedUnits, ShardError, ShardPlan, Unit, UnitResults, Work};

impl CurateArgs {
    /// Returns the arguments of curation itself.
    fn made(&self) -> anyhow::Result<&MakeArgs> {
        match (&self.command, &self.make) {
            (None, Some(args)) => Ok(args),
            (Some(CurateCommand::Stats(_)), _) => bail!("`curate stats` cannot be divided into units"),
            (Some(CurateCommand::Review(_)), _) => bail!("`curate review` cannot be divided into units"),
            (Some(CurateCommand::Apply(_)), _) => bail!("`curate apply` cannot be divided into units"),
            (None, None) => bail!("name files or folders of scenarios"),
        }
    }
}

impl Sharded for CurateArgs {
    fn check(&self) -> anyhow::Result<()> {
        self.made()?.out()?;
        Ok(())
    }

    fn divide(&self, arguments: Vec<String>, records: usize) -> anyhow::Result<ShardPlan> {
        let args = self.made()?;
        let inputs = args.inputs(self.reading.find_inputs(&args.scenarios)?, |_, _| None)?;
        let subject = args.provenance(&args.settings(), &self.reading, &inputs)?;
        let counts: Vec<usize> = inputs.par_iter().map(|input| count_records(&input.open)).collect();
        Ok(ShardPlan::divide(arguments, &subject, &counts, records)?)
    }

    fn jobs(&self) -> usize {
        self.made().map_or(1, MakeArgs::jobs)
    }

    fn prepare<'a>(
        &'a self,
        plan: &ShardPlan,
        units: &[usize],
        settings: WorkSettings<'a>,
    ) -> anyhow::Result<Box<dyn Work + 'a>> {
        let args = self.made()?;
        let planned: CurationProvenance = plan.subject()?;
        let (used, found) = (plan.inputs_of(units)?, self.reading.find_inputs(&args.scenarios)?);
        if found.len() != planned.inputs.len() {
            let (now, then) = (found.len(), planned.inputs.len());
            bail!("the plan has {then} input files, and {now} are here: use the planned ones, or plan again");
        }
        let known = |index: usize, input: &formats::Input| {
            let file = planned.inputs.get(index).filter(|_| !used.contains(&index))?;
            (name_of(&input.path) == file.name).then(|| file.clone())
        };
        let inputs = args.inputs(found, known);
        let inputs = inputs.context("paths in the plan are relative to the folder in which it was made")?;
        let curation_settings = args.settings();
        let subject = args.provenance(&curation_settings, &self.reading, &inputs)?;
        let source = args.source.open(args.temperature)?;
        Ok(Box::new(CurationWork {
            inputs,
            source,
            settings: curation_settings,
            planned,
            subject,
            how: settings,
        }))
    }

    fn merge(
        &self,
        plan: &ShardPlan,
        units: &FinishedUnits,
        progress: &Progress,
    ) -> anyhow::Result<ExitStatus> {
        let args = self.made()?;
        let (mut writer, source) = (Writer::create(args.out()?)?, args.source.open(args.temperature)?);
        let merged = merge(plan.subject()?, &units.units, &mut writer, progress);
        progress.end();
        finish(args, &source, writer, &merged?)
    }
}

/// A curation, prepared in this process.
struct CurationWork<'a> {
    inputs: Vec<Input>,
    source: OpenSource,
    settings: CurationSettings,
    /// The curation before it begins, as the plan knows it, and as this process does.
    planned: CurationProvenance,
    subject: CurationProvenance,
    how: WorkSettings<'a>,
}

impl Work for CurationWork<'_> {
    fn check(&self, plan: &ShardPlan, unit: &Unit) -> Result<(), ShardError> {
        let mut now = self.subject.clone();
        unit.trust_other_inputs(&self.planned.inputs, &mut now.inputs);
        plan.check(&now)
    }

    fn carry_out(&self, unit: &Unit, folder: &Path) -> Result<Option<UnitResults>, ShardError> {
        let Self { inputs, source, settings, how, .. } = self;
        let curation = Curation { inputs, source: source.source(), settings, jobs: how.jobs };
        curation.run_range(unit.range, folder, how.progress, how.stop).map_err(ShardError::work)
    }
}
