//! Realism of generated scenarios: the same statistics for two sets of scenarios, compared.
//!
//! Every scenario is reduced to histograms with fixed [`Bins`] ([`Tally`]), so that sets of any size fit in
//! memory. Two sets are compared by the Jensen-Shannon divergence of their histograms ([`divergence`]).
//! Statistics cover the agents that take part (`start.agents`) over all 91 frames of the log; each
//! [`Quantity`] documents its definition and the vehicles that it covers.
//!
//! Recorded tracks are noisy at 10 Hz, generated ones are not. To keep noise from being measured as
//! driving, motion is fitted over one second in both sets (see the module `motion`). Maps differ as well:
//! recorded ones often lack neighbours, widths and speed limits, and their lanes overlap. Lanes are
//! therefore matched by geometry only (see the module `lanes`), and ambiguous cases are not counted.

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
