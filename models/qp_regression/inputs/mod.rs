//! What the network is shown of a scene: who and what is around an agent, in that agent's frame.

mod forecast;
mod ground;
mod histories;
mod lines;
mod outlook;
mod scene;
mod surroundings;

use forecast::forecast;
pub use ground::Ground;
pub(crate) use ground::Survey;
pub(crate) use histories::agent_numbers;
use lines::Lines;
pub(crate) use lines::point_numbers;
pub(crate) use outlook::{OUTLOOK, Outlook};
pub(crate) use scene::Scene;
pub(crate) use surroundings::{Frame2, Rows, Surroundings};
