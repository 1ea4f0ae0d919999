//! External simulators and planners of a command.

use std::num::NonZeroUsize;
use std::path::Path;

use anyhow::Context;

use super::output::{count, say};
use crate::evaluation::{ExternalPrograms, Plan};
use crate::external::{ExternalSimulator, StderrTarget};
use crate::rollout::Request;

/// Stores the standard error of the processes in the folder of the run; without a folder, it is passed on
/// with the name of the simulator or planner.
pub(super) fn keep_stderr(programs: &ExternalPrograms, folder: Option<&Path>) -> anyhow::Result<()> {
    for processes in programs.processes() {
        let name = processes.name().to_owned();
        let target = match folder {
            Some(folder) => StderrTarget::File(folder.join(log_name(&name))),
            None => StderrTarget::Lines(Box::new(move |line| say(format_args!("{name}: {line}")))),
        };
        processes.set_stderr(target).context("could not write the log of an external program")?;
    }
    Ok(())
}

/// Warns of requests that failed, although a repetition may have hidden it.
pub(super) fn report_faults(programs: &ExternalPrograms, folder: Option<&Path>) {
    let simulators = programs.simulators.iter().map(|own| (own.processes(), "a batch failed and ran again"));
    let planners = programs.planners.iter().map(|own| (own.processes(), "a request failed"));
    for (processes, what) in simulators.chain(planners) {
        let Some((n, first)) = processes.faults() else { continue };
        let name = processes.name();
        let log = folder.map_or_else(String::new, |folder| {
            format!("; all are in {}", folder.join(log_name(name)).display())
        });
        let n = count(n, "time");
        // A foreign text cannot pass for another message.
        let first = first.replace('\n', "\n    ");
        say(format_args!("warning: {name}: {what} ({n}), the first: {first}{log}"));
    }
}

/// Returns the name of the file with the standard error of an external simulator.
fn log_name(simulator: &str) -> String {
    format!("external-{simulator}.log")
}

/// Repeats the first `count` scenarios one at a time and reports the largest difference to their batches.
pub(super) fn check_batches(
    plan: &Plan,
    simulators: &[ExternalSimulator],
    count: NonZeroUsize,
) -> anyhow::Result<()> {
    let mut scenarios = Vec::new();
    for source in &plan.sources {
        let readable = source.scenarios()?.filter_map(Result::ok);
        let with_av = readable.filter(|scenario| plan.av(scenario).is_ok());
        scenarios.extend(with_av.take(count.get() - scenarios.len()));
        if scenarios.len() == count.get() {
            break;
        }
    }
    for simulator in simulators {
        let (mut compared, mut largest) = (0, 0.0_f64);
        for batch in scenarios.chunks(simulator.batch()) {
            let requests =
                batch.iter().map(|scenario| Ok(Request { scenario, av: plan.av(scenario)?.0, rollout: 0 }));
            let requests = requests.collect::<anyhow::Result<Vec<_>>>()?;
            let difference = simulator.compare_batches(&requests, &plan.spec.settings());
            compared += difference.scenarios;
            largest = largest.max(difference.largest);
        }
        say(format_args!(
            "{}: {compared} scenarios together, at most {} per batch, and one at a time: positions differ by \
             at most {largest} m",
            simulator.processes().name(),
            simulator.batch(),
        ));
    }
    Ok(())
}
