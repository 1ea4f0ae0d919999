//! One agent: its route, its path and its motion.

use reactsim_geometry::{OrientedBox, Vec2, direction, math};

use crate::ground::Ground;
use crate::idm_model::IdmModel;
use crate::path::{Path, kept_states};
use crate::planner::Light;
use crate::trajectory::{Pose, STEP};
use crate::{ObjectId, TrackedObject};

use super::placing::Place;
use super::{AgentRoads, Lead, Parameters};

/// Largest number of lanes of a route; earlier ones are forgotten (nuPlan devkit 1.2.2, `max_route_len`).
const ROUTE_LANES: usize = 5;

/// Largest number of lanes that are added to a route in one step, so that lanes almost without length end.
const MAX_NEW_LANES: usize = 100;

/// A vehicle on its path.
#[derive(Clone, Debug)]
pub struct IdmAgent {
    /// The vehicle as it was placed.
    object: TrackedObject,
    path: Path,
    /// Arc length of its centre, metres; not clamped to the path.
    progress: f64,
    speed: f64,
    target_speed: f64,
    /// Lanes of the route, the last ones.
    route: Vec<usize>,
    /// Ground by which others see it: its box, and the strip of its path from its rear to its front and as
    /// far ahead as it drives in its headway.
    pub(super) ground: Ground,
    lead: Option<Lead>,
}

impl IdmAgent {
    /// Creates an agent. `unknown_speed`: its speed, m/s, if its velocity is unknown.
    pub(super) fn new(object: &TrackedObject, place: Place, target_speed: f64, unknown_speed: f64) -> Self {
        let speed = math::hypot(object.velocity.x, object.velocity.y);
        Self {
            object: object.clone(),
            path: place.path,
            progress: place.progress,
            speed: if speed.is_nan() { unknown_speed } else { speed },
            target_speed,
            route: vec![place.lane],
            ground: Ground::of_box(&place.footprint),
            lead: None,
        }
    }

    /// Returns the id of the vehicle.
    pub fn id(&self) -> &ObjectId {
        &self.object.id
    }

    /// Returns the centre of its box and its heading.
    pub fn pose(&self) -> Pose {
        self.path.interpolated(self.progress)
    }

    /// Returns its speed, m/s.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Returns the speed that it aims at, m/s.
    pub fn target_speed(&self) -> f64 {
        self.target_speed
    }

    /// Returns the arc length of its centre on its path, metres.
    pub fn progress(&self) -> f64 {
        self.progress
    }

    /// Returns the length of its path, metres.
    pub fn path_end(&self) -> f64 {
        self.path.length()
    }

    /// Returns the lanes of its route, at most the last five: indices into the lanes of the map.
    pub fn route(&self) -> &[usize] {
        &self.route
    }

    /// Returns how it followed its leader in the last step; `None` before the first one.
    pub fn lead(&self) -> Option<&Lead> {
        self.lead.as_ref()
    }

    /// Returns it as an object at present.
    pub fn object(&self) -> TrackedObject {
        let Pose { position, heading } = self.pose();
        let velocity = direction(heading) * self.speed;
        TrackedObject { center: position, heading, velocity, ..self.object.clone() }
    }

    /// Returns the strip of its path ahead, as wide as the vehicle.
    pub(super) fn strip(&self) -> Ground {
        self.along(&self.path.from(self.progress))
    }

    /// Returns the length of the path ahead, metres; negative beyond its end.
    pub(super) fn path_left(&self) -> f64 {
        self.path.length() - self.progress
    }

    fn along(&self, states: &[Pose]) -> Ground {
        let points: Vec<Vec2> = states.iter().map(|state| state.position).collect();
        Ground::along(&points, 0.5 * self.object.width)
    }

    /// Adds lanes to the route while the path ahead is short and a next lane may be entered. The path then
    /// begins at the agent.
    pub(super) fn extend_route(&mut self, roads: &AgentRoads, lights: &[Light], parameters: &Parameters) {
        let least = parameters.min_path + self.target_speed * parameters.headway;
        for _ in 0..MAX_NEW_LANES {
            if self.path_left() >= least {
                return;
            }
            let Some(next) = self.route.last().and_then(|&last| roads.next(last, lights)) else { return };
            let mut states = self.path.from(self.progress);
            states.extend(roads.states(next));
            let Some(path) = Path::new(kept_states(&states)) else { return };
            if self.route.len() == ROUTE_LANES {
                self.route.remove(0);
            }
            self.route.push(next);
            (self.path, self.progress) = (path, 0.0);
        }
    }

    /// Moves by one step behind a leader.
    pub(super) fn advance(&mut self, roads: &AgentRoads, model: &IdmModel, lead: Lead) {
        if let Some(limit) = self.route.last().and_then(|&last| roads.limit(last)) {
            self.target_speed = limit;
        }
        let gap = lead.distance - lead.rear;
        let acceleration = model.acceleration(self.speed, self.target_speed, gap, lead.speed);
        self.progress += STEP * self.speed;
        self.speed = (self.speed + STEP * acceleration).max(0.0);
        self.lead = Some(lead);
        let Pose { position, heading } = self.pose();
        let TrackedObject { length, width, .. } = self.object;
        let reach = 0.5 * length + self.speed * model.headway;
        let covered = self.path.trimmed(self.progress - 0.5 * length, self.progress + reach);
        let footprint = OrientedBox::new(position, heading, length, width);
        self.ground = self.along(&covered).with(Ground::of_box(&footprint));
    }
}
