#[cfg(feature = "formats")]
mod attack;
mod fixture;
#[cfg(feature = "formats")]
mod golden;
mod pruning;
mod quirks;
