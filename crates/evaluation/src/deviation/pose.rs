//! The point of an agent whose poses are given.

use std::fmt;
use std::str::FromStr;

use reactsim_geometry::{direction, left};
use reactsim_scene::{Agent, AgentKind, AgentState};

/// Distances of a rear axle from the box centre that a value may state, metres.
const DISTANCES: std::ops::RangeInclusive<f64> = 0.0..=10.0;
/// Largest distance of the rear axle from the box centre, as a share of the length.
const MOST_OF_LENGTH: f64 = 0.5;
/// Largest distance of a rear axle from the centre line of its box, metres: more than rounding.
const SIDEWAYS: f64 = 0.05;

/// The point of vehicles whose poses are given.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Pose {
    /// The centre of the box.
    #[default]
    Centre,
    /// The rear axle, this far behind the centre.
    RearAxle(AxleDistance),
}

/// Distance of the rear axle of a vehicle from its box centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AxleDistance {
    /// The distance that the given state at the current frame has from the recorded one.
    Entry0,
    /// Metres, for all vehicles.
    Metres(f64),
    /// Percent of the length.
    Percent(f64),
}

impl Pose {
    /// Converts the given states of an agent to box centres. `entry0`: the given and the recorded state at
    /// the current frame, if the given motion has one.
    ///
    /// # Errors
    /// A text if the distance is to come from entry 0, and there is none or it is not behind the centre.
    pub(crate) fn to_centre<'a>(
        self,
        agent: &Agent,
        entry0: Option<(AgentState, AgentState)>,
        states: impl Iterator<Item = &'a mut AgentState>,
    ) -> Result<(), String> {
        let Self::RearAxle(distance) = self else { return Ok(()) };
        if agent.kind != AgentKind::Vehicle {
            return Ok(());
        }
        let distance = match distance {
            AxleDistance::Metres(metres) => metres,
            AxleDistance::Percent(percent) => 0.01 * percent * agent.length,
            AxleDistance::Entry0 => of_entry0(agent, entry0)?,
        };
        for state in states {
            let by = direction(state.heading) * distance;
            (state.x, state.y) = (state.x + by.x, state.y + by.y);
            // Velocities of the axle are not those of the centre; differences of positions are.
            (state.vx, state.vy) = (f64::NAN, f64::NAN);
        }
        Ok(())
    }
}

fn of_entry0(agent: &Agent, entry0: Option<(AgentState, AgentState)>) -> Result<f64, String> {
    let id = &agent.id;
    let Some((given, recorded)) = entry0 else {
        return Err(format!(
            "`pose` rear-axle takes the distance from the state at the current frame (entry 0 of 81), which \
             agent `{id}` has not: give it, as in rear-axle=1.461 (metres) or rear-axle=28% (of the length)"
        ));
    };
    let by = recorded.position() - given.position();
    let ahead = direction(recorded.heading);
    let (along, aside) = (by.dot(&ahead), by.dot(&left(ahead)));
    if !(0.0..=MOST_OF_LENGTH * agent.length).contains(&along) || aside.abs() > SIDEWAYS {
        return Err(format!(
            "`pose` rear-axle: entry 0 of agent `{id}` is {along:.2} m behind and {:.2} m beside the box centre at \
             the current frame, which is no rear axle: give box centres, or the distance",
            aside.abs()
        ));
    }
    Ok(along)
}

/// The poses, for error texts.
const POSES: &str = "expected centre, rear-axle, rear-axle=METRES (0 to 10) or rear-axle=SHARE% (0 to 50)";

impl FromStr for Pose {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Some(rest) = text.strip_prefix("rear-axle") else {
            return if text == "centre" { Ok(Self::Centre) } else { Err(POSES) };
        };
        if rest.is_empty() {
            return Ok(Self::RearAxle(AxleDistance::Entry0));
        }
        let value = rest.strip_prefix('=').ok_or(POSES)?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| POSES);
        let (distance, is_possible) = match value.strip_suffix('%') {
            Some(percent) => {
                let percent = number(percent)?;
                (AxleDistance::Percent(percent), (0.0..=100.0 * MOST_OF_LENGTH).contains(&percent))
            }
            None => {
                let metres = number(value)?;
                (AxleDistance::Metres(metres), DISTANCES.contains(&metres))
            }
        };
        if is_possible { Ok(Self::RearAxle(distance)) } else { Err(POSES) }
    }
}

impl fmt::Display for Pose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Centre => f.write_str("centre"),
            Self::RearAxle(AxleDistance::Entry0) => f.write_str("rear-axle"),
            Self::RearAxle(AxleDistance::Metres(metres)) => write!(f, "rear-axle={metres}"),
            Self::RearAxle(AxleDistance::Percent(percent)) => write!(f, "rear-axle={percent}%"),
        }
    }
}
