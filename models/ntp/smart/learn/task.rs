//! Training of the network as a task.

use std::collections::BTreeMap;
use std::error::Error;

use burn::module::Module;
use burn::tensor::Device;
use reactsim::models::nn::{Initializer, Noise};
use reactsim::rollout::Controller;
use reactsim::scene::Scenario;
use reactsim::training::{Output, Settings, Stream, Task, View};

use super::super::super::entries::smart_parameters;
use super::super::super::smoothing::TargetDistributions;
use super::super::super::token_loss::{Target, token_loss};
use super::super::super::tokens::{MapVocabulary, Vocabulary};
use super::super::{Batch, Smart, SmartConfig, SmartPolicy, SmartSimulator, token_shapes};
use super::sample::sample;
use super::{Recipe, Sample};
use crate::models::learning::{
    ShippedRecipe, SimulatorTask, TaskError, TaskInput, TaskSetup, Trainable, TrainingTask, recipe_values,
};
use crate::models::perception::Class;

/// Training of SMART and TrajTok.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Next-token prediction with the published network of SMART and TrajTok",
    simulators: &[ID, "smart-projected"],
    defaults: || recipe_values(&Recipe::default(), &Settings::default()),
    ranges: include_str!("ranges.toml"),
    recipes: &[
        ShippedRecipe {
            name: "trajtok",
            about: "the variant of TrajTok: SwiGLU, spatially aware smoothing",
            text: include_str!("recipes/trajtok.toml"),
        },
        ShippedRecipe {
            name: "7m",
            about: "the published sizes, 7 million weights",
            text: include_str!("recipes/7m.toml"),
        },
    ],
    inputs: &[
        TaskInput { name: VOCABULARY, about: "motion tokens, from `train vocabulary`", required: true },
        TaskInput {
            name: MAP_VOCABULARY,
            about: "curves of the map, from `train vocabulary --map-out`",
            required: true,
        },
    ],
    needs_weights: false,
    make,
};

/// Id of the task, and of the simulator that executes tokens as they are.
const ID: &str = "smart";
/// Name of the input with the tokens of agents.
const VOCABULARY: &str = "vocabulary";
/// Name of the input with the tokens of the map.
const MAP_VOCABULARY: &str = "map-vocabulary";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: Recipe = setup.recipe()?;
    let vocabulary = setup.input(VOCABULARY, Vocabulary::read)?;
    let map_vocabulary = setup.input(MAP_VOCABULARY, MapVocabulary::read)?;
    let values = |source: Box<dyn Error + Send + Sync>| TaskError::Values { id: ID, source };
    let Some(file) = &setup.from else {
        let vocabulary = vocabulary.ok_or(TaskError::NoInput { id: ID, name: VOCABULARY })?;
        let map_vocabulary = map_vocabulary.ok_or(TaskError::NoInput { id: ID, name: MAP_VOCABULARY })?;
        let task = NextSmartToken::new(recipe, vocabulary, map_vocabulary, &setup.device);
        return Ok(Box::new(task.map_err(values)?));
    };
    let refuse = |source: Box<dyn Error + Send + Sync>| TaskError::File {
        what: "weights",
        file: file.name.clone(),
        source,
    };
    let policy =
        SmartPolicy::read(&file.bytes, &setup.device.clone().autodiff()).map_err(|e| refuse(e.into()))?;
    if vocabulary.is_some_and(|other| other != policy.vocabulary)
        || map_vocabulary.is_some_and(|other| other != policy.map_vocabulary)
    {
        return Err(refuse("it has other tokens than the given vocabularies: omit them".into()));
    }
    let task = NextSmartToken::new(recipe, policy.vocabulary, policy.map_vocabulary, &setup.device);
    let mut task = task.map_err(values)?;
    let stated = SmartConfig { n_params: 0, ..policy.network.config().clone() };
    if stated != task.config {
        return Err(refuse(
            "its network has other sizes than the recipe: give the recipe the same `network`".into(),
        ));
    }
    task.from = Some((policy.network, file.digest.clone()));
    Ok(Box::new(task))
}

/// The training task of the published network.
pub struct NextSmartToken {
    recipe: Recipe,
    config: SmartConfig,
    vocabulary: Vocabulary,
    map_vocabulary: MapVocabulary,
    device: Device,
    /// Network to start from, on a device with autodiff, and the digest of its file.
    from: Option<(Smart, String)>,
    /// Target distributions on the device with gradients and on the one without.
    distributions: [TargetDistributions; 2],
}

