//! A trained network with its intention points, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::models::nn::weights::{CONFIG, save_with};
use reactsim::models::nn::{Initializer, Tensors, WeightsError};
use reactsim::rollout::Observation;
use reactsim::scene::Start;
use serde::{Deserialize, Serialize};

use super::inputs::{Ground, Scene, Surroundings, Survey};
use super::intentions::PREFIX;
use super::network::{Batch, Config, Network, SizeError};
use super::predict::{Prediction, prediction};
use super::{Intentions, IntentionsError};
use crate::models::ntp::reactive::Known;
use crate::models::ntp::reactive::step::View;

/// What the configuration in the file calls this kind of network.
const KIND: &str = "motion-transformer";
/// Beside batch norms PyTorch keeps a number that nothing hangs on.
const COUNTER: &str = ".num_batches_tracked";

/// A network that is ready to predict.
#[derive(Clone, Debug)]
pub struct Policy {
    /// Sizes.
    pub config: Config,
    /// Intention points.
    pub intentions: Intentions,
    /// The network.
    pub network: Network,
}

/// The configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    network: Sizes,
}

/// Sizes by number or by name.
#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum Sizes {
    Named(Named),
    Given(Config),
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Named {
    Mtr,
}

/// Why a file holds no such policy.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// Its tensors or its configuration.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// Its intention points.
    #[error(transparent)]
    Intentions(#[from] IntentionsError),
    /// A network of another kind.
    #[error(
        "the file holds a network of kind `{0}`, expected `{KIND}`: give it to the simulator that it was made for"
    )]
    Kind(String),
    /// Sizes that can not be.
    #[error(transparent)]
    Size(#[from] SizeError),
}

impl Policy {
    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// [`PolicyError`] that names the tensor or the field.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, PolicyError> {
        let tensors = Tensors::read(bytes)?;
        let kind: Kind = tensors.config()?;
        if kind.kind != KIND {
            return Err(PolicyError::Kind(kind.kind));
        }
        let stored: Stored = tensors.config()?;
        let config = match stored.network {
            Sizes::Named(Named::Mtr) => Config::mtr(),
            Sizes::Given(config) => config,
        };
        config.check()?;
        let mut tensors = tensors.without(|name| name.ends_with(COUNTER));
        let intentions = Intentions::from_tables(&tensors.split_off(PREFIX))?;
        let empty = Network::init(&config, &mut Initializer::new(0, device));
        let network = tensors.load(empty)?;
        Ok(Self { config, intentions, network })
    }

    /// The bytes of a file; `made` tells how it was made.
    ///
    /// # Errors
    /// [`PolicyError`] where what it was made of can not be written as text.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, PolicyError> {
        let (tables, entry) = self.intentions.tables()?;
        let stored = Stored { kind: KIND.to_owned(), network: Sizes::Given(self.config) };
        let config = serde_json::to_string(&stored).map_err(|e| WeightsError::Config(e.to_string()))?;
        let mut metadata = made.clone();
        metadata.extend([entry, (CONFIG.to_owned(), config)]);
        Ok(save_with(&self.network, tables, &metadata))
    }

    /// What is known of a scenario's map, for [`Self::predict`]: made once per episode.
    pub fn ground(&self, start: &Start) -> Ground {
        Survey::of(start, &self.config).ground()
    }

    /// What agents may do from now on, as far as the network knows: a prediction for each of the slots whose agent is present and of a
    /// class that is simulated, in the order of the slots. `ground` is that of this episode.
    pub fn predict(
        &self,
        seen: &Observation<'_>,
        ground: &Ground,
        slots: &[usize],
        device: &Device,
    ) -> Vec<Prediction> {
        let agents = &seen.start().agents;
        let tracks: Vec<_> = (0..agents.len()).map(|a| seen.track(a).to_vec()).collect();
        let lights: Vec<_> =
            (0..seen.start().lights.len()).map(|l| seen.light(l).last().copied().flatten()).collect();
        let view =
            View { agents, tracks: &tracks, now: seen.frame(), av_next: seen.av_next(), lights: &lights };
        self.predict_view(&view, ground, slots, device)
    }

    /// As [`Self::predict`], of motion that is known, from frame `now` on; nothing after it is looked at but the AV one frame later, where
    /// agents see that.
    pub fn predict_known(
        &self,
        known: &Known<'_>,
        now: usize,
        slots: &[usize],
        device: &Device,
    ) -> Vec<Prediction> {
        let lights: Vec<_> = known.lights.iter().map(|l| l.get(now).copied().flatten()).collect();
        let next = known.tracks.first().and_then(|av| av.get(now + 1).copied().flatten());
        let av_next = next.filter(|_| known.av_lookahead);
        let view = View { agents: &known.start.agents, tracks: known.tracks, now, av_next, lights: &lights };
        self.predict_view(&view, &self.ground(known.start), slots, device)
    }

    /// As [`Self::predict`], for whoever sees a scene otherwise.
    pub(crate) fn predict_view(
        &self,
        view: &View<'_>,
        ground: &Ground,
        slots: &[usize],
        device: &Device,
    ) -> Vec<Prediction> {
        let seen = Scene::of(view, ground);
        let surroundings = |&slot: &usize| Surroundings::of(&seen, slot, &self.config);
        let scenes: Vec<Surroundings> = slots.iter().filter_map(surroundings).collect();
        if scenes.is_empty() {
            return Vec::new();
        }
        let all: Vec<&Surroundings> = scenes.iter().collect();
        let batch = Batch::of(&all, &self.intentions, &self.config, device);
        let predicted = self.network.forward(&batch, &self.config);
        let Some(last) = predicted.layers.into_iter().next_back() else { return Vec::new() };
        let scores: Vec<f32> = last.scores.into_data().iter::<f32>().collect();
        let states: Vec<f32> = last.modes.into_data().iter::<f32>().collect();
        let per_scene = (scores.len() / scenes.len(), states.len() / scenes.len());
        let said = scores.chunks_exact(per_scene.0).zip(states.chunks_exact(per_scene.1));
        scenes
            .iter()
            .zip(said)
            .map(|(s, (scores, states))| prediction(s, scores, states, &self.config))
            .collect()
    }
}

/// The kind of network alone: files of others have other configurations.
#[derive(Deserialize)]
struct Kind {
    #[serde(default)]
    kind: String,
}
