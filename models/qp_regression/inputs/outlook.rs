//! Where an agent's lane leads and what is in its way, told as the token network is told it.

use super::Scene;
use super::surroundings::Frame2;
use crate::models::ntp::reactive::body::{BODY_FEATURES, Body};
use crate::models::ntp::reactive::corridor;
use crate::models::ntp::reactive::lane;
use crate::models::ntp::tokens::Class;
use reactsim::geometry::Vec2;

/// Numbers of an outlook: own motion, lane, ways on, and what is in the way now and soon.
pub(crate) const OUTLOOK: usize = BODY_FEATURES;

/// What one agent goes by.
#[derive(Clone, Debug)]
pub(crate) struct Outlook {
    /// [`OUTLOOK`] numbers.
    pub numbers: Vec<f32>,
    /// The ways on, each once, in the frame of the agent: points every [`lane::SPACING`] metres and the direction there. None for people on
    /// foot and where there is no lane.
    pub ways: Vec<Vec<(Vec2, Vec2)>>,
}

/// Ways are as long as what is gone in so many seconds at most, and at least, metres.
const FORESIGHT: f64 = 10.0;
const LENGTHS: (f64, f64) = (30.0, 200.0);

impl Outlook {
    /// That of an agent of a scene; `None` where none is shown, or the agent is absent.
    pub(super) fn of(scene: &Scene<'_>, slot: usize, frame: &Frame2) -> Option<Self> {
        let places = scene.ground.places.as_ref()?;
        let (body, ways) = scene.view.body(slot, places)?;
        let own = scene.slots.iter().position(|&s| s == slot)?;
        let mut numbers = body.features.to_vec();
        let out = &mut numbers[Body::corridor_features()];
        corridor::describe(&scene.bodies, own, &ways, &places.all, scene.view.lights, out);
        let mut ways: Vec<Vec<(Vec2, Vec2)>> = Vec::new();
        if body.class != Class::Pedestrian {
            let length = (FORESIGHT * body.velocity.norm()).clamp(LENGTHS.0, LENGTHS.1);
            let points = (length / lane::SPACING) as usize;
            for way in lane::lane_paths(body.position, body.ahead, places, points) {
                let way: Vec<_> =
                    way.points.into_iter().map(|(p, d)| (frame.point(p), frame.vector(d))).collect();
                if !ways.contains(&way) {
                    ways.push(way);
                }
            }
        }
        Some(Self { numbers, ways })
    }
}
