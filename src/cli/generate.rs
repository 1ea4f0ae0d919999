//! `reactsim generate`: synthetic scenarios.

mod bench;
mod job;
mod manifest;
mod partition;
mod scenario_file;
mod tried;

pub(super) use job::GenerateArgs;
pub(super) use partition::merge;

use std::ops::ControlFlow;

use self::bench::bench;
use self::job::{GeneratedFiles, Job, finish};
use super::output::{ExitStatus, stop_on_interrupt};
use super::progress::Progress;
use crate::curation::driver::CurationObserver;
use crate::formats::FormatError;
use crate::formats::native::Writer;
use crate::generation::{Ending, Generator, Preset, in_order};

pub(super) fn generate(args: &GenerateArgs) -> anyhow::Result<ExitStatus> {
    if let Some(partition) = args.partition.partition {
        return partition::generate(args, partition);
    }
    let (out, wanted, settings, jobs) =
        (args.out.as_path(), args.count, &args.settings()?, args.jobs.count());
    let stop = stop_on_interrupt("writing what is finished")?;
    let progress = Progress::new();
    let job = Job { settings, wanted, jobs, out, progress: &progress, stop: &stop };
    let generated = match settings.preset {
        Preset::Train | Preset::Sensed => train(job),
        Preset::Bench => bench(job, (0, std::iter::empty())),
    };
    progress.end();
    finish(args, &generated?)
}

/// Writes scenarios 0 to below `wanted` as generated. Scenarios that cannot be generated are
/// reported and left out.
fn train(job: Job<'_>) -> anyhow::Result<GeneratedFiles> {
    let Job { settings, wanted, jobs, out, progress, stop } = job;
    // Report every input error before the first scenario.
    let generator = Generator::new(settings.clone())?;
    let mut writer = Writer::create(out)?;
    progress.set_total(Some(wanted as usize));
    let mut counts = (0, 0);
    let generate = |_: &(usize, usize), number| generator.scenario(number);
    let ending = in_order(u64::from(wanted), jobs, stop, &mut counts, generate, |counts, _, scenario| {
        match scenario {
            Ok(scenario) => {
                writer.write(&scenario)?;
                counts.0 += 1;
            }
            Err(error) => {
                progress.failed(&error.to_string());
                counts.1 += 1;
            }
        }
        progress.scenario_done(counts.0 + counts.1);
        Ok::<_, FormatError>(ControlFlow::Continue(()))
    })?;
    let (written, failed) = counts;
    let interrupted = ending == Ending::Stopped;
    let mut file = out.to_owned();
    if written > 0 && interrupted {
        file = writer.finish_part()?;
    } else if written > 0 {
        writer.finish()?;
    }
    Ok(GeneratedFiles { files: vec![file], written, failed, unfilled: false, interrupted })
}
