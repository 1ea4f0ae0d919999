//! The documented variants of the metrics.

/// Variants of the definitions; the default is the benchmark's own. Printed in every result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Corner rounding of the boxes: 0.7, or 0 for sharp boxes.
    pub corner_rounding: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { corner_rounding: 0.7 }
    }
}
