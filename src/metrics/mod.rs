//! The metrics of the benchmark: what a finished rollout is worth. Knows maps, tracks and numbers; never simulators.

mod case;
mod event;
mod options;
mod score;
mod spec;

pub use case::{Case, Object};
pub use event::Event;
pub use options::Options;
pub use score::Score;
pub use spec::{Metric, MetricSpec, Unit};
