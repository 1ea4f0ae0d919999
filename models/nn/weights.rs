//! Weights as safetensors files: read strictly, and written deterministically to the same bytes.
//!
//! Names and layouts are those of PyTorch's state dicts, in both directions: linear weights are
//! [out, in], norms have `weight` and `bias`, sequences are numbered. So the same code reads files
//! exported from PyTorch and files trained here.

mod error;
mod load;
mod names;
mod save;
mod tensors;

pub use error::WeightsError;
pub use save::{Tables, save, save_tables, save_with};
pub use tensors::Tensors;

/// Key of the metadata entry that holds the configuration of the network, as JSON.
pub const CONFIG: &str = "config";
