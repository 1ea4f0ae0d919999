//! Kinds of perceptrons. The public code has dropout after activations, which takes a number as well.

use reactsim_nn::{Activation, PerceptronKind};

/// Heads.
pub(super) const ELU: PerceptronKind =
    PerceptronKind { activation: Activation::Elu, linears: &["0", "3"], norms: &[] };
/// Feed-forward networks.
pub(super) const GELU: PerceptronKind =
    PerceptronKind { activation: Activation::Gelu, linears: &["0", "3"], norms: &[] };
