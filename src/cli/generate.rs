//! `reactsim generate`: synthetic scenarios.

mod bench;
mod job;
mod manifest;
mod partition;
mod scenario_file;
mod tried;

pub(super) use job::GenerateArgs;
pub(super) use partition::merge;

use self::bench::bench;
use self::job::{GeneratedFiles, Job, finish, write_all};
use super::output::{ExitStatus, stop_on_interrupt};
use super::progress::Progress;
use crate::formats::native::Writer;
use crate::generation::{Ending, Generator, Preset};

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

/// Writes scenarios 0 to below `wanted` as generated.
fn train(job: Job<'_>) -> anyhow::Result<GeneratedFiles> {
    // Report every input error before the first scenario.
    let generator = Generator::new(job.settings.clone())?;
    let mut writer = Writer::create(job.out)?;
    job.progress.set_total(Some(job.wanted as usize));
    let numbers = 0..u64::from(job.wanted);
    let (ending, written, failed) = write_all(job, &generator, numbers, |scenario| writer.write(scenario))?;
    let interrupted = ending == Ending::Stopped;
    let mut file = job.out.to_owned();
    if written > 0 && interrupted {
        file = writer.finish_part()?;
    } else if written > 0 {
        writer.finish()?;
    }
    Ok(GeneratedFiles { files: vec![file], written, failed, unfilled: false, interrupted })
}
