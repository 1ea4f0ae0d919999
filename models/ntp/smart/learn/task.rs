//! Training of the network as a task.

use std::error::Error;

use burn::module::Module;
use burn::tensor::Device;
use reactsim_learning::{
    Origin, ShippedRecipe, SimulatorTask, TaskError, TaskInput, TaskSetup, Trainable, TrainingTask,
    recipe_values,
};
use reactsim_nn::Noise;
use reactsim_perception::Class;
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use reactsim_training::{Output, Settings, Stream, Task, View};

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
    let values = |source: Box<dyn Error + Send + Sync>| TaskError::values(ID, source);
    let Some((policy, digest)) = setup.parent(SmartPolicy::read)? else {
        let vocabulary = vocabulary.ok_or(TaskError::NoInput { id: ID, name: VOCABULARY })?;
        let map_vocabulary = map_vocabulary.ok_or(TaskError::NoInput { id: ID, name: MAP_VOCABULARY })?;
        let task = NextSmartToken::new(recipe, vocabulary, map_vocabulary, &setup.device);
        return Ok(Box::new(task.map_err(values)?));
    };
    if vocabulary.is_some_and(|other| other != policy.vocabulary)
        || map_vocabulary.is_some_and(|other| other != policy.map_vocabulary)
    {
        return Err(setup.refuse_parent("it has other tokens than the given vocabularies: omit them"));
    }
    let task = NextSmartToken::new(recipe, policy.vocabulary, policy.map_vocabulary, &setup.device);
    let mut task = task.map_err(values)?;
    let stated = SmartConfig { n_params: 0, ..policy.network.config().clone() };
    if stated != task.config {
        return Err(setup.refuse_parent_sizes());
    }
    task.origin = Origin::Parent(policy.network, digest);
    Ok(Box::new(task))
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
        let config = recipe.network.config(counts, map_vocabulary.tokens());
        config.check()?;
        let tokens = TokenLearning::new(vocabulary, map_vocabulary, &recipe.smoothing, device);
        Ok(Self { recipe, config, tokens, origin: Origin::Random })
    }
}

impl Task for NextSmartToken {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Smart;

    fn init(&self, seed: u64) -> Smart {
        self.origin.network(seed, &self.tokens.device, |init| {
            Smart::init(&self.config, init).expect("the configuration was checked")
        })
    }

    fn prepare(&self, scenario: &Scenario, view: View<'_>) -> Option<Sample> {
        let TokenLearning { vocabulary, map_vocabulary, .. } = &self.tokens;
        sample(scenario, &self.recipe, &self.config, vocabulary, map_vocabulary, view.stream())
    }

    fn loss(&self, model: &Smart, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        match stream {
            Some(stream) => self.tokens.loss(model, samples, &mut Noise::new(stream.clone())),
            // Validation has no stream and no autodiff.
            None => self.tokens.plain_loss(model, samples),
        }
    }

    fn file(&self, model: &Smart, about: &serde_json::Value) -> Option<Vec<u8>> {
        self.tokens.file(model, about)
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
