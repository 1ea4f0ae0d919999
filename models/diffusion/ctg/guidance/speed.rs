//! Keeping the speed limit.

use super::{Cost, Motion, RuleScene};

/// Adds the difference of each speed above the limit of the lane where the agent will be, m/s.
pub(super) fn add(scene: &RuleScene<'_>, motion: &[Motion], cost: &mut Cost) {
    for (state, gradient) in motion.iter().zip(&mut cost.gradient) {
        let Some(limit) = scene.ground.speed_limit(state.at) else { continue };
        let speed = state.velocity.norm();
        if speed > limit {
            cost.value += scene.rules.speed * (speed - limit);
            gradient.velocity += state.velocity / speed * scene.rules.speed;
        }
    }
}
