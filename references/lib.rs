//! Reference results that ship with [reactsim](https://docs.rs/reactsim), as data.

#![no_std]

/// Names and contents of the files of a reference.
pub type ReferenceFiles = &'static [(&'static str, &'static [u8])];

/// The files of a reference from its folder: `shipped!("reactsim-bench-v2")`.
macro_rules! shipped {
    ($name:literal) => {
        (
            $name,
            &[
                shipped!($name, "reference.toml"),
                shipped!($name, "provenance.json"),
                shipped!($name, "summary.json"),
                shipped!($name, "rows.parquet"),
            ],
        )
    };
    ($name:literal, $file:literal) => {
        ($file, include_bytes!(concat!($name, "/", $file)))
    };
}

/// Shipped references by name.
pub static SHIPPED: &[(&str, ReferenceFiles)] = &[shipped!("reactsim-bench-v2")];
