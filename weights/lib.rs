//! The weights that ship with `reactsim`, as data. A crate of their own keeps packages below the size limit
//! of the registry.

#![no_std]

/// Shipped weights by file name; each has a row in the manifest with `shipped = true`. Empty without the feature
/// `files`.
#[cfg(not(feature = "files"))]
pub static SHIPPED: &[(&str, &[u8])] = &[];

/// Shipped weights by file name; each has a row in the manifest with `shipped = true`.
#[cfg(feature = "files")]
pub static SHIPPED: &[(&str, &[u8])] = &[
    ("ntp-reactive.safetensors", include_bytes!("ntp-reactive.safetensors")),
    ("qp-regression.safetensors", include_bytes!("qp-regression.safetensors")),
    ("mtr.safetensors", include_bytes!("mtr.safetensors")),
];

/// `manifest.toml`: digests, data and commands of all known weights, including those that do not ship.
pub static MANIFEST: &str = include_str!("manifest.toml");
