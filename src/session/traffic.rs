//! The simulator that moves the agents of an environment.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::wire::{RequestError, refused};
use crate::evaluation::{Adjustments, PlannedSimulator, Time, weights_file};
use crate::external::{Command, ExternalSettings, ExternalSimulator, Parent, RunOutline, STDIO, TimeLimits};
use crate::rollout::{Controller, Entering, PlanError, Protocol, RolloutError, Settings};

/// Largest number of processes of a command.
const MOST_COMMANDS: usize = 256;

/// A simulator, and how it is rolled out.
pub struct Traffic {
    /// Id of the simulator, for messages and the rows of finished episodes.
    pub id: String,
    /// The simulator.
    pub controller: Controller,
    /// Protocol (reactive), replan interval, lookahead and seed.
    pub settings: Settings,
}

/// Returns why a rollout failed, with the name of the simulator if it has not planned.
pub(super) fn reason(simulator: &str, error: &RolloutError) -> String {
    match error {
        RolloutError::Plan { .. } => format!("simulator `{simulator}`: {error}"),
        error => error.to_string(),
    }
}

/// Returns whether a simulator failed as a program, and did not only find no plan for an episode.
pub(super) fn is_broken_off(error: &RolloutError) -> bool {
    matches!(error, RolloutError::Plan { source: PlanError::BrokenOff(_), .. })
}

/// A simulator of a request.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NamedTraffic {
    /// Id of a baseline or a mix, or NAME=COMMAND of an external simulator.
    simulator: String,
    /// Number of batches that an external simulator has open at the same time.
    batches: usize,
    /// Time for every answer of an external simulator.
    external_limit: Option<String>,
    /// Files of weights, by id.
    weights: BTreeMap<String, String>,
    /// Parameters by id and dotted path, in TOML notation.
    parameters: BTreeMap<String, String>,
    replan: String,
    av_lookahead: bool,
    seed: u64,
}

impl NamedTraffic {
    /// Creates the simulator, or starts its processes. `parent` has the simulators with the command `@stdio`.
    ///
    /// # Errors
    /// If there is no such simulator, it does not start, or a parameter does not fit.
    pub(super) fn start(&self, parent: &Parent) -> Result<Traffic, RequestError> {
        let settings = Settings {
            protocol: Protocol::Reactive,
            replan: self.replan.parse().map_err(RequestError::new)?,
            av_lookahead: self.av_lookahead,
            entering: Entering::Off,
            seed: self.seed,
        };
        // The ids of mixes have `=` as well.
        let external = self.simulator.split_once('=').filter(|(name, _)| !name.contains(':'));
        let planned = match external {
            Some((name, command)) => self.external(name, command.trim(), parent, &settings)?,
            None => self.baseline()?,
        };
        Ok(Traffic { id: planned.id, controller: planned.controller, settings })
    }

    fn external(
        &self,
        name: &str,
        command: &str,
        parent: &Parent,
        settings: &Settings,
    ) -> Result<PlannedSimulator, RequestError> {
        if !self.weights.is_empty() || !self.parameters.is_empty() {
            return refused(format_args!(
                "`{name}` is no baseline: it has no `weights` or `parameters` here"
            ));
        }
        if command != STDIO && self.batches > MOST_COMMANDS {
            return refused(format_args!(
                "`num_envs` is {}: at most {MOST_COMMANDS} are possible with the command of `{name}`",
                self.batches
            ));
        }
        let command = match command {
            STDIO => Command::Parent(parent.clone()),
            line => Command::Shell(line.to_owned()),
        };
        let mut limits = TimeLimits::of(&command);
        if let Some(limit) = &self.external_limit {
            let Time(limit) = limit.parse().map_err(RequestError::new)?;
            limits = TimeLimits { start: limit, first: limit, plan: limit };
        }
        let external =
            ExternalSettings { workers: self.batches, limits, ..ExternalSettings::new(name, command) };
        let simulator = ExternalSimulator::start(
            external,
            RunOutline {
                intervals: vec![settings.replan.steps()],
                protocols: vec![settings.protocol.name()],
            },
        )?;
        Ok(PlannedSimulator::external(simulator, None)?)
    }

    fn baseline(&self) -> Result<PlannedSimulator, RequestError> {
        if self.external_limit.is_some() {
            return refused(format_args!(
                "`external_limit` is for commands: the baseline `{}` has none",
                self.simulator
            ));
        }
        let mut adjustments = Adjustments::default();
        for (id, path) in &self.weights {
            adjustments.weights.push((id.clone(), weights_file(Path::new(path))?));
        }
        for (path, value) in &self.parameters {
            let Some((id, key)) = path.split_once('.') else {
                return refused(format_args!(
                    "the parameter `{path}` has no simulator: write ID.KEY, such as idm.vehicle.headway"
                ));
            };
            adjustments.parameters.push((id.to_owned(), key.to_owned(), value.clone()));
        }
        let mut planned = PlannedSimulator::adjusted(std::slice::from_ref(&self.simulator), &adjustments)?;
        match (planned.pop(), planned.is_empty()) {
            (Some(one), true) => Ok(one),
            _ => refused(format_args!("`{}` names several simulators, expected one", self.simulator)),
        }
    }
}
