//! Errors of weights files.

/// Reason why weights are rejected. Shapes are as in the file: linear weights are [out, in].
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The file is cut short or has another format.
    #[error("the file is cut short or not safetensors ({0}): export it again")]
    Format(#[from] safetensors::SafeTensorError),
    /// The file is a pointer of Git LFS.
    #[error("the file is a pointer of Git LFS and not the weights: run `git lfs pull` in its repository")]
    LfsPointer,
    /// A tensor of the network is not in the file.
    #[error("tensor `{name}` is missing{}: {}", more(*others), explain(prefix.as_deref()))]
    Missing {
        /// First such tensor by name.
        name: String,
        /// Number of other missing tensors, as far as they were looked for.
        others: usize,
        /// The text before the names of all tensors of the file, if the tensor is there with it.
        prefix: Option<String>,
    },
    /// A tensor of the file is not in the network.
    #[error(
        "tensor `{name}` {found:?} has no place in the network{}: the weights belong to another network or \
         configuration",
        more(*others)
    )]
    Extra {
        /// First such tensor by name.
        name: String,
        /// Its shape in the file.
        found: Vec<usize>,
        /// Number of other such tensors.
        others: usize,
    },
    /// A tensor has another shape than in the network.
    #[error(
        "tensor `{name}` is {found:?}, expected {expected:?}: the configuration is not that of these weights"
    )]
    Shape {
        /// Name of the tensor.
        name: String,
        /// Its shape in the network.
        expected: Vec<usize>,
        /// Its shape in the file.
        found: Vec<usize>,
    },
    /// A tensor does not hold 32-bit floats.
    #[error("tensor `{name}` holds {found}, expected F32: convert it when exporting")]
    Type {
        /// Name of the tensor.
        name: String,
        /// Its element type.
        found: String,
    },
    /// A weight is NaN or infinite.
    #[error("tensor `{name}` holds {value} at {at}: the weights are damaged, or training diverged")]
    NotFinite {
        /// Name of the tensor.
        name: String,
        /// Index of the value, row by row.
        at: usize,
        /// The value.
        value: f32,
    },
    /// Two names of one tensor have different values.
    #[error(
        "tensors `{name}` and `{other}` should be identical but differ: the weights belong to another network"
    )]
    Twins {
        /// First name.
        name: String,
        /// Second name.
        other: String,
    },
    /// The network is of another kind.
    #[error(
        "the file holds a network of kind `{found}`, expected `{expected}`: \
         use it with the simulator that it was trained for"
    )]
    Kind {
        /// Its kind; empty if the file states none.
        found: String,
        /// The kind that is read.
        expected: &'static str,
    },
    /// The configuration in the file's metadata is missing or does not fit.
    #[error("the file's metadata has no usable `config`: {0}")]
    Config(String),
}

/// Returns the text about other tensors with the same fault.
fn more(others: usize) -> String {
    if others == 0 { String::new() } else { format!(", and {others} more") }
}

/// Returns why a tensor is missing.
fn explain(prefix: Option<&str>) -> String {
    match prefix {
        Some(prefix) => {
            format!("the names of all tensors begin with `{prefix}`: remove this prefix when exporting them")
        }
        None => "the weights belong to another network or configuration".to_owned(),
    }
}
