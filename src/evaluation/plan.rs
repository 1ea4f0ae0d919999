//! What a run is asked to do, checked before the first scenario.

use std::collections::BTreeMap;
use std::path::Path;

use super::EvaluationError;
use super::av::AvChoice;
use super::benchmarks::BenchmarkRecord;
use super::file_record::FileRecord;
use super::provenance::{Provenance, SettingsRecord, SimulatorRecord, program_commit, program_version};
use super::simulators::PlannedSimulator;
use super::source::Source;
use super::tally::Tally;
use crate::formats::deviations::{self, DeviationRecord};
use crate::metrics::Options;
use crate::rollout::{AvError, AvPolicy, DeviatedAv, LogAv, Protocol, ScriptedAv, Settings};
use crate::scene::{AgentState, Certificate, DeviatedTrack, Deviation, Difficulty, Scenario};

/// What decides the numbers of a run, besides scenarios and simulators.
#[derive(Clone, Debug, PartialEq)]
pub struct RunSettings {
    /// Protocol, replan rate, lookahead, seed.
    pub rollout: Settings,
    /// Who moves the AV in the reactive protocol.
    pub av: AvChoice,
    /// Rollouts per scenario and simulator, at least 1.
    pub rollouts: u32,
    /// Variants of the metrics.
    pub options: Options,
    /// How many scenarios the sources were opened to give at most, each; for the record.
    pub limit: Option<usize>,
}

/// Deviated AVs by scenario id, with the file that they came from.
pub struct Deviations {
    /// The file.
    pub file: FileRecord,
    /// By scenario id.
    pub tracks: BTreeMap<String, DeviationRecord>,
}

impl Deviations {
    /// Reads a file of deviations, Parquet or JSON.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read or is invalid.
    pub fn read(path: &Path) -> Result<Self, EvaluationError> {
        let tracks = deviations::read(path)?;
        Ok(Self { file: FileRecord::of(path, "deviations")?, tracks })
    }
}

/// A run: sources × simulators × rollouts.
pub struct Plan {
    /// Where scenarios come from.
    pub sources: Vec<Source>,
    /// Simulators in the order of the tables.
    pub simulators: Vec<PlannedSimulator>,
    /// Deviated AVs from a file. Where there is one, those that scenarios carry do not count: a set is not mixed with another.
    /// In the realism protocol, which has no deviated AVs, it says which scenarios are wanted.
    pub deviations: Option<Deviations>,
    /// Settings.
    pub settings: RunSettings,
    /// Whether the run folder keeps the rollouts.
    pub keep_rollouts: bool,
}

/// What is known of a deviated AV besides its trajectory; nothing of an AV that is no deviated one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KnownDeviation {
    /// Dominant source of the deviation.
    pub category: Option<Deviation>,
    /// How every agent that it disturbs can avoid it.
    pub certificate: Option<Certificate>,
}

impl KnownDeviation {
    /// What is known of a deviated trajectory. A certificate without efforts is left out: files of that age do not say which responses
    /// answer the AV and which answer each other, without which nobody's reaction can be judged.
    pub fn of(deviated: &DeviatedTrack) -> Self {
        let certificate = deviated.certificate.clone().filter(|c| c.difficulty().is_some());
        Self { category: deviated.category, certificate }
    }

    /// How difficult it is for the agents to avoid the AV, where known.
    pub fn difficulty(&self) -> Option<Difficulty> {
        self.certificate.as_ref()?.difficulty()
    }
}

