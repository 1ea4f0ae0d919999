//! Which AV a run has.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use crate::rollout::Script;

/// Hardest braking of a scripted AV, m/s².
const HARDEST_BRAKE: f64 = 8.0;
/// Largest factor between the speed of a scripted AV and the logged one.
const FASTEST_RETIME: f64 = 3.0;
/// Farthest that a scripted AV moves sideways, metres.
const FARTHEST_SHIFT: f64 = 5.0;

/// The choices, as help and error texts name them.
pub const AV_CHOICES: &str =
    "deviated, log, constant-velocity, brake:<m/s²>, retime:<factor>, shift:<m> or file:<path>";

/// Who moves the AV in the reactive protocol.
#[derive(Clone, Debug, PartialEq)]
pub enum AvChoice {
    /// The deviated trajectory that comes with the scenario or in a file of deviations.
    Deviated,
    /// The logged AV.
    Log,
    /// A script.
    Scripted(Script),
    /// Deviated trajectories from this file.
    File(PathBuf),
}

/// Why a text names no AV.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParseAvError {
    /// There is no such policy.
    #[error("`{0}` is no AV policy: choose {AV_CHOICES}")]
    Unknown(String),
    /// The parameter is missing or no number.
    #[error("`{text}`: expected a number after `{name}:`, such as `{example}`")]
    NoNumber {
        /// The text.
        text: String,
        /// The policy.
        name: &'static str,
        /// A text that would do.
        example: &'static str,
    },
    /// The parameter is out of range.
    #[error("`{text}`: {value} is out of range, expected {range}")]
    Range {
        /// The text.
        text: String,
        /// The number found.
        value: f64,
        /// The range.
        range: &'static str,
    },
    /// The file is not named.
    #[error("`file:` names no file: write `file:<path>`")]
    NoFile,
}

impl FromStr for AvChoice {
    type Err = ParseAvError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, value) = match text.split_once(':') {
            Some((name, value)) => (name, Some(value)),
            None => (text, None),
        };
        let number = |name, example| {
            let parsed = value.and_then(|v| v.trim().parse::<f64>().ok());
            parsed.ok_or_else(|| ParseAvError::NoNumber { text: text.to_owned(), name, example })
        };
        let check = |value: f64, holds: bool, range| {
            let refuse = || ParseAvError::Range { text: text.to_owned(), value, range };
            if holds { Ok(value) } else { Err(refuse()) }
        };
        match (name, value) {
            ("deviated", None) => Ok(Self::Deviated),
            ("log", None) => Ok(Self::Log),
            ("constant-velocity", None) => Ok(Self::Scripted(Script::ConstantVelocity)),
            ("brake", _) => {
                let v = number("brake", "brake:4")?;
                let v = check(v, v > 0.0 && v <= HARDEST_BRAKE, "above 0 and at most 8 m/s²")?;
                Ok(Self::Scripted(Script::Brake(v)))
            }
            ("retime", _) => {
                let v = number("retime", "retime:1.6")?;
                let v = check(v, v > 0.0 && v <= FASTEST_RETIME, "above 0 and at most 3")?;
                Ok(Self::Scripted(Script::Retime(v)))
            }
            ("shift", _) => {
                let v = number("shift", "shift:2")?;
                let v = check(v, v.abs() <= FARTHEST_SHIFT, "-5 to 5 m (left positive)")?;
                Ok(Self::Scripted(Script::Shift(v)))
            }
            ("file", Some(path)) if !path.is_empty() => Ok(Self::File(path.into())),
            ("file", _) => Err(ParseAvError::NoFile),
            _ => Err(ParseAvError::Unknown(text.to_owned())),
        }
    }
}

impl fmt::Display for AvChoice {
    /// The name in files. A file of deviations is named by its digest in the provenance, not by its path.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Deviated | Self::File(_) => f.write_str("deviated"),
            Self::Log => f.write_str("log"),
            Self::Scripted(Script::ConstantVelocity) => f.write_str("constant-velocity"),
            Self::Scripted(Script::Brake(v)) => write!(f, "brake:{v}"),
            Self::Scripted(Script::Retime(v)) => write!(f, "retime:{v}"),
            Self::Scripted(Script::Shift(v)) => write!(f, "shift:{v}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back() {
        for text in ["deviated", "log", "constant-velocity", "brake:4", "retime:1.6", "shift:-2"] {
            assert_eq!(text.parse::<AvChoice>().unwrap().to_string(), text);
        }
        assert_eq!("file:a/b:c.parquet".parse(), Ok(AvChoice::File("a/b:c.parquet".into())));
    }

    #[test]
    fn refusals_name_the_mend() {
        let text = |t: &str| t.parse::<AvChoice>().unwrap_err().to_string();
        insta::assert_snapshot!(text("brake"), @"`brake`: expected a number after `brake:`, such as `brake:4`");
        insta::assert_snapshot!(text("brake:9"), @"`brake:9`: 9 is out of range, expected above 0 and at most 8 m/s²");
        insta::assert_snapshot!(text("retime:nan"), @"`retime:nan`: NaN is out of range, expected above 0 and at most 3");
        insta::assert_snapshot!(text("shift:inf"), @"`shift:inf`: inf is out of range, expected -5 to 5 m (left positive)");
        insta::assert_snapshot!(text("file:"), @"`file:` names no file: write `file:<path>`");
        assert!(text("swerve").contains("choose deviated, log"));
    }
}
