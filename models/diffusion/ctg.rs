//! Controllable Traffic Generation (CTG; Zhong et al., arXiv 2210.17366, github.com/NVlabs/CTG): every agent
//! sees an image of its surroundings; its actions are found by behaviour cloning, or by denoising, which
//! rules can guide.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod entries;
mod guidance;
mod inputs;
pub mod learn;
pub mod network;
mod policy;
mod raster;
mod sampling;
mod sight;
mod simulator;

pub use guidance::Rules;
pub use policy::CtgPolicy;
pub use sampling::CtgParameters;
pub use sight::Sight;
pub use simulator::CtgSimulator;
