//! Where the camera stands.

use super::Animation;
use crate::geometry::{Bounds, Vec2};
use crate::report::birdseye::{View, moving::Moving};
use crate::scene::FUTURE;

/// Ground around the AV's way, metres.
const MARGIN: f64 = 18.0;
/// The least that is shown by itself, metres, and what is shown around an AV that is followed.
const LEAST: f64 = 30.0;
const FOLLOWED: f64 = 40.0;
/// The most, metres.
const MOST: f64 = 1000.0;

/// The ground that is shown.
#[derive(Clone, Copy, Debug)]
pub(super) struct Camera {
    /// Half of the side of a panel, metres.
    pub(super) radius: f64,
    /// Where it stands; `None`: over the AV.
    stands: Option<Vec2>,
    /// Metres of a pixel.
    pixel: f64,
}

impl Camera {
    /// A camera for all panels of an animation. One that stands sees the whole way of every panel's AV and all events.
    pub(super) fn new(animation: &Animation<'_>, views: &[View<'_>], size: f64) -> Self {
        let wanted = animation.radius.filter(|r| r.is_finite()).map(|r| r.clamp(5.0, MOST));
        let (radius, stands) = if animation.follow {
            (wanted.unwrap_or(FOLLOWED), None)
        } else {
            let mut places = Vec::new();
            for view in views {
                let moving = Moving::new(animation.scenario, view);
                places.extend((0..=FUTURE).filter_map(|k| moving.av(k)).map(|s| s.position()));
                places.extend(moving.marked());
            }
            let seen = Bounds::of(places);
            let half = 0.5 * (seen.max - seen.min);
            let radius = wanted.unwrap_or_else(|| (half.x.max(half.y) + MARGIN).clamp(LEAST, MOST));
            (radius, Some(0.5 * (seen.min + seen.max)))
        };
        Self { radius, stands, pixel: 2.0 * radius / size }
    }

    /// The middle of a panel at a step, on whole pixels of the world: what stands still looks the same wherever the camera is.
    pub(super) fn middle(&self, moving: &Moving<'_>, step: usize) -> Vec2 {
        // Who is absent for a while was somewhere before.
        let over_av = || (0..=step).rev().find_map(|k| moving.av(k)).map(|s| s.position());
        let middle = self.stands.or_else(over_av).filter(|p| p.x.is_finite() && p.y.is_finite());
        middle.unwrap_or_else(Vec2::zeros).map(|v| (v / self.pixel).round() * self.pixel)
    }
}
