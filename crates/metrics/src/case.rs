//! The input of a metric: one scenario with one rollout.

use std::borrow::Cow;

use reactsim_geometry::Vec2;
use reactsim_scene::{
    AgentKind, Certificate, Frame, LaneArea, Length, OBSERVED_DISTANCE, Road, Scenario, Start,
};

use super::av::AvScores;
use super::cache::Cache;
use super::light::ObservedLight;
use super::motion::Motion;
use super::object::{LoggedTrack, Object};
use super::options::{DirTracking, Options};

/// One scenario with one rollout, and the intermediate results that several metrics share.
#[derive(Debug)]
pub struct Case<'a> {
    /// The map.
    pub road: Road<'a>,
    /// Every agent, including the AV.
    pub objects: Vec<Object<'a>>,
    /// Index of the AV in `objects`.
    pub av: usize,
    /// Variants of the metrics; `dir_tracking` is resolved, never `Auto`.
    pub options: Options,
    /// Index of the current frame.
    pub current: usize,
    /// The lights of the map.
    pub lights: Vec<ObservedLight<'a>>,
    /// The log, aligned with `objects`.
    pub log: Option<Vec<LoggedTrack<'a>>>,
    /// All rollouts of this scenario, each aligned with `objects`, future frames only; for metrics over
    /// several rollouts.
    pub rollouts: Vec<Vec<&'a [Frame]>>,
    /// Responses with which the agents can avoid the AV of this case; `None` if unknown.
    pub certificate: Option<&'a Certificate>,
    /// Closed-loop scores of the AV; `None` if it is not judged.
    pub av_scores: Option<&'a AvScores>,
    /// Whether agents leave where they drive out of sight.
    pub(super) may_leave: bool,
    /// Heights of the logged states from the current frame on, per object, metres; empty in scenarios of one
    /// level.
    log_heights: Vec<Vec<f64>>,
    pub(super) motion: Motion,
    pub(super) cache: Cache,
}

impl<'a> Case<'a> {
    /// Creates a case with the time axis of the benchmark: 91 frames, of which frame 10 is now. An `av`
    /// beyond the objects means that there is no AV.
    pub fn new(road: Road<'a>, objects: Vec<Object<'a>>, av: usize, options: Options) -> Self {
        let length = Length::BENCHMARK;
        Self::with_current(road, objects, av, length.current(), length.frames(), options)
    }

    /// Creates a case with another time axis: `frames` frames at 10 Hz, of which `current` is now.
    pub fn with_current(
        road: Road<'a>,
        objects: Vec<Object<'a>>,
        av: usize,
        current: usize,
        frames: usize,
        mut options: Options,
    ) -> Self {
        options.dir_tracking = match options.dir_tracking {
            DirTracking::Auto if is_waymo_like(&road) => DirTracking::Pointwise,
            DirTracking::Auto => DirTracking::Route,
            chosen => chosen,
        };
        let frames = frames.max(current + 1);
        let motion = Motion::new(&objects, current, frames, &options);
        Self {
            road,
            objects,
            av,
            options,
            current,
            lights: Vec::new(),
            log: None,
            rollouts: Vec::new(),
            certificate: None,
            av_scores: None,
            may_leave: false,
            log_heights: Vec::new(),
            motion,
            cache: Cache::default(),
        }
    }

