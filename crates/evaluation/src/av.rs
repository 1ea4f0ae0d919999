//! The AV policy of a run.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use reactsim_rollout::{ParseScriptError, Script};

/// The choices, for help and error texts.
pub const AV_CHOICES: &str = "deviated, log, deviated-or-log, constant-velocity, brake:<m/s²>, \
                              retime:<factor>, shift:<m> or file:<path>";

/// The AV policy in the reactive protocol.
#[derive(Clone, Debug, PartialEq)]
pub enum AvChoice {
    /// The deviated trajectory that comes with the scenario or in a file of deviations.
    Deviated,
    /// The logged AV.
    Log,
    /// The deviated AV of the scenarios that have one, the logged AV of the others.
    DeviatedOrLog,
    /// A script.
    Scripted(Script),
    /// Deviated trajectories from this file.
    File(PathBuf),
}

/// The reason why a text does not name an AV policy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseAvError {
    /// There is no such policy.
    #[error("`{0}` is not an AV policy: choose {AV_CHOICES}")]
    Unknown(String),
    /// The parameter of a script is missing or out of range.
    #[error(transparent)]
    Script(ParseScriptError),
    /// The file name is missing.
    #[error("`file:` names no file: write `file:<path>`")]
    NoFile,
}

impl AvChoice {
    /// Returns whether the AV follows the deviated trajectories of scenarios that have one.
    pub const fn follows_deviations(&self) -> bool {
        matches!(self, Self::Deviated | Self::DeviatedOrLog | Self::File(_))
    }
}

impl FromStr for AvChoice {
    type Err = ParseAvError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "deviated" => Ok(Self::Deviated),
            "log" => Ok(Self::Log),
            "deviated-or-log" => Ok(Self::DeviatedOrLog),
            _ => match text.strip_prefix("file:") {
                Some("") => Err(ParseAvError::NoFile),
                Some(path) => Ok(Self::File(path.into())),
                None => text.parse().map(Self::Scripted).map_err(|error| match error {
                    ParseScriptError::Unknown(text) => ParseAvError::Unknown(text),
                    error => ParseAvError::Script(error),
                }),
            },
        }
    }
}

impl fmt::Display for AvChoice {
    /// Writes the name used in files. The provenance identifies a file of deviations by its digest, not by
    /// its path.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Deviated | Self::File(_) => f.write_str("deviated"),
            Self::Log => f.write_str("log"),
            Self::DeviatedOrLog => f.write_str("deviated-or-log"),
            Self::Scripted(script) => script.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        let scripts = ["constant-velocity", "brake:4", "retime:1.6", "shift:-2"];
        for text in ["deviated", "log", "deviated-or-log"].into_iter().chain(scripts) {
            assert_eq!(text.parse::<AvChoice>().unwrap().to_string(), text);
        }
        assert_eq!("file:a/b:c.parquet".parse(), Ok(AvChoice::File("a/b:c.parquet".into())));
    }

    #[test]
    fn errors_name_the_fix() {
        let text = |t: &str| t.parse::<AvChoice>().unwrap_err().to_string();
        assert!(text("brake").contains("above 0 and at most 6 m/s²"));
        assert!(text("shift:inf").contains("from -5 to 5 m"));
        insta::assert_snapshot!(text("file:"), @"`file:` names no file: write `file:<path>`");
        assert!(text("swerve").contains("choose deviated, log"));
    }
}
