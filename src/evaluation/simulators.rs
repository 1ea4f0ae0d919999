//! The simulators of a run: which ones, with which parameters and weights.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use super::EvaluationError;
use super::provenance::WeightsRecord;
use crate::models::{self, Baseline, Card, MODELS, ModelError, WeightsFile};
use crate::rollout::Controller;

/// A simulator that is ready to run.
pub struct PlannedSimulator {
    /// Id.
    pub id: &'static str,
    /// Name in tables.
    pub title: String,
    /// Text of its card.
    pub card: &'static str,
    /// Parameters that are not as in the card, by dotted path, as TOML writes them.
    pub parameters: BTreeMap<String, String>,
    /// Its weights, where it has some.
    pub weights: Option<WeightsRecord>,
    /// The simulator.
    pub controller: Controller,
}

/// What is asked of simulators beyond their cards and the weights that ship.
#[derive(Clone, Debug, Default)]
pub struct Adjustments {
    /// Files of weights: id and path.
    pub weights: Vec<(String, PathBuf)>,
    /// Parameters: id, dotted path, value as in TOML.
    pub parameters: Vec<(String, String, String)>,
}

impl PlannedSimulator {
    /// Makes simulators by their ids; where `ids` is empty, all baselines that have what they need.
    ///
    /// # Errors
    /// [`EvaluationError`] names an unknown or repeated id, a card that can not be read, or a baseline without weights.
    pub fn by_ids(ids: &[String]) -> Result<Vec<Self>, EvaluationError> {
        Self::adjusted(ids, &Adjustments::default())
    }

    /// As [`Self::by_ids`], with weights and parameters that were asked for. Baselines whose weights do not ship are among those that
    /// run where no ids are given if their weights are.
    ///
    /// # Errors
    /// Also names what is given twice, is for a simulator that does not run, can not be read, or does not fit.
    pub fn adjusted(ids: &[String], asked: &Adjustments) -> Result<Vec<Self>, EvaluationError> {
        let baselines = chosen(ids, asked)?;
        let runs = |id: &str| match baselines.iter().find(|b| b.id == id) {
            Some(_) => Ok(()),
            None => {
                find(id)?;
                Err(EvaluationError::NotRun { id: id.to_owned() })
            }
        };
        let mut given: BTreeMap<&str, &PathBuf> = BTreeMap::new();
        for (id, path) in &asked.weights {
            runs(id)?;
            if given.insert(id, path).is_some() {
                return Err(EvaluationError::WeightsTwice { id: id.clone() });
            }
        }
        let mut changes: BTreeMap<(&str, &str), &str> = BTreeMap::new();
        for (id, key, value) in &asked.parameters {
            runs(id)?;
            if changes.insert((id, key), value).is_some() {
                return Err(EvaluationError::ParameterTwice { id: id.clone(), key: key.clone() });
            }
        }
        let make = |baseline: &Baseline| {
            let path = given.get(baseline.id).copied();
            let changes = changes.iter().filter(|((id, _), _)| *id == baseline.id);
            Self::make(baseline, path, changes.map(|((_, key), value)| (*key, *value)))
        };
        baselines.into_iter().map(make).collect()
    }

    fn make<'a>(
        baseline: &Baseline,
        weights: Option<&PathBuf>,
        changes: impl Iterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, EvaluationError> {
        let id = baseline.id;
        let mut setup = baseline.setup()?;
        let mut parameters = BTreeMap::new();
        for (key, value) in changes {
            parameters.insert(key.to_owned(), setup.set(key, value)?);
        }
        if let Some(path) = weights {
            let name = path.file_name().map_or_else(|| path.to_string_lossy(), |n| n.to_string_lossy());
            if !baseline.needs_weights {
                return Err(ModelError::UnwantedWeights { id, file: name.into_owned() }.into());
            }
            let bytes =
                fs::read(path).map_err(|source| EvaluationError::Read { path: path.clone(), source })?;
            let file = WeightsFile::new(name, bytes);
            file.check(id)?;
            setup.weights = Some(file);
        }
        if baseline.needs_weights {
            setup.weights()?;
        }
        let weights = setup.weights.as_ref().map(WeightsRecord::of);
        let title = Card::read(id, baseline.card).map_err(ModelError::from)?.title;
        let controller = (baseline.make)(setup)?;
        Ok(Self { id, title, card: baseline.card, parameters, weights, controller })
    }
}

/// The baselines that are to run.
fn chosen(ids: &[String], asked: &Adjustments) -> Result<Vec<&'static Baseline>, EvaluationError> {
    if ids.is_empty() {
        let given = |b: &Baseline| asked.weights.iter().any(|(id, _)| id == b.id);
        return Ok(MODELS.iter().filter(|b| b.is_complete() || given(b)).collect());
    }
    let mut baselines: Vec<&'static Baseline> = Vec::new();
    for id in ids {
        let found = find(id)?;
        if baselines.iter().any(|b| b.id == found.id) {
            return Err(EvaluationError::RepeatedSimulator { id: id.clone() });
        }
        baselines.push(found);
    }
    Ok(baselines)
}

fn find(id: &str) -> Result<&'static Baseline, EvaluationError> {
    models::find(id).ok_or_else(|| EvaluationError::UnknownSimulator {
        id: id.to_owned(),
        known: MODELS.iter().map(|m| m.id).collect::<Vec<_>>().join(", "),
    })
}
