//! The realism metrics of the Waymo Open Sim Agents Challenge (WOSAC): likelihoods of the log under the
//! distributions of features in the rollouts of a simulator.
//!
//! Results agree with the official code to 1e-6, in the configurations of the challenges of 2025 and 2024 and
//! of 2023. Start with [`Scorer`]. Only what is rounded visibly is computed in single precision as there: box
//! corners, speeds and accelerations, limits of histograms. Searches are pruned by bounds that cannot change
//! a result.

mod config;
mod displacement;
mod edge_cells;
mod edge_segments;
mod error;
mod feature;
mod footprint;
mod gap;
mod histogram;
mod kinematics;
mod masks;
mod nearest_object;
mod objects;
mod result;
mod road_edges;
mod scorer;
mod steps;
mod tally;
mod time_to_collision;
mod traffic_lights;

pub use config::{Bins, CodeVersion, Config, Estimator};
pub use error::WosacError;
pub use feature::{Bucket, Feature};
pub use result::{MeanMetrics, RolloutShare, WosacMetrics};
pub use scorer::Scorer;
pub use steps::{Stage, StepFeatures};

#[cfg(test)]
mod tests;
