//! The value of a metric in one scenario.

/// A value with its components, so that "nothing evaluated" is never a zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Score {
    /// `hits` of `valid`.
    Rate {
        /// Numerator.
        hits: u64,
        /// Denominator.
        valid: u64,
    },
    /// A count of agents.
    Count(u64),
    /// A mean of `n` values.
    Mean {
        /// Their sum.
        sum: f64,
        /// Their number.
        n: u64,
    },
    /// A value that is not a ratio of counts (a likelihood).
    Value(f64),
}

impl Score {
    /// Returns the number, or `None` if the denominator is 0.
    pub fn value(self) -> Option<f64> {
        match self {
            Self::Rate { valid: 0, .. } | Self::Mean { n: 0, .. } => None,
            Self::Rate { hits, valid } => Some(hits as f64 / valid as f64),
            Self::Count(n) => Some(n as f64),
            Self::Mean { sum, n } => Some(sum / n as f64),
            Self::Value(v) => Some(v),
        }
    }
}
