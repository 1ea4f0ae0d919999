//! Versatile Behavior Diffusion (VBD; Huang et al., arXiv 2404.02524, github.com/SafeRoboticsLab/VBD): a
//! scene encoder, a predictor of behaviours towards anchor points, and a denoiser of the joint actions of all
//! agents.

pub mod entries;
mod inputs;
pub mod learn;
pub mod network;
mod noise;
mod policy;
mod sampling;
mod simulator;

pub use inputs::Sight;
pub use policy::VbdPolicy;
pub use sampling::VbdParameters;
pub use simulator::VbdSimulator;