    /// Creates the case of one rollout of a scenario, with its time axis, log and lights. `tracks`: the
    /// frames of each agent, in the order of the scenario, borrowed or owned. Agents that are absent at the
    /// current frame entered later ([`Scenario::with_entered`]): they are judged from their first step on.
    pub fn of_rollout<T: Into<Cow<'a, [Frame]>>>(
        scenario: &'a Scenario,
        tracks: impl IntoIterator<Item = T>,
        options: Options,
    ) -> Self {
        let start = &scenario.start;
        let object = |(agent, track): (_, T)| Object { agent, track: track.into() };
        let objects = start.agents.iter().zip(tracks).map(object).collect();
        let log = start.history.iter().zip(&scenario.log_future.tracks);
        let log = log.map(|(history, future)| LoggedTrack { history, future, recorded_history: None });
        let lights = ObservedLight::all(scenario);
        let length = scenario.length();
        let current = length.current();
        let mut case = Self::with_current(start.road(), objects, 0, current, length.frames(), options);
        for (i, object) in
            case.objects.iter().enumerate().filter(|(i, _)| start.history[*i][current].is_none())
        {
            case.motion.enter(i, object, &case.options);
        }
        case.with_log(log.collect()).with_lights(lights).with_heights(start)
    }

    /// Adds the heights of the objects, which are the agents of `start`: in scenarios with several levels
    /// they meet only what is on their own.
    pub fn with_heights(mut self, start: &Start) -> Self {
        self.motion.height.clear();
        if start.has_levels() {
            let frames = self.frames();
            self.motion.height.resize(self.objects.len() * frames, f64::NAN);
            for (i, object) in self.objects.iter().enumerate().take(start.agents.len()) {
                let track = object.track.get(self.current..).unwrap_or_default();
                let all = &mut self.motion.height[i * frames + self.current..(i + 1) * frames];
                all.iter_mut().zip(start.heights_along(i, track)).for_each(|(h, found)| *h = found);
            }
            self.log_heights = match &self.log {
                Some(log) => {
                    (0..log.len()).map(|i| start.heights_along(i, &log[i].from(self.current))).collect()
                }
                None => Vec::new(),
            };
        }
        self.cache = Cache::default();
        self
    }

    /// Returns the road on the level of an object at a frame.
    pub(super) fn road_under(&self, object: usize, frame: usize) -> Road<'a> {
        self.road.on_level(self.motion.position(object, frame), self.motion.height(object, frame))
    }

    /// Returns whether two objects are on different levels at a frame.
    pub(super) fn is_apart(&self, a: usize, b: usize, frame: usize) -> bool {
        let motion = &self.motion;
        let place = |object: usize| (motion.position(object, frame), motion.height(object, frame));
        self.road.is_apart(place(a), place(b))
    }

    /// Returns whether an object, at its logged position, and the AV of this case are on different levels at
    /// a frame.
    pub(super) fn log_is_apart(&self, object: usize, frame: usize, logged: Vec2) -> bool {
        let height = self.log_heights.get(object).and_then(|heights| heights.get(frame - self.current));
        let av = (self.motion.position(self.av, frame), self.motion.height(self.av, frame));
        height.is_some_and(|&height| self.road.is_apart((logged, height), av))
    }

    /// Adds the log, aligned with the objects. Missing entries are absent at every frame.
    pub fn with_log(mut self, mut log: Vec<LoggedTrack<'a>>) -> Self {
        log.resize(self.objects.len(), LoggedTrack { history: &[], future: &[], recorded_history: None });
        self.log = Some(log);
        self.cache = Cache::default();
        self
    }

    /// Adds the lights of the map.
    pub fn with_lights(mut self, lights: Vec<ObservedLight<'a>>) -> Self {
        self.lights = lights;
        self.cache = Cache::default();
        self
    }

    /// Adds all rollouts of the scenario: the frames after the current one, per rollout and object.
    pub fn with_rollouts(mut self, mut rollouts: Vec<Vec<&'a [Frame]>>) -> Self {
        for rollout in &mut rollouts {
            rollout.resize(self.objects.len(), &[]);
        }
        self.rollouts = rollouts;
        self.cache = Cache::default();
        self
    }

    /// Adds the certificate, if any, that the AV of this case can be avoided. The over-reaction metrics
    /// compare with its responses.
    pub fn with_certificate(mut self, certificate: Option<&'a Certificate>) -> Self {
        self.certificate = certificate;
        self.cache = Cache::default();
        self
    }

    /// Adds the closed-loop scores of the AV, if it is judged.
    pub fn with_av_scores(mut self, scores: Option<&'a AvScores>) -> Self {
        self.av_scores = scores;
        self
    }

    /// States whether agents may leave: the paths of those that do are compared up to their last step.
    /// Without it, agents that vanish have driven too little.
    pub fn with_leaving(mut self, may_leave: bool) -> Self {
        self.may_leave = may_leave;
        self.cache = Cache::default();
        self
    }

    /// Returns positions, boxes and velocities of all objects.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Returns the first frame from the current one on at which an object is present.
    pub(super) fn first_frame(&self, object: usize) -> Option<usize> {
        (self.current..self.frames()).find(|&f| self.motion.valid(object, f))
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> usize {
        self.motion.frames
    }

    /// Returns the scored frames: those after the current one. The step of frame `f` is `f - current`.
    pub fn future(&self) -> std::ops::Range<usize> {
        self.current + 1..self.frames()
    }

    /// Returns the scored frames over which the path of an object is compared with others.
    pub(super) fn path_frames(&self, object: usize) -> std::ops::Range<usize> {
        let future = self.future();
        if !self.may_leave {
            return future;
        }
        let Some(last) = (self.current..future.end).rev().find(|&f| self.motion.valid(object, f)) else {
            return future.start..future.start;
        };
        // An agent that vanishes near the AV has not left: its simulator dropped it.
        let distance = (self.motion.position(object, last) - self.motion.position(self.av, last)).norm();
        if distance < OBSERVED_DISTANCE { future } else { future.start..last + 1 }
    }

    /// Returns whether an object takes part: it is valid at the current frame and its box has a positive
    /// size.
    pub fn present(&self, object: usize) -> bool {
        self.motion.present.get(object).copied().unwrap_or(false)
    }

    /// Returns whether an object is evaluated: present, not the AV, and a vehicle, pedestrian or cyclist (the
    /// set A).
    pub fn evaluated(&self, object: usize) -> bool {
        object != self.av && self.present(object) && self.objects[object].agent.kind != AgentKind::Other
    }

    /// Returns the indices of the evaluated objects.
    pub fn agents(&self) -> impl Iterator<Item = usize> {
        (0..self.objects.len()).filter(|&i| self.evaluated(i))
    }

    /// Returns the indices of the evaluated vehicles (the set V).
    pub fn vehicles(&self) -> impl Iterator<Item = usize> {
        self.agents().filter(|&i| self.objects[i].agent.kind == AgentKind::Vehicle)
    }

    /// Returns the values of the evaluated vehicles by object; defaults for other objects.
    pub(super) fn of_vehicles<T: Clone + Default>(&self, mut value: impl FnMut(usize) -> T) -> Vec<T> {
        let mut values = vec![T::default(); self.objects.len()];
        for i in self.vehicles() {
            values[i] = value(i);
        }
        values
    }

    /// Returns the id of an object.
    pub fn id(&self, object: usize) -> String {
        self.objects[object].agent.id.clone()
    }
}

/// Returns whether the map has lanes recorded as centre lines and no drivable polygons. The lanes of such
/// maps overlap at merges and junctions.
fn is_waymo_like(road: &Road<'_>) -> bool {
    road.map.drivable_area.is_none()
        && road.map.lanes.iter().any(|l| matches!(l.area, LaneArea::Corridor { .. }))
}
