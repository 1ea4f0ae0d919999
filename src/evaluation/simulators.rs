//! The simulators of a run: which ones, with which parameters and weights.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use super::EvaluationError;
use super::provenance::WeightsRecord;
use crate::models::qp::{self, Smoothing};
use crate::models::{self, Baseline, Card, MODELS, ModelError, WeightsFile};
use crate::rollout::Controller;

/// A simulator that is ready to run.
pub struct PlannedSimulator {
    /// Id: that of the baseline and, where there is one, of the stage behind it.
    pub id: String,
    /// Name in tables.
    pub title: String,
    /// Text of its card, and of that of the stage behind it.
    pub card: String,
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
    /// A stage to be put behind every simulator that is not an oracle.
    pub smoothing: Option<Smoothing>,
}

/// A baseline, and what is put behind it.
struct Chosen {
    id: String,
    baseline: &'static Baseline,
    smoothing: Option<Smoothing>,
}

impl Chosen {
    /// Whether it is what an id names, without or with what is put behind it.
    fn is_named(&self, id: &str) -> bool {
        self.id == id || self.baseline.id == id
    }
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
        let all = chosen(ids, asked)?;
        let runs = |id: &str| match all.iter().find(|c| c.is_named(id)) {
            Some(_) => Ok(()),
            None => {
                named(id)?;
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
        let make = |chosen: Chosen| {
            // What is asked of a simulator is asked of it with a stage behind it too, unless that is asked otherwise.
            let ids = [chosen.baseline.id, chosen.id.as_str()];
            let path = ids.iter().rev().find_map(|id| given.get(id)).copied();
            let mut asked: BTreeMap<&str, &str> = BTreeMap::new();
            for id in ids {
                let own = changes.iter().filter(|((of, _), _)| *of == id);
                asked.extend(own.map(|((_, key), value)| (*key, *value)));
            }
            Self::make(&chosen, path, asked.into_iter())
        };
        all.into_iter().map(make).collect()
    }

    fn make<'a>(
        chosen: &Chosen,
        weights: Option<&PathBuf>,
        changes: impl Iterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, EvaluationError> {
        let baseline = chosen.baseline;
        let id = baseline.id;
        if chosen.smoothing.is_some() && !baseline.takes_stage {
            return Err(ModelError::TakesNoStage { id }.into());
        }
        let mut setup = baseline.setup()?;
        let mut parameters = BTreeMap::new();
        for (key, value) in changes {
            parameters.insert(key.to_owned(), setup.set(key, value)?);
        }
        if let Some(path) = weights {
            let name = path.file_name().map_or_else(|| path.to_string_lossy(), |n| n.to_string_lossy());
            if !baseline.needs_weights {
                return Err(ModelError::UnexpectedWeights { id, file: name.into_owned() }.into());
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
        let mut title = Card::read(id, baseline.card).map_err(ModelError::from)?.title;
        let mut controller = (baseline.make)(setup)?;
        let mut card = baseline.card.to_owned();
        if let Some(smoothing) = chosen.smoothing {
            title = format!("{title} + {}", smoothing.name());
            controller = smoothing.behind(id, controller)?;
            card.push_str(qp::CARD);
        }
        Ok(Self { id: chosen.id.clone(), title, card, parameters, weights, controller })
    }
}

/// What is to run.
fn chosen(ids: &[String], asked: &Adjustments) -> Result<Vec<Chosen>, EvaluationError> {
    let mut all: Vec<Chosen> = Vec::new();
    if ids.is_empty() {
        let given = |b: &Baseline| asked.weights.iter().any(|(id, _)| id == b.id);
        let complete = MODELS.iter().filter(|b| b.is_complete() || given(b));
        all.extend(complete.map(|baseline| Chosen { id: baseline.id.to_owned(), baseline, smoothing: None }));
    }
    for id in ids {
        all.push(named(id)?);
    }
    if let Some(smoothing) = asked.smoothing {
        for chosen in all.iter_mut().filter(|c| c.smoothing.is_none() && c.baseline.takes_stage) {
            chosen.id = smoothing.id(chosen.baseline.id);
            chosen.smoothing = Some(smoothing);
        }
    }
    for (i, chosen) in all.iter().enumerate() {
        if all[..i].iter().any(|earlier| earlier.id == chosen.id) {
            return Err(EvaluationError::RepeatedSimulator { id: chosen.id.clone() });
        }
    }
    Ok(all)
}

/// The baseline that an id names, with the stage behind it.
fn named(id: &str) -> Result<Chosen, EvaluationError> {
    let (base, smoothing) = match Smoothing::of_id(id) {
        Some((base, smoothing)) => (base, Some(smoothing)),
        None => (id, None),
    };
    let baseline = models::find(base).ok_or_else(|| EvaluationError::UnknownSimulator {
        id: id.to_owned(),
        known: MODELS.iter().map(|m| m.id).collect::<Vec<_>>().join(", "),
    })?;
    Ok(Chosen { id: id.to_owned(), baseline, smoothing })
}
