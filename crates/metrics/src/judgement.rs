//! Intermediate results that several metrics share.

use std::any::Any;

use super::Case;

/// An intermediate result of a case, such as the first contacts with the AV. It is computed once per case,
/// whichever metrics use it.
pub trait Judgement: Any + Send + Sync {
    /// Computes the result.
    fn compute(case: &Case<'_>) -> Self;
}

impl Case<'_> {
    /// Returns a judgement of this case; computes it at the first call.
    pub fn judgement<J: Judgement>(&self) -> &J {
        self.cache.get_or_compute(|| J::compute(self))
    }
}