/// Why a scenario has no AV.
#[derive(Debug, thiserror::Error)]
pub enum NoAv {
    /// The scenario carries no deviated trajectory.
    #[error("no deviated AV; give --deviations with one for this scenario, or choose another --av")]
    Missing,
    /// The trajectory was made for something else.
    #[error("the deviated AV was made for a scenario with the digest {wanted}, this one has {found}")]
    OtherScenario {
        /// Digest that the trajectory names.
        wanted: String,
        /// Digest of the scenario.
        found: String,
    },
    /// The trajectory is refused.
    #[error(transparent)]
    Refused(#[from] AvError),
}

impl Plan {
    /// Where the numbers will come from.
    pub fn provenance(&self) -> Provenance {
        let Settings { protocol, replan, av_lookahead, seed } = self.settings.rollout;
        let provenance = Provenance {
            version: program_version().to_owned(),
            commit: program_commit().to_owned(),
            settings: SettingsRecord {
                protocol: protocol.name().to_owned(),
                av: match protocol {
                    Protocol::Reactive => self.settings.av.to_string(),
                    Protocol::Realism => "simulator".to_owned(),
                },
                replan_steps: replan.steps(),
                av_lookahead,
                seed,
                rollouts: self.settings.rollouts,
                limit: self.settings.limit,
            },
            metric_options: {
                let named = self.settings.options.named();
                named.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
            },
            simulators: self
                .simulators
                .iter()
                .map(|s| SimulatorRecord {
                    id: s.id.clone(),
                    title: s.title.clone(),
                    oracle: s.controller.is_oracle(),
                    card: blake3::hash(s.card.as_bytes()).to_hex().to_string(),
                    parameters: s.parameters.clone(),
                    weights: s.weights.clone(),
                })
                .collect(),
            inputs: self.sources.iter().map(|s| s.file.clone()).collect(),
            deviations: self.deviations.as_ref().map(|d| d.file.clone()),
            benchmark: match (self.sources.as_slice(), &self.deviations, self.settings.limit) {
                ([source], None, None) => BenchmarkRecord::of(&source.file),
                _ => None,
            },
            backend: None,
            cpu: None,
            keep_rollouts: Some(self.keep_rollouts),
        };
        provenance.with_machine()
    }

    /// What its values are collected in, still empty.
    pub fn tally(&self) -> Tally {
        Tally::new(self.simulators.iter().map(|s| s.id.clone()).collect(), self.settings.rollouts)
    }

    /// Whether a scenario that has no AV for this reason is left out rather than failed: a file of deviations says which scenarios are
    /// wanted.
    pub(super) fn passes_over(&self, reason: &NoAv) -> bool {
        matches!(reason, NoAv::Missing) && self.deviations.is_some()
    }

    /// The deviated trajectory of a scenario in its frame, where there is one.
    fn deviated(&self, scenario: &Scenario) -> Result<DeviatedTrack, NoAv> {
        if let Some(deviations) = &self.deviations {
            let record = deviations.tracks.get(&scenario.id).ok_or(NoAv::Missing)?;
            if let Some(wanted) = &record.scenario_digest {
                let found = scenario.digest();
                if found != *wanted {
                    return Err(NoAv::OtherScenario { wanted: wanted.clone(), found });
                }
            }
            return Ok(DeviatedTrack {
                category: record.category,
                track: record.track_in(scenario.origin),
                certificate: record.certificate_in(scenario.origin),
            });
        }
        scenario.deviation.clone().ok_or(NoAv::Missing)
    }

    /// The AV of a scenario and what is known of its deviation from the log.
    ///
    /// # Errors
    /// [`NoAv`] where the scenario has none, or one that no AV can drive.
    pub fn av(&self, scenario: &Scenario) -> Result<(Box<dyn AvPolicy>, KnownDeviation), NoAv> {
        if self.settings.rollout.protocol == Protocol::Realism {
            if self.deviations.is_some() {
                self.deviated(scenario)?;
            }
            return Ok((Box::new(MovedBySimulator), KnownDeviation::default()));
        }
        Ok(match &self.settings.av {
            AvChoice::Deviated | AvChoice::File(_) => {
                let deviated = self.deviated(scenario)?;
                let known = KnownDeviation::of(&deviated);
                (Box::new(DeviatedAv::new(&scenario.start.now(0), deviated.track)?), known)
            }
            AvChoice::Log => (Box::new(LogAv::new(scenario)?), KnownDeviation::default()),
            AvChoice::Scripted(script) => {
                (Box::new(ScriptedAv::new(scenario, *script)?), KnownDeviation::default())
            }
        })
    }
}

/// Stands where the simulator moves the AV; the engine asks no policy then.
struct MovedBySimulator;

impl AvPolicy for MovedBySimulator {
    fn next(&mut self, seen: &crate::rollout::Observation<'_>) -> Result<AgentState, AvError> {
        Err(AvError::Absent { step: seen.step() + 1 })
    }
}
