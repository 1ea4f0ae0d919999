//! How plans ended: data, counted and reported.

use std::collections::BTreeMap;

use super::program::Solve;

/// How the plan of one vehicle came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ending {
    /// It stands and wants to stand: nothing was solved.
    Standing,
    /// Every program had its minimum inside all bounds: no solver was needed.
    ClosedForm,
    /// A solver was needed, and solved.
    Solved,
    /// A solver was needed, and ended at its reduced tolerance.
    AlmostSolved,
    /// A mode that is less probable was taken, since the most probable one is not kept clear.
    OtherMode,
    /// No mode is kept clear; the one that fails by the least was taken.
    HighSlack,
    /// Nothing else was left, or a solver failed: it brakes as hard as it can along the path.
    Braking,
    /// It goes backwards, or wants to: it follows its wish within the limits, without a program.
    Backwards,
}

impl Ending {
    /// All endings.
    pub const ALL: [Self; 8] = [
        Self::Standing,
        Self::ClosedForm,
        Self::Solved,
        Self::AlmostSolved,
        Self::OtherMode,
        Self::HighSlack,
        Self::Braking,
        Self::Backwards,
    ];

    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Standing => "qp-standing",
            Self::ClosedForm => "qp-closed-form",
            Self::Solved => "qp-solved",
            Self::AlmostSolved => "qp-almost-solved",
            Self::OtherMode => "qp-fallback-mode",
            Self::HighSlack => "qp-high-slack",
            Self::Braking => "qp-fallback-braking",
            Self::Backwards => "qp-backwards",
        }
    }

    pub(super) fn of(solve: Solve) -> Self {
        match solve {
            Solve::ClosedForm => Self::ClosedForm,
            Solve::Solved => Self::Solved,
            Solve::AlmostSolved => Self::AlmostSolved,
            Solve::Failed => Self::Braking,
        }
    }
}

/// How many plans ended how, and what the solver did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Endings {
    /// Plans by how they ended.
    pub plans: BTreeMap<Ending, u64>,
    /// Programs that were minimised, with a solver or without.
    pub programs: u64,
    /// Solves that the solver gave up, or found to have no solution.
    pub failed: u64,
    /// Solves by their number of iterations.
    pub iterations: BTreeMap<u32, u64>,
}

impl Endings {
    pub(super) fn count(&mut self, ending: Ending) {
        *self.plans.entry(ending).or_default() += 1;
    }

    /// Adds what is counted here to the outcomes of a rollout.
    pub fn report(&self, outcomes: &mut BTreeMap<&'static str, u64>) {
        for (ending, n) in &self.plans {
            *outcomes.entry(ending.name()).or_default() += n;
        }
        let solves: u64 = self.iterations.values().sum();
        let iterations: u64 = self.iterations.iter().map(|(i, n)| u64::from(*i) * n).sum();
        for (name, n) in
            [("qp-solves", solves), ("qp-iterations", iterations), ("qp-failed-solves", self.failed)]
        {
            if n > 0 {
                *outcomes.entry(name).or_default() += n;
            }
        }
    }
}
