//! Diffusion-Planner (Zheng et al., ICLR 2025, github.com/ZhengYinan-AIR/Diffusion-Planner): a diffusion
//! model of the joint motion of the AV and its neighbours, which ReactSim-Bench draws its candidates from.

pub mod network;
