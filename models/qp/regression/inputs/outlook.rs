//! Lane and conflict features of an agent, the same as those of the token network.

use reactsim_geometry::Vec2;
use reactsim_nn::perception::{BODY_FEATURES, Body, Class, corridor, lane};

use super::SceneContext;
use super::frame::LocalFrame;

/// Number of features of an outlook: own motion, lane, paths ahead, and agents in the way now and soon.
pub(crate) const OUTLOOK: usize = BODY_FEATURES;

/// Lane and conflict features of one agent.
#[derive(Clone, Debug)]
pub(crate) struct Outlook {
    /// [`OUTLOOK`] features.
    pub numbers: Vec<f32>,
    /// Distinct paths along lanes in the frame of the agent: points every [`lane::SPACING`] metres and
    /// the direction there. Empty for pedestrians and where there is no lane.
    pub paths: Vec<Vec<(Vec2, Vec2)>>,
}

/// Length of a path as travel time at the present speed, seconds.
const HORIZON: f64 = 10.0;
/// Smallest length of a path, metres.
const MIN_LENGTH: f64 = 30.0;
/// Largest length of a path, metres.
const MAX_LENGTH: f64 = 200.0;

impl Outlook {
    /// Computes the outlook of an agent; `None` if the configuration has none or the agent is absent.
    pub(super) fn of(scene: &SceneContext<'_>, slot: usize, frame: &LocalFrame) -> Option<Self> {
        let places = scene.ground.places.as_ref()?;
        let (body, paths) = scene.view.body(slot, places)?;
        let own = scene.slots.iter().position(|&s| s == slot)?;
        let mut numbers = body.features.to_vec();
        let out = &mut numbers[Body::corridor_features()];
        corridor::describe(&scene.bodies, own, &paths, &places.all, scene.view, out);
        let mut paths: Vec<Vec<(Vec2, Vec2)>> = Vec::new();
        if body.class != Class::Pedestrian {
            let length = (HORIZON * body.velocity.norm()).clamp(MIN_LENGTH, MAX_LENGTH);
            let points = (length / lane::SPACING) as usize;
            for path in lane::lane_paths(body.position, body.ahead, places, points) {
                let path: Vec<_> =
                    path.points.into_iter().map(|(p, d)| (frame.point(p), frame.vector(d))).collect();
                if !paths.contains(&path) {
                    paths.push(path);
                }
            }
        }
        Some(Self { numbers, paths })
    }
}
