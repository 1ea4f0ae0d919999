//! Agents and their states.

use std::fmt;

use crate::geometry::{OrientedBox, Vec2, direction, math};

/// The class of an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum AgentKind {
    /// Cars, trucks, buses and the AV.
    Vehicle,
    /// People on foot.
    Pedestrian,
    /// People on bicycles.
    Cyclist,
    /// Anything else; static context, never simulated or judged.
    Other,
}

impl AgentKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Vehicle, Self::Pedestrian, Self::Cyclist, Self::Other];

    /// The name in files: `vehicle`, `pedestrian`, `cyclist` or `other`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vehicle => "vehicle",
            Self::Pedestrian => "pedestrian",
            Self::Cyclist => "cyclist",
            Self::Other => "other",
        }
    }

    /// The kind with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.name() == name)
    }
}

impl fmt::Display for AgentKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What of an agent does not change: identity, class and box.
#[derive(Clone, Debug, PartialEq)]
pub struct Agent {
    /// Name, unique in the scenario.
    pub id: String,
    /// Class.
    pub kind: AgentKind,
    /// Extent along the heading, metres.
    pub length: f64,
    /// Extent across the heading, metres.
    pub width: f64,
}

/// Where an agent is and how it moves, at one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgentState {
    /// Box centre, metres, scenario frame (world axes, origin at the AV's current position).
    pub x: f64,
    /// Box centre, metres.
    pub y: f64,
    /// Heading, radians counter-clockwise from the x axis; need not be wrapped.
    pub heading: f64,
    /// Velocity along x, m/s; NaN where unknown.
    pub vx: f64,
    /// Velocity along y, m/s; NaN where unknown.
    pub vy: f64,
}

impl AgentState {
    /// Box centre.
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x, self.y)
    }

    /// Velocity in the scenario frame, m/s; `None` where unknown.
    pub fn velocity(&self) -> Option<Vec2> {
        (self.vx.is_finite() && self.vy.is_finite()).then(|| Vec2::new(self.vx, self.vy))
    }

    /// Magnitude of the velocity, m/s; NaN where unknown.
    pub fn speed(&self) -> f64 {
        math::hypot(self.vx, self.vy)
    }

    /// Velocity along the heading, m/s, negative in reverse; 0 where unknown.
    pub fn forward_speed(&self) -> f64 {
        self.velocity().map_or(0.0, |v| v.dot(&direction(self.heading)))
    }

    /// The box of an agent of this size at this state.
    pub fn footprint(&self, agent: &Agent) -> OrientedBox {
        OrientedBox::new(self.position(), self.heading, agent.length, agent.width)
    }

    /// Whether position and heading are finite.
    pub fn is_finite(&self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.heading.is_finite()
    }
}

/// One frame of a track: the state, or `None` where the agent is absent (invalid). Absent agents collide with nobody.
pub type Frame = Option<AgentState>;

/// An agent with its recorded track over all frames.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedAgent {
    /// The agent.
    pub agent: Agent,
    /// One entry per frame (91).
    pub track: Vec<Frame>,
}
