//! External simulators and planners on the command line.

use std::num::NonZeroUsize;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;

use super::duration::duration;
use super::{count, say};
use crate::evaluation::Plan;
use crate::external::{
    Command, ExternalPlanner, ExternalSettings, ExternalSimulator, Processes, RunOutline, StderrTarget,
    TimeLimits,
};
use crate::rollout::Request;

/// Command for our own standard input and output.
const STDIO: &str = "@stdio";

/// Arguments for external simulators.
#[derive(Debug, Args)]
pub(super) struct ExternalArgs {
    /// External simulator: a command that speaks the protocol over standard input and output, such as
    /// mine='python mine.py', or @stdio for the parent process; may be repeated. Without --models,
    /// only external simulators run
    #[arg(long, value_name = "NAME=COMMAND", help_heading = HEADING)]
    external: Vec<String>,
    /// External planner: a command that speaks the protocol for planners, such as mine='python mine.py', or
    /// @stdio; it drives the AV with --av planner:external:NAME; may be repeated
    #[arg(long, value_name = "NAME=COMMAND", help_heading = HEADING)]
    planner: Vec<String>,
    /// Processes per external simulator or planner; they do not change any result
    #[arg(long, default_value_t = 1, value_name = "N", help_heading = HEADING)]
    external_workers: usize,
    /// Scenarios per batch of an external simulator; part of the provenance [default: what it asks
    /// for, else 16]
    #[arg(long, value_name = "N", help_heading = HEADING)]
    external_batch: Option<usize>,
    /// Time until an external simulator greets, such as 300s or 10m [default: 300s, none for @stdio]
    #[arg(long, value_name = "TIME", value_parser = duration, help_heading = HEADING)]
    external_start_limit: Option<Duration>,
    /// Time for the first batch and its first plan in a process [default: 300s, none for @stdio]
    #[arg(long, value_name = "TIME", value_parser = duration, help_heading = HEADING)]
    external_first_limit: Option<Duration>,
    /// Time for every later answer [default: 60s, none for @stdio]
    #[arg(long, value_name = "TIME", value_parser = duration, help_heading = HEADING)]
    external_limit: Option<Duration>,
    /// Pass ids of scenarios and agents and world coordinates to external simulators; every table
    /// marks them with §
    #[arg(long, requires = "external", help_heading = HEADING)]
    reveal_ids: bool,
}

/// Option for simulators.
const EXTERNAL: &str = "--external";
/// Option for planners.
const PLANNER: &str = "--planner";

const HEADING: &str = "External simulators and planners";

impl ExternalArgs {
    /// Returns whether there is any.
    pub(super) fn is_any(&self) -> bool {
        !self.external.is_empty()
    }

    /// Returns whether our standard output belongs to a simulator or planner.
    pub(super) fn takes_stdout(&self) -> bool {
        let all = self.external.iter().chain(&self.planner);
        all.into_iter().any(|text| text.ends_with(&format!("={STDIO}")))
    }

    /// Starts the simulators and planners.
    pub(super) fn start(&self, outline: &RunOutline) -> anyhow::Result<Outside> {
        let mut outside = Outside::default();
        let mut has_parent = false;
        for (option, text) in self.given() {
            let Some((name, command)) = text.split_once('=') else {
                bail!("{option} `{text}`: write NAME=COMMAND, such as mine='python mine.py'");
            };
            let command = match command.trim() {
                STDIO if has_parent => {
                    bail!("{option} `{text}`: only one simulator or planner can be the parent process");
                }
                STDIO => Command::Stdio,
                line => Command::Shell(line.to_owned()),
            };
            has_parent |= command == Command::Stdio;
            if outside.processes().any(|processes| processes.name() == name) {
                bail!("{option} `{text}`: the name is given twice");
            }
            let settings = ExternalSettings {
                workers: self.external_workers,
                batch: self.external_batch,
                limits: self.limits(&command),
                reveal_ids: self.reveal_ids,
                ..ExternalSettings::new(name, command)
            };
            if option == PLANNER {
                outside.planners.push(ExternalPlanner::start(settings, outline.clone())?);
            } else {
                outside.simulators.push(ExternalSimulator::start(settings, outline.clone())?);
            }
        }
        Ok(outside)
    }

    /// Returns the definitions of simulators and planners, with their options.
    fn given(&self) -> impl Iterator<Item = (&'static str, &String)> {
        let simulators = self.external.iter().map(|text| (EXTERNAL, text));
        simulators.chain(self.planner.iter().map(|text| (PLANNER, text)))
    }

    fn limits(&self, command: &Command) -> TimeLimits {
        // A parent process may be stopped in a debugger.
        let default = if *command == Command::Stdio { TimeLimits::none() } else { TimeLimits::default() };
        TimeLimits {
            start: self.external_start_limit.unwrap_or(default.start),
            first: self.external_first_limit.unwrap_or(default.first),
            plan: self.external_limit.unwrap_or(default.plan),
        }
    }
}

/// The running external simulators and planners of a command.
#[derive(Default)]
pub(super) struct Outside {
    pub(super) simulators: Vec<ExternalSimulator>,
    pub(super) planners: Vec<ExternalPlanner>,
}

impl Outside {
    fn processes(&self) -> impl Iterator<Item = &Processes> {
        let simulators = self.simulators.iter().map(ExternalSimulator::processes);
        simulators.chain(self.planners.iter().map(ExternalPlanner::processes))
    }

    /// Stores the standard error of the processes in the folder of the run; without a folder, it is passed on
    /// with the name of the simulator or planner.
    pub(super) fn keep_stderr(&self, folder: Option<&Path>) -> anyhow::Result<()> {
        for processes in self.processes() {
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
    pub(super) fn report_faults(&self, folder: Option<&Path>) {
        let simulators = self.simulators.iter().map(|own| (own.processes(), "a batch failed and ran again"));
        let planners = self.planners.iter().map(|own| (own.processes(), "a request failed"));
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
            let difference = simulator.compare_batches(&requests, &plan.settings.rollout);
            compared += difference.scenarios;
            largest = largest.max(difference.largest);
        }
        say(format_args!(
            "{}: {compared} scenarios together, at most {} per batch, and one at a time: positions differ by \
             at most {largest} m",
            simulator.name(),
            simulator.batch(),
        ));
    }
    Ok(())
}