impl NextSmartToken {
    /// Builds a task on this device, which must be one without autodiff.
    ///
    /// # Errors
    /// A message if the recipe does not fit the vocabularies, or has invalid values.
    pub fn new(
        recipe: Recipe,
        vocabulary: Vocabulary,
        map_vocabulary: MapVocabulary,
        device: &Device,
    ) -> Result<Self, Box<dyn Error + Send + Sync>> {
        let tokens = Class::ALL.map(|class| vocabulary.tokens(class));
        if !recipe.network.separate_heads && tokens.iter().any(|count| *count != tokens[0]) {
            return Err(format!(
                "the classes have {}, {} and {} tokens, but one head: set `network.separate_heads` to true",
                tokens[0], tokens[1], tokens[2]
            )
            .into());
        }
        let config = recipe.network.config(tokens, map_vocabulary.tokens());
        config.check()?;
        let device = device.clone();
        let distributions = [device.clone().autodiff(), device.clone()]
            .map(|d| TargetDistributions::of(&vocabulary, &recipe.smoothing, &d));
        Ok(Self { recipe, config, vocabulary, map_vocabulary, device, from: None, distributions })
    }

    /// Returns the loss of samples with a network on this device.
    fn run(
        &self,
        network: &Smart,
        samples: &[Sample],
        distributions: &TargetDistributions,
        device: &Device,
        noise: &mut Noise,
    ) -> Output {
        let batch = Batch::new(network.config(), samples.iter().map(|s| &s.scene), noise)
            .expect("samples are made for networks of this configuration");
        let tables = network
            .tables(&token_shapes(&self.vocabulary, &self.map_vocabulary), device)
            .expect("the network was built for these vocabularies");
        let (mut targets, mut nodes) = (Vec::new(), 0);
        for sample in samples {
            targets.extend(sample.targets.iter().map(|t| Target { row: t.row + nodes, ..*t }));
            nodes += sample.scene.agents.len() * sample.scene.steps.len();
        }
        let scores = network.forward(&tables, &batch, noise);
        token_loss(&targets, distributions, device, |class, rows| {
            scores.clone().select(0, rows).narrow(1, 0, self.vocabulary.tokens(class))
        })
    }

    fn policy(&self, network: &Smart) -> Result<SmartPolicy, String> {
        let (vocabulary, map_vocabulary) = (self.vocabulary.clone(), self.map_vocabulary.clone());
        SmartPolicy::new(network.clone(), vocabulary, map_vocabulary, &self.device).map_err(|e| e.to_string())
    }
}

impl Task for NextSmartToken {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Smart;

    fn init(&self, seed: u64) -> Smart {
        if let Some((network, _)) = &self.from {
            return network.clone();
        }
        let device = self.device.clone().autodiff();
        Smart::init(&self.config, &mut Initializer::new(seed, &device))
            .expect("the configuration was checked")
    }

    fn prepare(&self, scenario: &Scenario, view: View<'_>) -> Option<Sample> {
        let varied = match view {
            View::Varied(stream) => Some((&self.recipe.augmentation, stream)),
            View::Plain => None,
        };
        sample(scenario, &self.recipe, &self.config, &self.vocabulary, &self.map_vocabulary, varied)
    }

    fn loss(&self, model: &Smart, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        match stream {
            Some(stream) => {
                let device = self.device.clone().autodiff();
                self.run(model, samples, &self.distributions[0], &device, &mut Noise::new(stream.clone()))
            }
            // Validation has no stream and no autodiff.
            None => self.run(model, samples, &self.distributions[1], &self.device, &mut Noise::none()),
        }
    }

    fn file(&self, model: &Smart, about: &serde_json::Value) -> Option<Vec<u8>> {
        let made = BTreeMap::from([("made".to_owned(), about.to_string())]);
        self.policy(model).ok()?.write(&made).ok()
    }

    fn describe(&self) -> serde_json::Value {
        let mut all = serde_json::json!({
            "recipe": self.recipe,
            "vocabulary": self.vocabulary.provenance(),
            "map_vocabulary": self.map_vocabulary.provenance(),
            "parameters": self.init(0).num_params(),
        });
        if let Some((_, digest)) = &self.from {
            all["from"] = digest.as_str().into();
        }
        all
    }
}

impl SimulatorTask for NextSmartToken {
    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        let parameters = smart_parameters().map_err(|e| e.to_string())?;
        Ok(Controller::Fair(Box::new(SmartSimulator::new(ID, self.policy(network)?, parameters))))
    }
}
