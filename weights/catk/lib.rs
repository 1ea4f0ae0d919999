//! The weights of networks that were fine-tuned from SMART-small, as data. `manifest.toml` of
//! `reactsim-weights` describes them.

#![no_std]

/// Shipped weights by file name.
pub static SHIPPED: &[(&str, &[u8])] = &[
    ("catk-small.safetensors", include_bytes!("catk-small.safetensors")),
    ("smart-reactive.safetensors", include_bytes!("smart-reactive.safetensors")),
];
