//! A trained network with its intention points, in one file.

use std::borrow::Cow;
use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_nn::learning::{INTENTIONS_PREFIX, Intentions};
use reactsim_nn::perception::{KnownMotion, SceneView};
use reactsim_nn::{Initializer, Tensors, WeightsError, weights::save_with};
use reactsim_rollout::Observation;
use reactsim_scene::levels::RoadHeights;
use reactsim_scene::{HISTORY, Start};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::inputs::{MapFeatures, SceneContext, Surroundings, Survey};
use super::network::{Batch, Config, Network};
use super::predict::{Prediction, prediction};

/// Kind of this network in the configuration of the file.
const KIND: &str = "motion-transformer";
/// Suffix of a counter that PyTorch stores with batch norms and that nothing depends on.
const COUNTER: &str = ".num_batches_tracked";

/// Number of frames before the present one that the features of the network depend on: its history, and the
/// motion before that.
const SEEN_FRAMES: usize = 2 * HISTORY;

/// Map features of an episode, the same for all its predictions.
#[derive(Clone, Debug)]
pub struct Ground(MapFeatures);

/// A network ready to predict.
#[derive(Clone, Debug)]
pub struct Policy {
    /// Sizes.
    pub config: Config,
    /// Intention points.
    pub intentions: Intentions,
    /// The network.
    pub network: Network,
}

/// Configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredConfig<N> {
    kind: String,
    network: N,
}

/// Fields of files of earlier versions, with the value that stands for the present network; `None`: the field
/// had an effect only with another value of these.
const REMOVED_FIELDS: [(&str, Option<&str>); 5] = [
    ("encoding", Some("agent-centric")),
    ("output_units", Some("fixed")),
    ("line_neighbours", None),
    ("map_layers", None),
    ("relation_width", None),
];

/// Reads the sizes of a network, by the name of a preset or one by one.
fn sizes(stored: Value) -> Result<Config, WeightsError> {
    let Value::Object(mut fields) = stored else {
        let unknown = || WeightsError::Config(format!("`network` is {stored}, expected sizes or \"mtr\""));
        return if stored == "mtr" { Ok(Config::mtr()) } else { Err(unknown()) };
    };
    for (field, only) in REMOVED_FIELDS {
        let value = fields.remove(field);
        if let (Some(value), Some(only)) = (value, only)
            && value != only
        {
            let reason = format!("`network.{field}` is {value}, but this version has only `{only}`");
            return Err(WeightsError::Config(reason));
        }
    }
    serde_json::from_value(Value::Object(fields)).map_err(|e| WeightsError::Config(e.to_string()))
}

impl Policy {
    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// [`WeightsError`], which names the tensor or the field.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, WeightsError> {
        let tensors = Tensors::read(bytes)?;
        tensors.expect_kind(KIND)?;
        let stored: StoredConfig<Value> = tensors.config()?;
        let config = sizes(stored.network)?;
        config.check()?;
        let mut tensors = tensors.without(|name| name.ends_with(COUNTER));
        let intentions = Intentions::from_tables(&tensors.split_off(INTENTIONS_PREFIX))?;
        let empty = Network::init(&config, &mut Initializer::blank(device));
        let network = tensors.load(empty)?;
        Ok(Self { config, intentions, network })
    }

    /// Returns the bytes of a file; `made` is further metadata.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance or the configuration cannot be written as text.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, WeightsError> {
        let stored = StoredConfig { kind: KIND.to_owned(), network: self.config };
        save_with(&self.network, &stored, [self.intentions.tables()?], made)
    }

    /// Returns the map features of a scenario, for [`Self::predict`]; they are the same for the whole
    /// episode.
    pub fn ground(&self, start: &Start) -> Ground {
        Ground(Survey::of(start, &self.config).features())
    }

    /// Predicts the agents of these slots that are present and of a simulated class, in the order of the
    /// slots. `ground` holds the map features of this episode, `heights` follow the road under its agents.
    pub fn predict(
        &self,
        seen: &Observation<'_>,
        ground: &Ground,
        heights: &mut RoadHeights,
        slots: &[usize],
        device: &Device,
    ) -> Vec<Prediction> {
        let lights = seen.lights_now();
        heights.follow(seen.start(), seen.tracks(), seen.frame());
        // Only recorded frames have noise, and the network no longer sees them.
        let tracks = match seen.step() > SEEN_FRAMES {
            true => Cow::Borrowed(seen.tracks()),
            false => self.config.attributes.shown(seen.tracks(), seen.start().current()),
        };
        let view = SceneView { tracks: &tracks, heights: Some(heights), ..SceneView::of(seen, &lights) };
        self.predict_view(&view, ground, slots, device)
    }

    /// Predicts as [`Self::predict`] does, from frame `now` of known motion. Later frames are ignored,
    /// except that of the AV one frame later if agents see it.
    pub fn predict_known(
        &self,
        known: &KnownMotion<'_>,
        now: usize,
        slots: &[usize],
        device: &Device,
    ) -> Vec<Prediction> {
        let lights = known.lights_at(now);
        let tracks = self.config.attributes.shown(known.tracks, now.min(known.start.current()));
        let known = KnownMotion { tracks: &tracks, ..*known };
        self.predict_view(&known.view(now, &lights), &self.ground(known.start), slots, device)
    }

    /// Predicts as [`Self::predict`] does, from a view.
    pub(crate) fn predict_view(
        &self,
        view: &SceneView<'_>,
        ground: &Ground,
        slots: &[usize],
        device: &Device,
    ) -> Vec<Prediction> {
        let seen = SceneContext::of(view, &ground.0);
        let surroundings = |&slot: &usize| Surroundings::of(&seen, slot, &self.config);
        let scenes: Vec<Surroundings> = slots.iter().filter_map(surroundings).collect();
        if scenes.is_empty() {
            return Vec::new();
        }
        let batch = Batch::of(&scenes.iter().collect::<Vec<_>>(), &self.intentions, &self.config, device);
        let predicted = self.network.forward(&batch, &self.config, false);
        let Some(last) = predicted.layers.into_iter().next_back() else { return Vec::new() };
        let scores: Vec<f32> = last.scores.into_data().iter::<f32>().collect();
        let states: Vec<f32> = last.modes.into_data().iter::<f32>().collect();
        let per_scene = (scores.len() / scenes.len(), states.len() / scenes.len());
        let outputs = scores.chunks_exact(per_scene.0).zip(states.chunks_exact(per_scene.1));
        scenes
            .iter()
            .zip(outputs)
            .map(|(s, (scores, states))| prediction(s, scores, states, &self.config))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn sizes_of_earlier_versions_are_read_unless_they_are_of_another_network() {
        let with = |more: Value| {
            let mut stored = serde_json::to_value(Config::default()).unwrap();
            stored.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
            sizes(stored)
        };
        let stated = json!({ "encoding": "agent-centric", "output_units": "fixed", "line_neighbours": 24,
            "map_layers": 1, "relation_width": 32 });
        assert_eq!(with(stated).unwrap(), Config::default());
        for (more, named) in [
            (json!({ "encoding": "scene-centric" }), "`network.encoding` is \"scene-centric\""),
            (json!({ "output_units": "growing" }), "`network.output_units` is \"growing\""),
            (json!({ "other": 1 }), "unknown field `other`"),
        ] {
            let error = with(more).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
        assert_eq!(sizes("mtr".into()).unwrap(), Config::mtr());
        let unknown = sizes("mrt".into()).unwrap_err().to_string();
        assert!(unknown.contains("`network` is \"mrt\""), "{unknown}");
    }
}
