//! Diffusion-Planner (Zheng et al., ICLR 2025, github.com/ZhengYinan-AIR/Diffusion-Planner): a diffusion model of the joint
//! motion of the AV and its neighbours, which ReactSim-Bench draws its candidates from.

mod inputs;
mod lanes;
pub mod learn;
pub mod network;
mod plans;
mod policy;
mod units;

pub use inputs::PlannerSight;
pub use policy::PlannerPolicy;
