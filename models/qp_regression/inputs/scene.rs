//! A scene as predictions are made in it: what is the same for everybody who is predicted.

use reactsim::geometry::Vec2;

use super::{Ground, forecast};
use crate::models::ntp::reactive::body::Body;
use crate::models::ntp::reactive::places::Places;
use crate::models::ntp::reactive::step::View;

/// A scene.
#[derive(Debug)]
pub(crate) struct Scene<'a> {
    /// Who is where.
    pub view: &'a View<'a>,
    /// The map.
    pub ground: &'a Ground,
    /// The forecast of the AV: position and velocity after 0.1 s and so on.
    pub av: Option<Vec<(Vec2, Vec2)>>,
    /// Everybody as they are in the way of others, where an outlook is shown.
    pub(super) bodies: Vec<Body>,
    /// Their slots.
    pub(super) slots: Vec<usize>,
}

impl<'a> Scene<'a> {
    /// The scene of a view.
    pub(crate) fn of(view: &'a View<'a>, ground: &'a Ground) -> Self {
        let av = view.tracks.first().and_then(|track| forecast(track, view.now, view.av_next));
        let mut scene = Self { view, ground, av, bodies: Vec::new(), slots: Vec::new() };
        if ground.places.is_some() {
            // Where the others are going does not matter.
            let nowhere = Places::default();
            for slot in 0..view.agents.len() {
                if let Some((body, _)) = view.body(slot, &nowhere) {
                    scene.bodies.push(body);
                    scene.slots.push(slot);
                }
            }
        }
        scene
    }
}
