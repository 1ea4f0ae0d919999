//! Which parts can be taken from simulators, or put to them.

use std::collections::BTreeMap;

use super::Member;
use crate::evaluation::{Adjustments, EvaluationError, PlannedSimulator};
use crate::models::qp::Smoothing;
use crate::models::{self, Card, ModelError};

/// The name of what is not changed.
const AS_IS: &str = "as-is";

/// A part that the cards of some simulators switch on or off.
struct Switch {
    /// Its parameter on the cards.
    key: &'static str,
    /// Its name in names of variants.
    name: &'static str,
    /// Its name for people.
    title: &'static str,
}

const SWITCHES: [Switch; 2] = [
    Switch { key: "projection", name: "projection", title: "projection" },
    Switch { key: "keep_clear", name: "keep-clear", title: "keeping clear" },
];

/// A change of simulators, and those that it changes.
pub(super) struct Variant {
    /// Such as `without-projection`.
    name: String,
    /// The same for people.
    label: String,
    /// Id of each simulator, and its id as it is.
    originals: BTreeMap<String, String>,
    /// The simulators.
    pub(super) made: Vec<PlannedSimulator>,
}

impl Variant {
    /// No change; the simulators are made already, and are not in it.
    pub(super) fn as_is(simulators: &[PlannedSimulator]) -> Self {
        let originals = simulators.iter().map(|s| (s.id.clone(), s.id.clone())).collect();
        Self { name: AS_IS.to_owned(), label: "as it is".to_owned(), originals, made: Vec::new() }
    }

    /// The run of these simulators.
    pub(super) fn member(&self, av_lookahead: bool) -> Member {
        let (folder, label) = match (av_lookahead, self.name.as_str()) {
            (true, name) => (name.to_owned(), self.label.clone()),
            (false, AS_IS) => ("lookahead-0".to_owned(), "look-ahead 0".to_owned()),
            (false, name) => (format!("{name}-lookahead-0"), format!("{}, look-ahead 0", self.label)),
        };
        Member {
            folder,
            label,
            variant: Some(self.name.clone()),
            av_lookahead: Some(av_lookahead),
            originals: self.originals.clone(),
            ..Member::default()
        }
    }
}

/// A simulator with one part more or less.
struct Changed<'a> {
    from: &'a PlannedSimulator,
    id: String,
    parameter: Option<(&'static str, bool)>,
}

/// Every change that there is for some simulator, with the simulators that it changes: what they have is taken away, what they lack is put
/// to them.
pub(super) fn variants(
    simulators: &[PlannedSimulator],
    asked: &Adjustments,
) -> Result<Vec<Variant>, EvaluationError> {
    let mut variants = Vec::new();
    for Switch { key, name, title } in SWITCHES {
        for on in [true, false] {
            let mut changed = Vec::new();
            for from in simulators {
                if switch(from, key)? == Some(on) {
                    changed.push(Changed { from, id: from.id.clone(), parameter: Some((key, !on)) });
                }
            }
            let with = if on { "without" } else { "with" };
            variants.extend(variant(&format!("{with}-{name}"), &format!("{with} {title}"), changed, asked)?);
        }
    }
    let with = Smoothing::Full;
    let takes = |s: &&PlannedSimulator| models::find(&s.id).is_some_and(|b| b.takes_stage);
    let changed = simulators.iter().filter(takes);
    let changed = changed.map(|from| Changed { from, id: with.id(&from.id), parameter: None }).collect();
    variants.extend(variant(
        &format!("with-{}", with.name()),
        &format!("with {}", title(with)),
        changed,
        asked,
    )?);
    for stage in Smoothing::ALL {
        let with_it = simulators.iter().filter_map(|from| match Smoothing::of_id(&from.id) {
            Some((id, own)) if own == stage => Some(Changed { from, id: id.to_owned(), parameter: None }),
            _ => None,
        });
        let (name, label) = (format!("without-{}", stage.name()), format!("without {}", title(stage)));
        variants.extend(variant(&name, &label, with_it.collect(), asked)?);
    }
    Ok(variants)
}

/// The name of a stage for people.
fn title(stage: Smoothing) -> &'static str {
    match stage {
        Smoothing::Full => "QP",
        Smoothing::WithoutOthers => "QP alone",
    }
}

/// The id of the baseline of a simulator.
fn baseline(simulator: &PlannedSimulator) -> &str {
    Smoothing::of_id(&simulator.id).map_or(simulator.id.as_str(), |(id, _)| id)
}

/// How a switch of a simulator stands; `None` where it has none.
fn switch(simulator: &PlannedSimulator, key: &str) -> Result<Option<bool>, EvaluationError> {
    let Some(baseline) = models::find(baseline(simulator)) else { return Ok(None) };
    let card = Card::read(baseline.id, baseline.card).map_err(ModelError::from)?;
    let Some(on) = card.parameters.get(key).and_then(toml::Value::as_bool) else { return Ok(None) };
    Ok(Some(simulator.parameters.get(key).map_or(on, |value| value == "true")))
}

/// Makes the simulators of a variant; `None` where it changes none.
fn variant(
    name: &str,
    label: &str,
    changed: Vec<Changed<'_>>,
    asked: &Adjustments,
) -> Result<Option<Variant>, EvaluationError> {
    if changed.is_empty() {
        return Ok(None);
    }
    let mut own = Adjustments::default();
    for Changed { from, id, parameter } in &changed {
        // Weights and parameters are those of the simulator as it is, but for the part.
        let given = |of: &str| asked.weights.iter().find(|(to, _)| to == of);
        if let Some((_, path)) = given(&from.id).or_else(|| given(baseline(from))) {
            own.weights.push((id.clone(), path.clone()));
        }
        let kept = from.parameters.iter().filter(|(key, _)| parameter.is_none_or(|(part, _)| *key != part));
        own.parameters.extend(kept.map(|(key, value)| (id.clone(), key.clone(), value.clone())));
        own.parameters.extend(parameter.map(|(key, on)| (id.clone(), key.to_owned(), on.to_string())));
    }
    let ids: Vec<String> = changed.iter().map(|c| c.id.clone()).collect();
    let originals = changed.iter().map(|c| (c.id.clone(), c.from.id.clone())).collect();
    let made = PlannedSimulator::adjusted(&ids, &own)?;
    Ok(Some(Variant { name: name.to_owned(), label: label.to_owned(), originals, made }))
}
