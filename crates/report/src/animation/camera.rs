//! Position and field of view of the camera.

use reactsim_geometry::{Bounds, Vec2};

use super::Animation;
use crate::birdseye::Scene;

/// Margin around the AV's path, metres.
const MARGIN: f64 = 18.0;
/// Smallest default radius of a fixed camera, metres.
const MIN_RADIUS: f64 = 30.0;
/// Default radius of a camera that follows the AV, metres.
const FOLLOW_RADIUS: f64 = 40.0;
/// Largest radius, metres.
const MAX_RADIUS: f64 = 1000.0;

/// The visible area of the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct Camera {
    /// Half of the side of a panel, metres.
    pub(super) radius: f64,
    /// Position of a fixed camera; `None` if it follows the AV.
    fixed: Option<Vec2>,
    /// Size of a pixel, metres.
    pixel: f64,
}

impl Camera {
    /// Creates a camera for all panels of an animation. A fixed camera sees the whole path of every
    /// panel's AV and all events.
    pub(super) fn new(animation: &Animation<'_>, scenes: &[Scene<'_>], size: f64) -> Self {
        let requested = animation.radius.filter(|r| r.is_finite()).map(|r| r.clamp(5.0, MAX_RADIUS));
        let (radius, fixed) = if animation.follow {
            (requested.unwrap_or(FOLLOW_RADIUS), None)
        } else {
            let mut places = Vec::new();
            for scene in scenes {
                places.extend((0..=scene.last).filter_map(|k| scene.state(0, k)).map(|s| s.position()));
                places.extend(scene.mark_positions());
            }
            let seen = Bounds::of(places);
            let half = 0.5 * (seen.max - seen.min);
            let radius =
                requested.unwrap_or_else(|| (half.x.max(half.y) + MARGIN).clamp(MIN_RADIUS, MAX_RADIUS));
            (radius, Some(0.5 * (seen.min + seen.max)))
        };
        Self { radius, fixed, pixel: 2.0 * radius / size }
    }

    /// Returns the centre of a panel at a step, rounded to the pixel grid of the scene, so that static
    /// elements have the same pixels at any camera position.
    pub(super) fn middle(&self, scene: &Scene<'_>, step: usize) -> Vec2 {
        // For an absent AV, its last position.
        let over_av = || (0..=step).rev().find_map(|k| scene.state(0, k)).map(|s| s.position());
        let middle = self.fixed.or_else(over_av).filter(|p| p.x.is_finite() && p.y.is_finite());
        middle.unwrap_or_else(Vec2::zeros).map(|v| (v / self.pixel).round() * self.pixel)
    }
}
