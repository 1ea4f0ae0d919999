//! Input features of the network: agents and map lines around an agent, in that agent's frame.

mod frame;
mod ground;
mod histories;
mod lines;
mod outlook;
mod scene;
mod surroundings;

pub(crate) use frame::{LocalFrame, PolylineFeatures};
pub(crate) use ground::{MapFeatures, Survey};
pub(crate) use histories::agent_numbers;
use lines::Lines;
pub(crate) use lines::point_numbers;
pub(crate) use outlook::{OUTLOOK, Outlook};
pub(crate) use scene::SceneContext;
pub(crate) use surroundings::Surroundings;
