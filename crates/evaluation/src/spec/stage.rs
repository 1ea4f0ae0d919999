//! The stage behind simulators.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use reactsim_qp::Smoothing;

/// Name of no stage.
const OFF: &str = "off";

/// A stage behind simulators, or none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stage(pub Option<Smoothing>);

impl FromStr for Stage {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        if name == OFF {
            return Ok(Self(None));
        }
        let all = || Smoothing::ALL.map(Smoothing::name).join(", ");
        let stage = Smoothing::from_name(name).ok_or_else(|| format!("expected {} or {OFF}", all()))?;
        Ok(Self(Some(stage)))
    }
}

impl Display for Stage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.map_or(OFF, Smoothing::name))
    }
}
