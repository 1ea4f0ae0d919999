//! The weights of the networks of diffusion, and of the cloning that belongs to one of them, as data.
//! `manifest.toml` of `reactsim-weights` describes them.

#![no_std]

/// Shipped weights by file name.
pub static SHIPPED: &[(&str, &[u8])] = &[
    ("ctg-cloning.safetensors", include_bytes!("ctg-cloning.safetensors")),
    ("ctg-diffusion.safetensors", include_bytes!("ctg-diffusion.safetensors")),
    ("diffusion-planner.safetensors", include_bytes!("diffusion-planner.safetensors")),
    ("vbd.safetensors", include_bytes!("vbd.safetensors")),
];
