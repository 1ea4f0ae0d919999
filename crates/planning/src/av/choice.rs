//! The planners of this crate, by name.

use crate::idm_planner::IdmPlanner;
use crate::pdm::PdmClosed;
use crate::planner::Planner;

/// A planner of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PlannerChoice {
    /// [`PdmClosed`].
    PdmClosed,
    /// [`IdmPlanner`].
    Idm,
}

impl PlannerChoice {
    /// All planners.
    pub const ALL: [Self; 2] = [Self::PdmClosed, Self::Idm];

    /// Returns the name used on the command line and in files.
    pub const fn id(self) -> &'static str {
        match self {
            Self::PdmClosed => "pdm-closed",
            Self::Idm => "idm",
        }
    }

    /// Returns the planner with this id.
    pub fn from_id(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|planner| planner.id() == id)
    }

    /// Creates a planner for one rollout.
    pub fn new_planner(self) -> Box<dyn Planner> {
        match self {
            Self::PdmClosed => Box::new(PdmClosed::new()),
            Self::Idm => Box::new(IdmPlanner::new()),
        }
    }

    /// Returns whether the planned states have poses, but no velocities.
    pub const fn plans_poses_only(self) -> bool {
        matches!(self, Self::PdmClosed)
    }
}
