//! What the network is shown of a scene: who and what is around an agent, in that agent's frame.

mod forecast;
mod histories;
mod lines;
mod surroundings;

pub(crate) use forecast::forecast;
pub(crate) use histories::agent_numbers;
pub use lines::Lines;
pub(crate) use lines::point_numbers;
pub(crate) use surroundings::{Frame2, Rows, Surroundings};
