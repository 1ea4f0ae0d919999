//! Settings of the protocol.

use std::fmt;
use std::str::FromStr;

use reactsim_scene::{FUTURE, named_enum};

use super::entering::Entering;

named_enum! {
    name, from_name;

    /// The two protocols of the benchmark.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Protocol {
        /// Algorithm 1: the AV is an external input.
        Reactive = "reactive",
        /// Algorithm 2: the simulator moves the AV too.
        Realism = "realism",
    }
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Protocol {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::from_name(name).ok_or_else(|| "expected reactive or realism".to_owned())
    }
}

/// Number of steps between two plans of a simulator, or of a planner of the AV.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Replan {
    steps: usize,
}

/// Error for a text that is not a replan interval.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{text}` is not a replan interval: expected 1 to 80 steps, such as `5steps`, or a rate, such as `2hz`{}",
    self.hint()
)]
pub struct ParseReplanError {
    text: String,
    /// The nearest interval to a number that is none, steps.
    nearest: Option<usize>,
}

impl ParseReplanError {
    fn hint(&self) -> String {
        self.nearest.map_or_else(String::new, |steps| format!("; the nearest is `{steps}steps`"))
    }
}

impl Replan {
    /// A plan at every step.
    pub const EVERY_STEP: Self = Self { steps: 1 };

    /// Creates a replan interval of 1 to 80 steps; `None` outside this range.
    pub fn every(steps: usize) -> Option<Self> {
        (1..=FUTURE).contains(&steps).then_some(Self { steps })
    }

    /// Returns the number of steps between two plans.
    pub const fn steps(self) -> usize {
        self.steps
    }
}

impl Default for Replan {
    /// 2 Hz, as in the paper's main table.
    fn default() -> Self {
        Self { steps: 5 }
    }
}

impl fmt::Display for Replan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}steps", self.steps)
    }
}

impl FromStr for Replan {
    type Err = ParseReplanError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let refuse = |nearest| ParseReplanError { text: text.to_owned(), nearest };
        let lower = text.trim().to_ascii_lowercase();
        let steps = if let Some(rate) = lower.strip_suffix("hz") {
            10.0 / rate.trim().parse::<f64>().map_err(|_| refuse(None))?
        } else {
            let digits = lower.strip_suffix("steps").or_else(|| lower.strip_suffix("step")).unwrap_or(&lower);
            digits.trim().parse::<u64>().map_err(|_| refuse(None))? as f64
        };
        if steps.is_nan() || steps < 0.0 {
            return Err(refuse(None));
        }
        let nearest = steps.round().clamp(1.0, FUTURE as f64);
        let is_one = (steps - nearest).abs() < 1e-9;
        Some(Self { steps: nearest as usize })
            .filter(|_| is_one)
            .ok_or_else(|| refuse(Some(nearest as usize)))
    }
}

/// Settings of a rollout other than the scenario, the simulator and the AV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The protocol.
    pub protocol: Protocol,
    /// Replan interval.
    pub replan: Replan,
    /// Whether agents at t+1 see the AV at t+1 (Algorithm 1) or only up to t (the formula of section
    /// 3.1).
    pub av_lookahead: bool,
    /// Whether agents of the log that appear later enter.
    pub entering: Entering,
    /// Seed of all random streams.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            protocol: Protocol::Reactive,
            replan: Replan::default(),
            av_lookahead: true,
            entering: Entering::Off,
            seed: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_rates_and_steps() {
        assert_eq!("2hz".parse::<Replan>().unwrap().steps(), 5);
        assert_eq!("10Hz".parse::<Replan>().unwrap().steps(), 1);
        assert_eq!("0.125hz".parse::<Replan>().unwrap().steps(), 80);
        assert_eq!("7steps".parse::<Replan>().unwrap().steps(), 7);
        for bad in ["3hz", "0", "81", "-2hz", "nanhz", "fast", "", "0hz"] {
            assert!(bad.parse::<Replan>().is_err(), "{bad}");
        }
    }
}
