//! The planners of this crate, by name.

use reactsim_scene::named_enum;

use crate::idm_planner::IdmPlanner;
use crate::pdm::PdmClosed;
use crate::planner::Planner;

named_enum! {
    id, from_id;

    /// A planner of this crate.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum PlannerChoice {
        /// [`PdmClosed`].
        PdmClosed = "pdm-closed",
        /// [`IdmPlanner`].
        Idm = "idm",
    }
}

impl PlannerChoice {
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
