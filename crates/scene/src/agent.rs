//! Agents and their states.

use std::fmt;

use reactsim_geometry::{OrientedBox, Vec2, direction, math};

use super::{DT, named_enum};

named_enum! {
    name, from_name;

    /// The class of an agent.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum AgentKind {
        /// Cars, trucks, buses and the AV.
        Vehicle = "vehicle",
        /// People on foot.
        Pedestrian = "pedestrian",
        /// People on bicycles.
        Cyclist = "cyclist",
        /// Anything else; static context that is never simulated or judged.
        Other = "other",
    }
}

impl fmt::Display for AgentKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The constant properties of an agent: identity, class and box size.
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

impl Agent {
    /// Returns whether its box has a positive length and width. An agent without an extent is not judged by
    /// the metrics and is nobody's obstacle.
    #[inline]
    pub fn has_extent(&self) -> bool {
        self.length > 0.0 && self.width > 0.0
    }
}

/// Pose and velocity of an agent at one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgentState {
    /// Box centre, metres, scenario frame (world axes, origin at the AV's current position).
    pub x: f64,
    /// Box centre, metres.
    pub y: f64,
    /// Heading, radians counter-clockwise from the x axis; need not be wrapped.
    pub heading: f64,
    /// Velocity along x, m/s; NaN if unknown.
    pub vx: f64,
    /// Velocity along y, m/s; NaN if unknown.
    pub vy: f64,
}

impl AgentState {
    /// Returns the box centre, metres.
    #[inline]
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x, self.y)
    }

    /// Returns the velocity in the scenario frame, m/s; `None` if unknown.
    #[inline]
    pub fn velocity(&self) -> Option<Vec2> {
        (self.vx.is_finite() && self.vy.is_finite()).then(|| Vec2::new(self.vx, self.vy))
    }

    /// Returns the state one frame later at constant velocity; a state of unknown velocity stays.
    pub fn coasted(self) -> Self {
        let velocity = self.velocity().unwrap_or_default();
        let p = self.position() + velocity * DT;
        Self { x: p.x, y: p.y, vx: velocity.x, vy: velocity.y, ..self }
    }

    /// Returns the magnitude of the velocity, m/s; NaN if unknown.
    #[inline]
    pub fn speed(&self) -> f64 {
        math::hypot(self.vx, self.vy)
    }

    /// Returns the velocity along the heading, m/s, negative in reverse; 0 if unknown.
    #[inline]
    pub fn forward_speed(&self) -> f64 {
        self.velocity().map_or(0.0, |v| v.dot(&direction(self.heading)))
    }

    /// Returns the box of `agent` in this state.
    #[inline]
    pub fn footprint(&self, agent: &Agent) -> OrientedBox {
        OrientedBox::new(self.position(), self.heading, agent.length, agent.width)
    }

    /// Returns whether position and heading are finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.heading.is_finite()
    }
}

/// One frame of a track: the state, or `None` if the agent is absent (invalid). Absent agents collide with
/// nothing.
pub type Frame = Option<AgentState>;

/// An agent with its recorded track over all frames.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedAgent {
    /// The agent.
    pub agent: Agent,
    /// One entry per frame (91).
    pub track: Vec<Frame>,
    /// Height of the bottom of the box at each frame, metres, if known; empty if it is known at none.
    pub heights: Vec<Option<f64>>,
}
