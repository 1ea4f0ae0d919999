//! Models that can be adapted, and how each is trained.

use anyhow::anyhow;

use crate::evaluation::suggestion::did_you_mean;

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
    /// Peak learning rate of trainings of at least [`FULL_RATE_STEPS`] steps.
    learning_rate: f64,
    /// Whether its haste is chosen.
    pub(super) has_haste: bool,
}

/// Inputs that weights of SMART contain.
const VOCABULARIES: &[&str] = &["vocabulary", "map-vocabulary"];
/// Changes with which the weights of `ntp-guarded` were trained.
const REACTIVE: &[(&str, &str)] = &[("augmentation.noise.slowed", "0.4")];
/// Changes with which the weights of `smart-small` were trained.
const SMART: &[(&str, &str)] = &[
    ("smoothing.uniform", "0.0"),
    ("smoothing.spatial", "0.1"),
    ("augmentation.near_tokens", "4"),
    ("augmentation.temperature", "0.05"),
];
/// Changes with which the weights of `trajtok-small` were trained.
const TRAJTOK: &[(&str, &str)] = &[
    ("augmentation.stretch", "0.1"),
    ("augmentation.near_tokens", "4"),
    ("augmentation.temperature", "0.05"),
];
/// Peak learning rate with which the weights of `ntp-guarded` were trained, and a lower one for the other
/// networks.
const REACTIVE_RATE: f64 = 6e-4;
const OTHER_RATE: f64 = 2e-4;
/// Steps from which on a training reaches the full rate. A shorter one has a lower rate, in proportion: the
/// first steps at the full rate take a network farther from the logs, and there would be no time to return.
const FULL_RATE_STEPS: u64 = 60;

const fn model(
    id: &'static str,
    task: &'static str,
    changes: &'static [(&'static str, &'static str)],
) -> AdaptableModel {
    AdaptableModel {
        id,
        task,
        recipe: None,
        inputs: &[],
        changes,
        learning_rate: OTHER_RATE,
        has_haste: false,
    }
}

/// All models that can be adapted.
const MODELS: [AdaptableModel; 7] = [
    AdaptableModel {
        learning_rate: REACTIVE_RATE,
        has_haste: true,
        ..model("ntp-guarded", "ntp-reactive", REACTIVE)
    },
    AdaptableModel { learning_rate: REACTIVE_RATE, ..model("ntp-reactive", "ntp-reactive", REACTIVE) },
    AdaptableModel { inputs: VOCABULARIES, ..model("smart-small", "smart", SMART) },
    AdaptableModel {
        inputs: VOCABULARIES,
        recipe: Some("trajtok"),
        ..model("trajtok-small", "smart", TRAJTOK)
    },
    AdaptableModel { inputs: VOCABULARIES, ..model("smart-reactive", "smart", SMART) },
    model("regression", "qp-regression", &[]),
    model("vbd", "vbd", &[]),
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

    /// Returns whether the network can be trained by rewards: it draws tokens.
    pub(super) fn takes_rewards(&self) -> bool {
        matches!(self.task, "ntp-reactive" | "smart")
    }

    /// Returns the changes of the recipe: a short warm-up and a validation after each tenth, for this many epochs
    /// and steps.
    pub(super) fn changes(&self, epochs: f64, steps: u64) -> Vec<String> {
        let own = self.changes.iter().map(|(key, value)| format!("{key}={value}"));
        let share = steps.min(FULL_RATE_STEPS) as f64 / FULL_RATE_STEPS as f64;
        let rest = [
            format!("learning.epochs={epochs:.4}"),
            format!("learning.learning_rate={:.7}", self.learning_rate * share),
            format!("learning.validate_every={}", (steps / 10).max(1)),
            format!("learning.warm_up={}", (steps / 20).max(steps.min(20) / 4).min(100)),
            "learning.floor=0.02".to_owned(),
            "learning.held_out=0.1".to_owned(),
            "learning.most_held_out=64".to_owned(),
        ];
        own.chain(rest).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_trainings_have_lower_rates_and_a_warm_up() {
        let model = AdaptableModel::find("ntp-guarded").unwrap();
        let of = |steps| {
            let changes = model.changes(1.0, steps);
            let value = |key: &str| {
                let found = changes.iter().find_map(|change| change.strip_prefix(key));
                found.unwrap().parse::<f64>().unwrap()
            };
            (value("learning.learning_rate="), value("learning.warm_up="))
        };
        assert_eq!(of(6), (0.00006, 1.0));
        assert_eq!(of(18), (0.00018, 4.0));
        assert_eq!(of(60), (0.0006, 5.0));
        assert_eq!(of(600), (0.0006, 30.0));
        assert_eq!(of(10_000), (0.0006, 100.0));
    }
}
