//! Shared parts of networks that learn from scenarios.
//!
//! A [`Window`] is a part of a scenario, as long as those of the benchmark. A `LearningScene` is a window
//! with map data of a network, which can be mirrored and stretched (`LearningMap`) and viewed from any frame.
//! A `Reservoir` is a random sample of bounded size. [`Provenance`] describes what was computed from
//! scenarios, which [`ScenarioDigest`] counts, such as [`Intentions`], the points that agents may head for,
//! which [`EndPoints`] makes by k-means.
//!
//! A [`TrainingTask`] is an entry of the list of tasks: its recipe, and the function that builds a
//! [`Trainable`] of it.

mod intentions;
mod k_means;
mod map;
mod origin;
mod provenance;
mod recipe;
mod reservoir;
mod scene;
mod tracks;
mod trainable;
mod training_task;
mod window;

pub use intentions::Intentions;
pub use intentions::PREFIX as INTENTIONS_PREFIX;
pub use k_means::EndPoints;
pub use map::LearningMap;
pub use origin::Origin;
pub use provenance::{Provenance, ScenarioDigest};
pub use recipe::recipe_values;
pub use recipe::{LEARNING_RANGES, recipe_document};
pub use reservoir::Reservoir;
pub use scene::{LearningScene, SceneAugmentation, shifted};
pub use tracks::for_each_track;
pub use trainable::{Measure, SimulatorTask, Trainable, Training};
pub use training_task::{ShippedRecipe, TaskError, TaskInput, TaskSetup, TrainingTask, learning_settings};
pub use window::Window;
