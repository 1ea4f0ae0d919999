//! The weights of the network behind `ntp-guarded`, as data. `manifest.toml` of `reactsim-weights` describes
//! them.

#![no_std]

/// Shipped weights by file name.
pub static SHIPPED: &[(&str, &[u8])] =
    &[("ntp-guarded.safetensors", include_bytes!("ntp-guarded.safetensors"))];
