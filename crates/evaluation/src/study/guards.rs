//! Variants of simulators with one component added or removed.

use std::collections::BTreeMap;

use reactsim_baseline::Card;
use reactsim_models as models;
use reactsim_qp::Smoothing;

use super::Member;
use crate::error::EvaluationError;
use crate::simulators::PlannedSimulator;
use crate::simulators::id::SimulatorId;
use crate::spec::{RunSpec, Stage};

/// Name of the unchanged variant.
const AS_IS: &str = "as-is";

/// A component that the cards of some simulators switch on or off.
struct Switch {
    /// Parameter in the cards.
    key: &'static str,
    /// Name in the names of variants.
    name: &'static str,
    /// Name in labels.
    title: &'static str,
}

const SWITCHES: [Switch; 2] = [
    Switch { key: "projection", name: "projection", title: "projection" },
    Switch { key: "keep_clear", name: "keep-clear", title: "keeping clear" },
];

/// A change of simulators, and the changed simulators.
pub(super) struct Variant {
    /// Name, such as `without-projection`.
    name: String,
    /// Label in tables.
    label: String,
    /// Id of each changed simulator, and the id of the unchanged one.
    originals: BTreeMap<String, String>,
    /// The specification of the changed simulators.
    pub(super) spec: RunSpec,
}

impl Variant {
    /// Creates the unchanged variant.
    pub(super) fn as_is(simulators: &[PlannedSimulator], spec: &RunSpec) -> Self {
        let originals = simulators.iter().map(|s| (s.id.clone(), s.id.clone())).collect();
        Self { name: AS_IS.to_owned(), label: "as it is".to_owned(), originals, spec: spec.clone() }
    }

    /// Returns the study member that runs these simulators.
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

/// A simulator with one component added or removed.
struct ChangedSimulator<'a> {
    from: &'a PlannedSimulator,
    id: String,
    parameter: Option<(&'static str, bool)>,
}

/// Creates every variant that changes at least one of the simulators: components that they have are removed,
/// components that they do not have are added.
pub(super) fn variants(
    simulators: &[PlannedSimulator],
    spec: &RunSpec,
) -> Result<Vec<Variant>, EvaluationError> {
    let mut variants = Vec::new();
    for Switch { key, name, title } in SWITCHES {
        for on in [true, false] {
            let mut changed = Vec::new();
            for from in simulators {
                if switch(from, key)? == Some(on) {
                    let parameter = Some((key, !on));
                    changed.push(ChangedSimulator { from, id: from.id.clone(), parameter });
                }
            }
            let with = if on { "without" } else { "with" };
            let (name, label) = (format!("{with}-{name}"), format!("{with} {title}"));
            variants.extend(variant(&name, &label, changed, spec)?);
        }
    }
    let with = Smoothing::Full;
    let takes = |s: &&PlannedSimulator| {
        let id = SimulatorId::parse(&s.id).ok().filter(|id| id.smoothing.is_none());
        id.and_then(|id| models::find(id.baseline)).is_some_and(|b| b.takes_stage)
    };
    let changed = simulators.iter().filter(takes);
    let changed =
        changed.map(|from| ChangedSimulator { from, id: with.id(&from.id), parameter: None }).collect();
    variants.extend(variant(
        &format!("with-{}", with.name()),
        &format!("with {}", title(with)),
        changed,
        spec,
    )?);
    for stage in Smoothing::ALL {
        // Mixes have no variants.
        let single = simulators.iter().filter(|from| from.members.is_empty());
        let with_it = single.filter_map(|from| match Smoothing::of_id(&from.id) {
            Some((id, own)) if own == stage => {
                Some(ChangedSimulator { from, id: id.to_owned(), parameter: None })
            }
            _ => None,
        });
        let (name, label) = (format!("without-{}", stage.name()), format!("without {}", title(stage)));
        variants.extend(variant(&name, &label, with_it.collect(), spec)?);
    }
    Ok(variants)
}

/// Returns the name of a stage in labels.
fn title(stage: Smoothing) -> &'static str {
    match stage {
        Smoothing::Full => "QP",
        Smoothing::WithoutOthers => "QP alone",
    }
}

/// Returns the state of a switch of a simulator; `None` if the simulator does not have it.
fn switch(simulator: &PlannedSimulator, key: &str) -> Result<Option<bool>, EvaluationError> {
    let baseline = SimulatorId::parse(&simulator.id).ok().and_then(|id| models::find(id.baseline));
    let Some(baseline) = baseline else { return Ok(None) };
    let card = Card::read(baseline.id, baseline.card)?;
    let Some(on) = card.parameters.get(key).and_then(toml::Value::as_bool) else { return Ok(None) };
    Ok(Some(simulator.parameters.get(key).map_or(on, |value| value == "true")))
}

/// Creates a variant; `None` if it changes no simulator.
fn variant(
    name: &str,
    label: &str,
    changed: Vec<ChangedSimulator<'_>>,
    spec: &RunSpec,
) -> Result<Option<Variant>, EvaluationError> {
    if changed.is_empty() {
        return Ok(None);
    }
    let (mut weights, mut set) = (Vec::new(), Vec::new());
    for ChangedSimulator { from, id, parameter } in &changed {
        // Weights and parameters are those of the unchanged simulator, except for the component.
        let given = || spec.subject.model_weights.iter().filter_map(|text| text.split_once('='));
        let weights_of = |id: &str| given().find(|(to, _)| *to == id);
        let variant = SimulatorId::parse(&from.id)?.variant;
        if let Some((_, file)) = weights_of(&from.id).or_else(|| weights_of(variant)) {
            weights.push(format!("{id}={file}"));
        }
        let others =
            from.parameters.iter().filter(|(key, _)| parameter.is_none_or(|(changed, _)| *key != changed));
        set.extend(others.map(|(key, value)| format!("{id}.{key}={value}")));
        set.extend(parameter.map(|(key, on)| format!("{id}.{key}={on}")));
    }
    let originals = changed.iter().map(|c| (c.id.clone(), c.from.id.clone())).collect();
    let mut spec = spec.clone();
    (spec.subject.model_weights, spec.subject.set) = (weights, set);
    spec.subject.models = changed.into_iter().map(|c| c.id).collect();
    spec.subject.external.external.clear();
    // The ids have the stage.
    spec.rollout.smooth = Stage(None);
    Ok(Some(Variant { name: name.to_owned(), label: label.to_owned(), originals, spec }))
}
