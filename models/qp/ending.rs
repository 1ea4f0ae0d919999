//! Outcomes of plans, counted and reported.

use std::collections::BTreeMap;

use reactsim_scene::named_enum;

use super::program::Solve;

named_enum! {
    name;

    /// Outcome of the plan of one vehicle.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Ending {
        /// The vehicle stands and its most probable mode stays there: nothing was solved.
        Standing = "qp-standing",
        /// Every program had its unconstrained minimum within all bounds: the solver was not needed.
        ClosedForm = "qp-closed-form",
        /// The solver was needed, and solved to its full tolerance.
        Solved = "qp-solved",
        /// The solver was needed, and stopped at its reduced tolerance.
        AlmostSolved = "qp-almost-solved",
        /// A less probable mode was chosen: the most probable one could not be kept clear.
        OtherMode = "qp-fallback-mode",
        /// No mode could be kept clear; the one with the smallest violation was chosen.
        HighSlack = "qp-high-slack",
        /// No mode was usable, the solver failed, or braking violates less: the vehicle brakes as hard as
        /// it can along the path.
        Braking = "qp-fallback-braking",
        /// The proposed motion is executed as it is: it leaves a safe way out.
        AsProposed = "qp-as-proposed",
        /// The vehicle reverses or its mode leads backwards: it follows the mode within the limits, without
        /// a program.
        Backwards = "qp-backwards",
    }
}

impl Ending {
    pub(super) fn of(solve: Solve) -> Self {
        match solve {
            Solve::ClosedForm => Self::ClosedForm,
            Solve::Solved => Self::Solved,
            Solve::AlmostSolved => Self::AlmostSolved,
            Solve::Failed => Self::Braking,
        }
    }
}

/// Outcome that counts programs that the solver gave up or found infeasible.
pub const FAILED_SOLVES: &str = "qp-failed-solves";

/// Counts of plan outcomes and of solver statistics.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Endings {
    /// Plans by outcome.
    pub plans: BTreeMap<Ending, u64>,
    /// Programs minimised, with or without the solver.
    pub programs: u64,
    /// Solves that the solver gave up or found infeasible.
    pub failed: u64,
    /// Solves by their number of iterations.
    pub iterations: BTreeMap<u32, u64>,
}

impl Endings {
    pub(super) fn count(&mut self, ending: Ending) {
        *self.plans.entry(ending).or_default() += 1;
    }

    /// Adds these counts to the outcomes of a rollout.
    pub fn report(&self, outcomes: &mut BTreeMap<&'static str, u64>) {
        for (ending, n) in &self.plans {
            *outcomes.entry(ending.name()).or_default() += n;
        }
        let solves: u64 = self.iterations.values().sum();
        let iterations: u64 = self.iterations.iter().map(|(i, n)| u64::from(*i) * n).sum();
        for (name, n) in [("qp-solves", solves), ("qp-iterations", iterations), (FAILED_SOLVES, self.failed)]
        {
            if n > 0 {
                *outcomes.entry(name).or_default() += n;
            }
        }
    }
}
