//! Weights as safetensors: read strictly, written to the same bytes every time.
//!
//! Names and layouts are those of PyTorch's state dicts, in both directions: linear weights [out, in], norms with `weight` and `bias`,
//! sequences by number. So a file exported from PyTorch and one that was trained here are read by the same code.

mod error;
mod load;
mod names;
mod save;
mod tensors;

pub use error::WeightsError;
pub use save::{Tables, save, save_tables, save_with};
pub use tensors::Tensors;

/// The entry of the file's metadata that holds the configuration of the network, as JSON.
pub const CONFIG: &str = "config";
