//! Statistics of batch norms, collected in the forward passes of a training.

use std::cell::RefCell;

use burn::tensor::Tensor;

/// Means and variances of a forward pass, by which batch norms normalise, and from which they follow the
/// running ones.
///
/// The learner moves parameters named `running_mean` and `running_var` towards their gradient. So for each of
/// them a term whose gradient is the observed value, and whose own value is 0, is added to the loss.
pub(crate) struct Observed(Option<RefCell<Vec<Tensor<1>>>>);

impl Observed {
    /// For simulation and validation: norms use their running means and variances.
    pub(crate) const fn none() -> Self {
        Self(None)
    }

    /// For training: norms use the means and variances of the rows that they get.
    pub(crate) const fn training() -> Self {
        Self(Some(RefCell::new(Vec::new())))
    }

    /// Returns whether norms use the means and variances of their rows.
    pub(super) const fn is_training(&self) -> bool {
        self.0.is_some()
    }

    /// Notes the value, `[width]`, that a running one, `[width]`, is to follow.
    pub(super) fn note(&self, running: Tensor<1>, value: Tensor<1>) {
        if let Some(terms) = &self.0 {
            let term = (running * value.detach()).sum();
            terms.borrow_mut().push(term.clone() - term.detach());
        }
    }

    /// Returns the sum of all terms; `None` if there are none.
    pub(crate) fn total(self) -> Option<Tensor<1>> {
        self.0?.into_inner().into_iter().reduce(|sum, term| sum + term)
    }
}
