//! Agreement of the rollouts of two backends.

use crate::rollout::Rollout;
use crate::scene::{CURRENT, Frame};

/// Distance in metres below which positions count as equal: sums in another order differ by far less, another
/// token by far more.
const SAME_POSITION: f64 = 1e-3;
/// Steps of the first plan, at 2 Hz.
const FIRST_PLAN: usize = 5;

/// Agreement of the positions of all agents except the AV, over the steps of rollouts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Agreement {
    positions: usize,
    equal_positions: usize,
    agents: usize,
    equal_agents: usize,
    /// Largest distance during the first plan, metres.
    first_plan: f64,
    /// Largest distance, metres.
    largest: f64,
}

impl Agreement {
    /// Compares rollouts of the same episodes.
    pub(super) fn of(reference: &[Rollout], others: &[Rollout]) -> Self {
        let mut agreement = Self::default();
        for (a, b) in reference.iter().zip(others) {
            // Slot 0 is the AV, which follows its record.
            for (a, b) in a.tracks.iter().zip(&b.tracks).skip(1) {
                agreement.add(a, b);
            }
        }
        agreement
    }

    fn add(&mut self, a: &[Frame], b: &[Frame]) {
        let (mut present, mut equal) = (0, 0);
        for (step, (a, b)) in a.iter().zip(b).skip(CURRENT + 1).enumerate() {
            let distance = match (a, b) {
                (Some(a), Some(b)) => (a.position() - b.position()).norm(),
                (None, None) => continue,
                // Absent in one of them.
                _ => f64::INFINITY,
            };
            present += 1;
            equal += usize::from(distance < SAME_POSITION);
            self.largest = self.largest.max(distance);
            if step < FIRST_PLAN {
                self.first_plan = self.first_plan.max(distance);
            }
        }
        self.positions += present;
        self.equal_positions += equal;
        self.agents += usize::from(present > 0);
        self.equal_agents += usize::from(present > 0 && equal == present);
    }

    /// Returns the share of equal positions.
    pub(super) fn positions(&self) -> f64 {
        self.equal_positions as f64 / self.positions as f64
    }

    /// Returns the last cells of a row of the table.
    pub(super) fn cells(&self) -> String {
        let agents = 100.0 * self.equal_agents as f64 / self.agents as f64;
        let positions = 100.0 * self.positions();
        format!(" {positions:.3} % | {agents:.2} % | {:.1e} | {:.1e} |", self.first_plan, self.largest)
    }
}
