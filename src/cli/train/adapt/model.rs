//! Models that can be adapted, and how each is trained.

use anyhow::anyhow;

use crate::cli::suggestion::did_you_mean;

/// A model that can be adapted.
pub(super) struct AdaptableModel {
    /// Id of the simulator.
    pub(super) id: &'static str,
    /// Training task.
    pub(super) task: &'static str,
    /// Recipe of the task.
    pub(super) recipe: Option<&'static str>,
    /// Inputs of the task that the weights contain.
    pub(super) inputs: &'static [&'static str],
    /// Changes of the recipe.
    changes: &'static [(&'static str, &'static str)],
    /// Whether its haste is chosen.
    pub(super) has_haste: bool,
}

/// Inputs that weights of SMART contain.
const VOCABULARIES: &[&str] = &["vocabulary", "map-vocabulary"];
/// Changes with which the weights of `ntp-guarded` were trained.
const REACTIVE: &[(&str, &str)] =
    &[("augmentation.noise.slowed", "0.4"), ("learning.learning_rate", "0.0006")];
/// Changes with which the weights of `smart-small` were trained, but for the learning rate.
const SMART: &[(&str, &str)] = &[
    ("smoothing.uniform", "0.0"),
    ("smoothing.spatial", "0.1"),
    ("augmentation.near_tokens", "4"),
    ("augmentation.temperature", "0.05"),
    ("learning.learning_rate", "0.0002"),
];
/// Changes with which the weights of `trajtok-small` were trained, but for the learning rate.
const TRAJTOK: &[(&str, &str)] = &[
    ("augmentation.stretch", "0.1"),
    ("augmentation.near_tokens", "4"),
    ("augmentation.temperature", "0.05"),
    ("learning.learning_rate", "0.0002"),
];
/// Change for weights that were trained with the recipe as it is.
const SLOW: &[(&str, &str)] = &[("learning.learning_rate", "0.0002")];

const fn model(
    id: &'static str,
    task: &'static str,
    changes: &'static [(&'static str, &'static str)],
) -> AdaptableModel {
    AdaptableModel { id, task, recipe: None, inputs: &[], changes, has_haste: false }
}

/// All models that can be adapted.
const MODELS: [AdaptableModel; 7] = [
    AdaptableModel { has_haste: true, ..model("ntp-guarded", "ntp-reactive", REACTIVE) },
    model("ntp-reactive", "ntp-reactive", REACTIVE),
    AdaptableModel { inputs: VOCABULARIES, ..model("smart-small", "smart", SMART) },
    AdaptableModel {
        inputs: VOCABULARIES,
        recipe: Some("trajtok"),
        ..model("trajtok-small", "smart", TRAJTOK)
    },
    AdaptableModel { inputs: VOCABULARIES, ..model("smart-reactive", "smart", SMART) },
    model("regression", "qp-regression", SLOW),
    model("vbd", "vbd", SLOW),
];

impl AdaptableModel {
    /// Returns the model with this id.
    pub(super) fn find(id: &str) -> anyhow::Result<&'static Self> {
        let known = || MODELS.iter().map(|model| model.id);
        MODELS.iter().find(|model| model.id == id).ok_or_else(|| {
            let list: Vec<&str> = known().collect();
            anyhow!(
                "`{id}` cannot be adapted; expected one of {}{}",
                list.join(", "),
                did_you_mean(id, known())
            )
        })
    }

    /// Returns the changes of the recipe: a short warm-up and a validation after each tenth, for this many epochs
    /// and steps.
    pub(super) fn changes(&self, epochs: f64, steps: u64) -> Vec<String> {
        let own = self.changes.iter().map(|(key, value)| format!("{key}={value}"));
        let rest = [
            format!("learning.epochs={epochs:.4}"),
            format!("learning.validate_every={}", (steps / 10).max(1)),
            format!("learning.warm_up={}", (steps / 20).min(100)),
            "learning.floor=0.02".to_owned(),
            "learning.held_out=0.1".to_owned(),
            "learning.most_held_out=64".to_owned(),
        ];
        own.chain(rest).collect()
    }
}
