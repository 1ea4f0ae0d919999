//! External simulators and planners of a specification.

use clap::Args;
use reactsim_external::{
    Command, ExternalPlanner, ExternalSettings, ExternalSimulator, Parent, Processes, RunOutline, STDIO,
    TimeLimits,
};
use serde::{Deserialize, Serialize};

use super::{RunSpec, Time};
use crate::error::EvaluationError;
use crate::simulators::PlannedSimulator;

const HEADING: &str = "External simulators and planners";

/// External simulators and planners.
#[derive(Clone, Debug, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct ExternalSpec {
    /// External simulator: a command that speaks the protocol over standard input and output, such as
    /// mine='python mine.py', or @stdio for the parent process; may be repeated. Without --models,
    /// only external simulators run
    #[arg(long, value_name = "NAME=COMMAND", help_heading = HEADING)]
    pub external: Vec<String>,
    /// External planner: a command that speaks the protocol for planners, such as mine='python mine.py', or
    /// @stdio; it drives the AV with --av planner:external:NAME; may be repeated
    #[arg(long, value_name = "NAME=COMMAND", help_heading = HEADING)]
    pub planner: Vec<String>,
    /// Processes per external simulator or planner; they do not change any result [default: 1]
    #[arg(long, value_name = "N", help_heading = HEADING)]
    pub external_workers: usize,
    /// Scenarios per batch of an external simulator; part of the provenance [default: what it asks
    /// for, else 16]
    #[arg(long, value_name = "N", help_heading = HEADING)]
    pub external_batch: Option<usize>,
    /// Time until an external simulator greets, such as 300s or 10m [default: 300s, none for @stdio]
    #[arg(long, value_name = "TIME", help_heading = HEADING)]
    #[serde(with = "super::text::option")]
    pub external_start_limit: Option<Time>,
    /// Time for the first batch and its first plan in a process [default: 300s, none for @stdio]
    #[arg(long, value_name = "TIME", help_heading = HEADING)]
    #[serde(with = "super::text::option")]
    pub external_first_limit: Option<Time>,
    /// Time for every later answer [default: 60s, none for @stdio]
    #[arg(long, value_name = "TIME", help_heading = HEADING)]
    #[serde(with = "super::text::option")]
    pub external_limit: Option<Time>,
    /// Pass ids of scenarios and agents and world coordinates to external simulators, which every
    /// table marks with §, and to external planners
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true",
          hide_possible_values = true, help_heading = HEADING)]
    pub reveal_ids: Option<bool>,
}

impl Default for ExternalSpec {
    fn default() -> Self {
        Self {
            external: Vec::new(),
            planner: Vec::new(),
            external_workers: 1,
            external_batch: None,
            external_start_limit: None,
            external_first_limit: None,
            external_limit: None,
            reveal_ids: None,
        }
    }
}

/// The running external simulators and planners of a specification.
#[derive(Default)]
pub struct ExternalPrograms {
    /// Simulators.
    pub simulators: Vec<ExternalSimulator>,
    /// Planners.
    pub planners: Vec<ExternalPlanner>,
}

impl ExternalPrograms {
    /// Returns the processes of all programs.
    pub fn processes(&self) -> impl Iterator<Item = &Processes> {
        let simulators = self.simulators.iter().map(ExternalSimulator::processes);
        simulators.chain(self.planners.iter().map(ExternalPlanner::processes))
    }

    /// Creates the simulators that a specification names, with its stage behind each.
    ///
    /// # Errors
    /// [`EvaluationError`] if a baseline has the name of one.
    pub fn planned(&self, spec: &RunSpec) -> Result<Vec<PlannedSimulator>, EvaluationError> {
        let texts = &spec.subject.external.external;
        let is_named =
            |name: &str| texts.iter().filter_map(|t| t.split_once('=')).any(|(own, _)| own == name);
        let named = self.simulators.iter().filter(|simulator| is_named(simulator.processes().name()));
        named.map(|simulator| PlannedSimulator::external(simulator.clone(), spec.rollout.smooth.0)).collect()
    }
}

impl ExternalSpec {
    /// Starts the simulators and planners.
    ///
    /// # Errors
    /// [`EvaluationError`] if a text is not of the form `NAME=COMMAND`, a name is given twice, or a program cannot
    /// be started.
    pub fn start(&self, outline: &RunOutline) -> Result<ExternalPrograms, EvaluationError> {
        let mut programs = ExternalPrograms::default();
        let mut parent: Option<Parent> = None;
        let simulators = self.external.iter().map(|text| ("external", text));
        for (key, text) in simulators.chain(self.planner.iter().map(|text| ("planner", text))) {
            let refuse = |expected| EvaluationError::spec(key, text, expected);
            let (name, command) =
                text.split_once('=').ok_or_else(|| refuse("NAME=COMMAND, such as mine='python mine.py'"))?;
            let command = match command.trim() {
                STDIO => Command::Parent(match &parent {
                    Some(parent) => parent.clone(),
                    None => parent.insert(Parent::stdio()).clone(),
                }),
                line => Command::Shell(line.to_owned()),
            };
            if programs.processes().any(|processes| processes.name() == name) {
                return Err(refuse("every name once"));
            }
            let settings = ExternalSettings {
                // The parent process is one thread.
                workers: if command.is_parent() { 1 } else { self.external_workers },
                batch: self.external_batch,
                limits: self.limits(&command),
                reveal_ids: self.reveal_ids == Some(true),
                ..ExternalSettings::new(name, command)
            };
            match key {
                "planner" => programs.planners.push(ExternalPlanner::start(settings, outline.clone())?),
                _ => programs.simulators.push(ExternalSimulator::start(settings, outline.clone())?),
            }
        }
        Ok(programs)
    }

    fn limits(&self, command: &Command) -> TimeLimits {
        let default = TimeLimits::of(command);
        let or = |time: Option<Time>, default| time.map_or(default, |Time(time)| time);
        TimeLimits {
            start: or(self.external_start_limit, default.start),
            first: or(self.external_first_limit, default.first),
            plan: or(self.external_limit, default.plan),
        }
    }
}
