//! The weights of SMART-small and TrajTok-small, as data. `manifest.toml` of `reactsim-weights` describes them.

#![no_std]

/// Shipped weights by file name.
pub static SHIPPED: &[(&str, &[u8])] = &[
    ("smart-small.safetensors", include_bytes!("smart-small.safetensors")),
    ("trajtok-small.safetensors", include_bytes!("trajtok-small.safetensors")),
];
