//! A trajectory with the speeds and curvatures at which it is tracked.

use super::{HORIZON, Profile, Smoothing, Target};
use crate::trajectory::{Pose, STEP, Trajectory};

/// A trajectory with its profile.
#[derive(Clone, Debug)]
pub struct Reference<'a> {
    trajectory: &'a Trajectory,
    profile: Profile,
}

impl<'a> Reference<'a> {
    /// Fits the profile of a whole trajectory, resampled at intervals of [`STEP`].
    pub fn new(trajectory: &'a Trajectory) -> Self {
        Self { trajectory, profile: Profile::fit(&trajectory.resampled(), STEP, Smoothing::Jerk) }
    }

    /// Returns the speeds and curvatures of the resampled trajectory.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Returns the target of a command at a time in seconds. Speeds and curvatures are linear in time and
    /// constant beyond the ends of the profile.
    pub fn target(&self, time: f64) -> Target {
        let position = (time - self.trajectory.start()) / STEP;
        let curvature = |step: usize| sample(&self.profile.curvatures, position + step as f64);
        Target {
            pose: Pose::from(&self.trajectory.at(time)),
            speed: sample(&self.profile.speeds, position + HORIZON as f64),
            curvatures: std::array::from_fn(curvature),
        }
    }
}

/// Returns the value at a position in units of samples, linear between samples and constant beyond them;
/// 0 if there are no samples.
fn sample(values: &[f64], position: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let position = position.clamp(0.0, last as f64);
    let index = position as usize;
    let next = values[(index + 1).min(last)];
    values[index] + (next - values[index]) * (position - index as f64)
}
