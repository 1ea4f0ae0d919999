//! Staying on the drivable area: agents that were on it return.

use reactsim_geometry::{Vec2, direction, left};

use super::{Cost, Motion, RuleAgent, RuleScene};

/// Adds the distances of the corners of the box from the drivable area, metres.
pub(super) fn add(scene: &RuleScene<'_>, agent: &RuleAgent, motion: &[Motion], cost: &mut Cost) {
    let [length, width] = agent.size;
    for (state, gradient) in motion.iter().zip(&mut cost.gradient) {
        let axis = direction(state.heading);
        for (along, aside) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let (along, aside) = (0.5 * length * along, 0.5 * width * aside);
            let corner = state.at + axis * along + left(axis) * aside;
            let (away, slope): (f64, Vec2) = scene.ground.away(corner);
            if away == 0.0 {
                continue;
            }
            cost.value += scene.rules.road * away;
            gradient.at += slope * scene.rules.road;
            let turned = left(axis) * along - axis * aside;
            gradient.heading += scene.rules.road * slope.dot(&turned);
        }
    }
}
