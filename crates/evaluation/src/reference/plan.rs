//! The plan that repeats the run of a reference.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::num::NonZeroUsize;

use reactsim_baseline::{WeightsFile, weights};
use reactsim_metrics::Metrics;
use reactsim_rollout::{Entering, Protocol, Replan};

use super::{Reference, ReferenceError};
use crate::error::EvaluationError;
use crate::plan::of_spec::with_driver;
use crate::plan::{Deviations, Plan};
use crate::provenance::leaves::differences;
use crate::provenance::{Provenance, program_version};
use crate::simulators::{Adjustments, PlannedSimulator};
use crate::source::Source;
use crate::source::benchmarks::BenchmarkRecord;
use crate::source::file_record::FileRecord;
use crate::spec::{RolloutSpec, RunSpec, SubjectSpec};

/// The inputs for repeating the run of a reference.
pub struct RerunInputs {
    /// Scenario files in the order of the provenance, opened with its limit.
    pub sources: Vec<Source>,
    /// The file of deviated AVs, if the run had one.
    pub deviations: Option<Deviations>,
    /// Weights that do not ship, by id.
    pub weights: Vec<(String, WeightsFile)>,
}

impl Reference {
    /// Plans the run of this reference again.
    ///
    /// # Errors
    /// [`ReferenceError`] names the first difference between the reference and this program or the inputs:
    /// version, inputs, deviations, simulators with their parameters and weights, settings.
    pub fn plan(&self, inputs: RerunInputs) -> Result<Plan, ReferenceError> {
        let stated = &self.provenance;
        if stated.version != program_version() {
            return Err(self.other("version", &stated.version, program_version(), USE_VERSION));
        }
        self.check_inputs(&inputs)?;
        let ids: Vec<String> = stated.simulators.iter().map(|s| s.id.clone()).collect();
        let parts = stated.simulators.iter().flat_map(|simulator| simulator.parts());
        let parameters = parts.flat_map(|simulator| {
            let id = &simulator.id;
            simulator.parameters.iter().map(move |(key, value)| (id.clone(), key.clone(), value.clone()))
        });
        // A simulator may also be a member of a mix.
        let parameters: BTreeSet<_> = parameters.collect();
        let adjustments = Adjustments {
            weights: self.weights(inputs.weights)?,
            parameters: parameters.into_iter().collect(),
            smoothing: None,
            backend: stated.backend.as_deref().and_then(|name| name.parse().ok()).unwrap_or_default(),
        };
        let spec = self.spec()?;
        let plan = Plan {
            drivers: with_driver(spec.subject.av.as_ref(), Vec::new())?,
            sources: inputs.sources,
            simulators: PlannedSimulator::adjusted(&ids, &adjustments)?,
            deviations: inputs.deviations,
            metrics: Metrics::default(),
            options: spec.subject.options().map_err(|error| self.unfit(&error))?,
            selection: self.provenance.settings.selection.clone(),
            spec,
            partition: None,
        };
        let (stated, found) = (comparable(stated, stated), comparable(&plan.provenance(), stated));
        match differences(&stated, &found).into_iter().next() {
            Some((field, stated, found)) => Err(self.other(field, stated, found, REMAKE)),
            None => Ok(plan),
        }
    }

    /// Returns the given weights and those that ship with the program, under whichever id, for the simulators
    /// that had them.
    fn weights(
        &self,
        mut given: Vec<(String, WeightsFile)>,
    ) -> Result<Vec<(String, WeightsFile)>, ReferenceError> {
        for simulator in self.provenance.simulators.iter().flat_map(|simulator| simulator.parts()) {
            let Some(stated) = &simulator.weights else { continue };
            if given.iter().any(|(id, _)| *id == simulator.id) {
                continue;
            }
            let shipped = weights::shipped_with_digest(&stated.sha256).map_err(EvaluationError::from)?;
            given.extend(shipped.map(|file| (simulator.id.clone(), file)));
        }
        Ok(given)
    }

