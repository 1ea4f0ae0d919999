//! The run of a reference, to be made again.

use std::path::PathBuf;

use super::{Reference, ReferenceError};
use crate::evaluation::provenance::differences;
use crate::evaluation::{
    Adjustments, AvChoice, BenchmarkRecord, Deviations, FileRecord, Plan, PlannedSimulator, Provenance,
    RunSettings, Source, program_version,
};
use crate::metrics::Options;
use crate::rollout::{Protocol, Replan, Settings};

/// What is at hand to make the run of a reference again.
pub struct Given {
    /// Scenario files in the order of the provenance, opened with its limit.
    pub sources: Vec<Source>,
    /// The file of deviated AVs, where the run had one.
    pub deviations: Option<Deviations>,
    /// Weights that do not ship: id and path.
    pub weights: Vec<(String, PathBuf)>,
}

impl Reference {
    /// Plans the run of this reference again.
    ///
    /// # Errors
    /// [`ReferenceError`] names the first thing in which this program, or what is given, is not that of the reference: version, inputs,
    /// deviations, simulators with their parameters and weights, settings.
    pub fn plan(&self, given: Given) -> Result<Plan, ReferenceError> {
        let stated = &self.provenance;
        if stated.version != program_version() {
            return Err(self.other("version", &stated.version, program_version(), VERSION));
        }
        self.check_inputs(&given)?;
        let ids: Vec<String> = stated.simulators.iter().map(|s| s.id.clone()).collect();
        let parameters = stated.simulators.iter().flat_map(|simulator| {
            let id = &simulator.id;
            simulator.parameters.iter().map(move |(key, value)| (id.clone(), key.clone(), value.clone()))
        });
        let asked = Adjustments { weights: given.weights, parameters: parameters.collect(), smoothing: None };
        let plan = Plan {
            sources: given.sources,
            simulators: PlannedSimulator::adjusted(&ids, &asked)?,
            deviations: given.deviations,
            settings: self.settings()?,
            keep_rollouts: false,
        };
        let (stated, found) = (comparable(stated, stated), comparable(&plan.provenance(), stated));
        match differences(&stated, &found).into_iter().next() {
            Some((field, stated, found)) => Err(self.other(field, stated, found, REMAKE)),
            None => Ok(plan),
        }
    }

    /// Settings as the provenance states them.
    fn settings(&self) -> Result<RunSettings, ReferenceError> {
        let stated = &self.provenance.settings;
        let unknown = |field: &str, value: &dyn std::fmt::Display| {
            let reason =
                format!("provenance.json: `settings.{field}` is {value}, which this program does not know");
            ReferenceError::Unfit { place: self.place.clone(), reason }
        };
        let protocol =
            [Protocol::Reactive, Protocol::Realism].into_iter().find(|p| p.name() == stated.protocol);
        let protocol = protocol.ok_or_else(|| unknown("protocol", &stated.protocol))?;
        let av = match protocol {
            Protocol::Realism => AvChoice::Log,
            Protocol::Reactive => stated.av.parse().map_err(|_| unknown("av", &stated.av))?,
        };
        let replan = Replan::every(stated.replan_steps);
        let replan = replan.ok_or_else(|| unknown("replan_steps", &stated.replan_steps))?;
        let mut options = Options::default();
        for (name, value) in &self.provenance.metric_options {
            options.set(name, value).map_err(|error| ReferenceError::Unfit {
                place: self.place.clone(),
                reason: format!("provenance.json: {error}"),
            })?;
        }
        let rollout = Settings { protocol, replan, av_lookahead: stated.av_lookahead, seed: stated.seed };
        Ok(RunSettings { rollout, av, rollouts: stated.rollouts, options, limit: stated.limit })
    }

    /// Refuses other inputs and deviations than those of the reference. Names of files do not count.
    fn check_inputs(&self, given: &Given) -> Result<(), ReferenceError> {
        let stated = &self.provenance;
        let own: Vec<&FileRecord> = given.sources.iter().map(|s| &s.file).collect();
        if let ([file], Some(benchmark), None) = (own.as_slice(), &stated.benchmark, &given.deviations)
            && file.blake3 != benchmark.blake3
        {
            let found = BenchmarkRecord::of(file).map_or_else(
                || format!("{} ({:.12})", file.name, file.blake3),
                |b| format!("{b} ({:.12})", b.blake3),
            );
            let stated = format!("{benchmark} ({:.12})", benchmark.blake3);
            return Err(self.other("benchmark", stated, found, GIVE));
        }
        if own.len() != stated.inputs.len() {
            return Err(self.other("number of inputs", stated.inputs.len(), own.len(), GIVE));
        }
        let deviations = (stated.deviations.iter(), given.deviations.iter().map(|d| &d.file));
        if let (Some(file), None) = (&stated.deviations, &given.deviations) {
            return Err(self.other("deviations", &file.name, "absent", GIVE_DEVIATIONS));
        }
        if let (None, Some(given)) = (&stated.deviations, &given.deviations) {
            return Err(self.other("deviations", "absent", &given.file.name, ""));
        }
        let all = stated.inputs.iter().zip(own).chain(deviations.0.zip(deviations.1));
        for (stated, found) in all {
            if stated.digest() != found.digest() {
                let field = format!("digest of {}", stated.name);
                return Err(self.other(field, stated.digest(), found.digest(), GIVE));
            }
        }
        Ok(())
    }

    pub(super) fn other(
        &self,
        field: impl Into<String>,
        stated: impl ToString,
        found: impl ToString,
        mend: &'static str,
    ) -> ReferenceError {
        let (stated, found) = (stated.to_string(), found.to_string());
        ReferenceError::OtherRun { place: self.place.clone(), field: field.into(), stated, found, mend }
    }
}

const VERSION: &str = ": use the program of that version, or make the reference again";
const REMAKE: &str = ": a reference holds for the program that it was made with; make it again";
const GIVE: &str = ": give its scenarios with --scenarios PATH";
const GIVE_DEVIATIONS: &str = ": give the file with --deviations FILE";

/// A provenance without what may differ between a reference and a run that is compared with it: commit, machine, names of files.
/// `of` is the provenance of the reference, whose files were found to be the same.
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
