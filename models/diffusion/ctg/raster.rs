//! Rasters: what the network sees of a scene, as images around each agent.

mod fill;
mod ground;
mod image;
mod shapes;

pub(crate) use ground::Ground;
pub(crate) use image::image;
pub(crate) use shapes::GroundShapes;
