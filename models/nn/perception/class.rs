//! Classes of simulated agents.

use std::fmt;

use reactsim_scene::AgentKind;
use serde::{Deserialize, Serialize};

/// A class of simulated agents.
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
}

impl fmt::Display for Class {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
