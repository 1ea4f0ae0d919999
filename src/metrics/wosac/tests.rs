mod fixture;
#[cfg(feature = "formats")]
mod golden;
mod pruning;
