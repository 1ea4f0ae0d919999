//! The value of a metric in one scenario.

use serde::{Deserialize, Serialize};

/// A value with its components, so that "nothing evaluated" is never a zero. Files have the components in
/// their order: `{"rate":[1,4]}`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Score {
    /// `hits` of `valid`.
    #[serde(with = "pair")]
    Rate {
        /// Numerator.
        hits: u64,
        /// Denominator.
        valid: u64,
    },
    /// A count of agents.
    Count(u64),
    /// A mean of `n` values.
    #[serde(with = "pair")]
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

/// Two components as a list.
mod pair {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<A, B, S>(first: &A, second: &B, serializer: S) -> Result<S::Ok, S::Error>
    where
        A: Serialize,
        B: Serialize,
        S: Serializer,
    {
        (first, second).serialize(serializer)
    }

    pub(super) fn deserialize<'de, A, B, D>(deserializer: D) -> Result<(A, B), D::Error>
    where
        A: Deserialize<'de>,
        B: Deserialize<'de>,
        D: Deserializer<'de>,
    {
        Deserialize::deserialize(deserializer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_the_components() {
        for (score, expected) in [
            (Score::Rate { hits: 1, valid: 0 }, r#"{"rate":[1,0]}"#),
            (Score::Count(2), r#"{"count":2}"#),
            (Score::Mean { sum: 0.5, n: 3 }, r#"{"mean":[0.5,3]}"#),
            (Score::Value(0.1), r#"{"value":0.1}"#),
        ] {
            assert_eq!(serde_json::to_string(&score).unwrap(), expected);
            assert_eq!(serde_json::from_str::<Score>(expected).unwrap(), score);
        }
        assert!(serde_json::from_str::<Score>(r#"{"rate":[1]}"#).is_err());
    }
}
