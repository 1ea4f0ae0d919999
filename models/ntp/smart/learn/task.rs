//! Training of the network as a task.

use std::collections::BTreeMap;
use std::error::Error;

use burn::module::Module;
use burn::tensor::Device;
use reactsim_nn::Noise;
use reactsim_nn::learning::{
    Origin, ShippedRecipe, SimulatorTask, TaskError, TaskInput, TaskSetup, Trainable, TrainingTask,
    recipe_values,
};
use reactsim_nn::perception::Class;
use reactsim_nn::training::{Output, Settings, Stream, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::super::tokens::{MapVocabulary, Vocabulary};
use super::super::{Smart, SmartConfig, SmartPolicy};
use super::sample::sample;
use super::token_learning::TokenLearning;
use super::{Recipe, Sample};

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
        TaskInput {
            name: VOCABULARY,
            about: "motion tokens, from `train vocabulary`, `models/ntp/export.py` or weights",
            required: true,
        },
        TaskInput {
            name: MAP_VOCABULARY,
            about: "curves of the map, from `train vocabulary --map-out`, `models/ntp/export.py` or weights",
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
    let fits = |policy: &SmartPolicy| {
        let stated = SmartConfig { n_params: 0, ..policy.network.config().clone() };
        stated == recipe.config(&policy.vocabulary, &policy.map_vocabulary)
    };
    let parent = setup.parent(SmartPolicy::read, fits)?;
    let (parent, own) =
        parent.map(|(p, digest)| ((p.network, digest), (p.vocabulary, p.map_vocabulary))).unzip();
    let (own, own_map) = own.unzip();
    let missing = |name| TaskError::NoInput { id: ID, name };
    let vocabulary = setup.input(VOCABULARY, Vocabulary::read, own)?.ok_or(missing(VOCABULARY))?;
    let map_vocabulary = setup.input(MAP_VOCABULARY, MapVocabulary::read, own_map)?;
    let map_vocabulary = map_vocabulary.ok_or(missing(MAP_VOCABULARY))?;
    let task = NextSmartToken::new(recipe, vocabulary, map_vocabulary, &setup.device);
    let task = task.map_err(|source| TaskError::values(ID, source))?;
    Ok(Box::new(NextSmartToken { origin: Origin::new(&setup.device, parent), ..task }))
}

/// The training task of the published network.
pub struct NextSmartToken {
    recipe: Recipe,
    config: SmartConfig,
    tokens: TokenLearning,
    origin: Origin<Smart>,
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
        let counts = Class::ALL.map(|class| vocabulary.tokens(class));
        if !recipe.network.separate_heads && counts.iter().any(|count| *count != counts[0]) {
            return Err(format!(
                "the classes have {}, {} and {} tokens, but one head: set `network.separate_heads` to true",
                counts[0], counts[1], counts[2]
            )
            .into());
        }
        let config = recipe.config(&vocabulary, &map_vocabulary);
        config.check()?;
        let tokens = TokenLearning::new(vocabulary, map_vocabulary, &recipe.smoothing, device);
        Ok(Self { recipe, config, tokens, origin: Origin::new(device, None) })
    }
}

impl Task for NextSmartToken {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Smart;

    fn init(&self, seed: u64) -> Smart {
        self.origin
            .network(seed, |init| Smart::init(&self.config, init).expect("the configuration was checked"))
    }

    fn begins_trained(&self) -> bool {
        self.origin.is_trained()
    }

    fn prepare(&self, scenario: &Scenario, stream: Option<&mut Stream>) -> Option<Sample> {
        let TokenLearning { vocabulary, map_vocabulary, .. } = &self.tokens;
        sample(scenario, &self.recipe, &self.config, vocabulary, map_vocabulary, stream)
    }

    fn loss(&self, model: &Smart, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        match stream {
            Some(stream) => self.tokens.loss(model, samples, &mut Noise::new(stream.clone())),
            // Validation has no stream and no autodiff.
            None => self.tokens.plain_loss(model, samples),
        }
    }

    fn file(&self, model: &Smart, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.tokens.file(model, metadata)
    }

    fn describe(&self) -> serde_json::Value {
        self.origin.describe(serde_json::json!({
            "recipe": self.recipe,
            "vocabulary": self.tokens.vocabulary.provenance(),
            "map_vocabulary": self.tokens.map_vocabulary.provenance(),
            "parameters": self.init(0).num_params(),
        }))
    }
}

impl SimulatorTask for NextSmartToken {
    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        self.tokens.controller(network)
    }
}
