//! Agent classes, each with its own vocabulary.

use std::fmt;

use reactsim::dynamics::Pose;
use reactsim::geometry::{Vec2, direction, left};
use reactsim::scene::AgentKind;
use serde::{Deserialize, Serialize};

/// A class of agents that move by tokens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Class {
    /// Cars, trucks, buses and the AV.
    Vehicle,
    /// People on foot.
    Pedestrian,
    /// People on bicycles.
    Cyclist,
}

impl Class {
    /// All classes, in the order of their indices.
    pub const ALL: [Self; 3] = [Self::Vehicle, Self::Pedestrian, Self::Cyclist];

    /// Returns the class of agents of this kind; `None` for kind `other`.
    pub const fn of(kind: AgentKind) -> Option<Self> {
        match kind {
            AgentKind::Vehicle => Some(Self::Vehicle),
            AgentKind::Pedestrian => Some(Self::Pedestrian),
            AgentKind::Cyclist => Some(Self::Cyclist),
            AgentKind::Other => None,
        }
    }

    /// Returns its index in [`Class::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Vehicle => "vehicle",
            Self::Pedestrian => "pedestrian",
            Self::Cyclist => "cyclist",
        }
    }

    /// Returns length and width in metres of the box that represents all agents of the class when
    /// motions are compared (SMART, CATK). The distance between its corners weighs position against
    /// heading.
    pub const fn matching_box(self) -> (f64, f64) {
        match self {
            Self::Vehicle => (4.8, 2.0),
            Self::Pedestrian => (1.0, 1.0),
            Self::Cyclist => (2.0, 1.0),
        }
    }

    /// Returns the corners of the matching box at a pose: left front, right front, right back, left
    /// back.
    pub fn contour(self, pose: Pose) -> [Vec2; 4] {
        let (length, width) = self.matching_box();
        let ahead = direction(pose.heading);
        let (along, across) = (ahead * (0.5 * length), left(ahead) * (0.5 * width));
        let p = pose.position;
        [p + along + across, p + along - across, p - along - across, p - along + across]
    }
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