    /// Returns what the settings in the provenance specify.
    fn spec(&self) -> Result<RunSpec, ReferenceError> {
        let stated = &self.provenance.settings;
        let unknown = |field: &str, value: &dyn Display| {
            self.unfit(&format!("`settings.{field}` is {value}, which this program does not know"))
        };
        let protocol =
            [Protocol::Reactive, Protocol::Realism].into_iter().find(|p| p.name() == stated.protocol);
        let protocol = protocol.ok_or_else(|| unknown("protocol", &stated.protocol))?;
        let av = match protocol {
            Protocol::Realism => None,
            Protocol::Reactive => Some(stated.av.parse().map_err(|_| unknown("av", &stated.av))?),
        };
        let replan = Replan::every(stated.replan_steps);
        let replan = replan.ok_or_else(|| unknown("replan_steps", &stated.replan_steps))?;
        let entering = stated.entering.as_deref().map_or(Ok(Entering::Off), str::parse);
        let entering =
            entering.map_err(|_| unknown("entering", &stated.entering.as_deref().unwrap_or_default()))?;
        let (av_lookahead, rollouts) = (u8::from(stated.av_lookahead), stated.rollouts);
        let options = self.provenance.metric_options.iter();
        let metric_option = options.map(|(name, value)| format!("{name}={value}")).collect();
        let mut subject = SubjectSpec { av, seed: stated.seed, metric_option, ..SubjectSpec::default() };
        subject.input.limit = stated.limit.and_then(NonZeroUsize::new);
        let rollout = RolloutSpec {
            protocol,
            replan,
            av_lookahead,
            rollouts,
            entering: Some(entering),
            ..RolloutSpec::default()
        };
        Ok(RunSpec { subject, rollout, keep_rollouts: None })
    }

    /// Returns the error of a provenance that this program cannot repeat.
    fn unfit(&self, reason: &dyn Display) -> ReferenceError {
        ReferenceError::unfit(&self.place, format!("provenance.json: {reason}"))
    }

    /// Checks that inputs and deviations are those of the reference. Names of files may differ.
    fn check_inputs(&self, inputs: &RerunInputs) -> Result<(), ReferenceError> {
        let stated = &self.provenance;
        let own: Vec<&FileRecord> = inputs.sources.iter().map(|s| &s.file).collect();
        if let ([file], Some(benchmark), None) = (own.as_slice(), &stated.benchmark, &inputs.deviations)
            && file.blake3 != benchmark.blake3
        {
            let found = BenchmarkRecord::of(file).map_or_else(
                || format!("{} ({:.12})", file.name, file.blake3),
                |b| format!("{b} ({:.12})", b.blake3),
            );
            let stated = format!("{benchmark} ({:.12})", benchmark.blake3);
            return Err(self.other("benchmark", stated, found, GIVE_SCENARIOS));
        }
        if own.len() != stated.inputs.len() {
            return Err(self.other("number of inputs", stated.inputs.len(), own.len(), GIVE_SCENARIOS));
        }
        let deviations = (stated.deviations.iter(), inputs.deviations.iter().map(|d| &d.file));
        if let (Some(file), None) = (&stated.deviations, &inputs.deviations) {
            return Err(self.other("deviations", &file.name, "absent", GIVE_DEVIATIONS));
        }
        if let (None, Some(given)) = (&stated.deviations, &inputs.deviations) {
            return Err(self.other("deviations", "absent", &given.file.name, ""));
        }
        let all = stated.inputs.iter().zip(own).chain(deviations.0.zip(deviations.1));
        for (stated, found) in all {
            if !stated.is_same(found) {
                let field = format!("digest of {}", stated.name);
                return Err(self.other(field, stated.digest(), found.digest(), GIVE_SCENARIOS));
            }
        }
        Ok(())
    }

    /// Returns the error of a field with another value here; `hint` is a remedy, or empty.
    fn other(
        &self,
        field: impl Display,
        stated: impl Display,
        found: impl Display,
        hint: &str,
    ) -> ReferenceError {
        let reason = format!("`{field}` is {stated} in the reference and {found} here{hint}");
        ReferenceError::unfit(&self.place, reason)
    }
}

const USE_VERSION: &str = ": use the program of that version, or make the reference again";
const REMAKE: &str = ": a reference is valid only for the program that made it; make it again";
const GIVE_SCENARIOS: &str = ": give its scenarios";
const GIVE_DEVIATIONS: &str = ": give the file of deviations";

/// Returns a provenance without the fields that may differ between a reference and a compared run: commit,
/// machine, names of files. `of` is the provenance of the reference, whose files have been checked to be the
/// same.
fn comparable(provenance: &Provenance, of: &Provenance) -> Provenance {
    Provenance {
        commit: String::new(),
        backend: None,
        cpu: None,
        keep_rollouts: None,
        inputs: of.inputs.clone(),
        deviations: of.deviations.clone(),
        ..provenance.clone()
    }
}
