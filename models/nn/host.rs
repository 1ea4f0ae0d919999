//! Groups of operations on numbers in host memory, mostly for networks without gradients.
//!
//! A backend writes the result of every operation to memory. Where this takes most of the time, a group of
//! operations is computed here in one pass. A function equals the operations that it replaces but for
//! rounding. Bits are those of the [class](super::cpu_class) of processors, as with other operations.

#![allow(
    clippy::needless_range_loop,
    clippy::manual_memcpy,
    reason = "iterators of pairs are not always inlined into code for a class of processors, and copies of \
              slices keep sums in memory instead of registers"
)]

mod attention;
mod gate;
mod gelu;
mod learned_rows;
mod mish;
mod numbers;
mod product;
mod relational;
mod rows;
mod softmax;

use burn::tensor::{Device, TensorData};

use super::device::is_gpu;

pub(crate) use attention::{Attention, attend};
pub(crate) use gate::gate;
pub(crate) use gelu::gelu;
pub(crate) use learned_rows::{LearnedRows, learned_rows, matrix_gradients, row_gradients};
pub(crate) use mish::{LARGE as MISH_BOUND, mish};
use numbers::Numbers;
pub(crate) use relational::{Slots, attend_to_neighbors};
pub(crate) use rows::{Finish, Norm};
pub(crate) use rows::{RowPass, gather, largest, pass};

/// Largest number of 32-bit numbers in a vector register (AVX-512). Rows are padded to a multiple of it,
/// which registers of other sizes divide.
const LANES: usize = 16;

/// Returns whether tensors of this device are in host memory and have no gradients.
pub fn is_host(device: &Device) -> bool {
    !device.is_autodiff() && !is_gpu(device)
}

/// Returns the numbers of a tensor, row by row.
pub(super) fn slice(data: &TensorData) -> &[f32] {
    // Networks are loaded and computed in this type.
    data.as_slice().expect("32-bit floating-point numbers")
}
