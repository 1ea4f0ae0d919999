//! What can be wrong with a file of weights.

/// Why weights are refused. Shapes are as in the file: linear weights are [out, in].
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// Cut short, or of another format.
    #[error("the file is cut short or not safetensors ({0}): export it again")]
    Format(#[from] safetensors::SafeTensorError),
    /// The network has tensors that the file lacks.
    #[error(
        "tensor `{name}` {expected:?} is missing, and {others} more: the weights are of another network or configuration"
    )]
    Missing {
        /// The first one by name.
        name: String,
        /// The shape that the network has.
        expected: Vec<usize>,
        /// How many are missing beside this one.
        others: usize,
    },
    /// The file has tensors that the network lacks.
    #[error(
        "tensor `{name}` {found:?} has no place in the network, and {others} more: the weights are of another network or configuration"
    )]
    Extra {
        /// The first one by name.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// How many have no place beside this one.
        others: usize,
    },
    /// A tensor has another shape than in the network.
    #[error(
        "tensor `{name}` is {found:?}, expected {expected:?}: the configuration is not the one of these weights"
    )]
    Shape {
        /// Which one.
        name: String,
        /// The shape that the network has.
        expected: Vec<usize>,
        /// The shape in the file.
        found: Vec<usize>,
    },
    /// A tensor does not hold 32-bit floats.
    #[error("tensor `{name}` holds {found}, expected F32: convert it when exporting")]
    Type {
        /// Which one.
        name: String,
        /// What it holds.
        found: String,
    },
    /// A weight is not a number or infinite.
    #[error("tensor `{name}` holds {value} at {at}: the weights are damaged, or training went astray")]
    NotFinite {
        /// Which one.
        name: String,
        /// Where, counted row by row.
        at: usize,
        /// What is there.
        value: f32,
    },
    /// Two names of one tensor, with different values.
    #[error("tensors `{name}` and `{other}` should be one and differ: the weights are of another network")]
    Twins {
        /// One of them.
        name: String,
        /// The other one.
        other: String,
    },
    /// The configuration in the file's metadata is missing or does not fit.
    #[error("the file's metadata hold no usable `config`: {0}")]
    Config(String),
}
