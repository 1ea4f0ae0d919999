//! How real generated scenarios are: the same statistics of two sets of scenarios, side by side.
//!
//! Every scenario is reduced to histograms with fixed [`Bins`] ([`Tally`]), so that sets of any size fit in memory, and two sets are
//! compared by the Jensen-Shannon divergence of the histograms ([`divergence`]). Statistics are taken of the agents that take part
//! (`start.agents`) over all 91 frames of the log; what each is, and which vehicles it is taken of, stands with its [`Quantity`].
//!
//! Recorded tracks are noisy at 10 Hz, generated ones are not. So that noise is not taken for driving, motion is fitted over a second
//! (see the module `motion`) in both sets alike. Maps differ as well: recorded ones often lack neighbours, widths and speed limits,
//! and their lanes overlap. What a lane is told by is geometry only (see the module `lanes`), and where it is not clear which lane
//! is meant, nothing is counted.

mod bins;
mod comparison;
mod divergence;
mod lane_changes;
mod lanes;
mod leader;
mod measure;
mod motion;
mod quantity;
mod set;

pub use bins::{Bins, Histogram};
pub use comparison::{Comparison, Row, Side, Spread};
pub use divergence::divergence;
pub use measure::{Tally, measure};
pub use quantity::{Quantity, Spec};
pub use set::Measured;
