//! Versatile Behavior Diffusion (VBD; Huang et al., arXiv 2404.02524, github.com/SafeRoboticsLab/VBD): a scene encoder, a
//! predictor of behaviours towards anchor points, and a denoiser of the joint actions of all agents.

pub mod network;
