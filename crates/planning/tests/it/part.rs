//! Parts of golden documents, and the comparison of numbers with them.

use std::fs;

use reactsim_geometry::{Polyline, Vec2};
use reactsim_planning::idm_agents::{AgentRoads, Parameters, SignalLine};
use reactsim_planning::map::{PlanningLane, PlanningMapParts};
use reactsim_planning::planner::{Light, LightState, Route};
use reactsim_planning::{EgoShape, EgoState, PlanningMap, TrackedObject};
use reactsim_test_support::shared;
use serde_json::Value;

use crate::document;

/// A document, or a part of one, with its place for messages.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    place: String,
    value: Value,
}

/// Returns all documents of a folder of `planner_golden`, by name; none, with a message, if the shared
/// data is missing.
#[track_caller]
pub(crate) fn documents(folder: &str) -> Vec<Part> {
    let Some(folder) = shared(&format!("planner_golden/{folder}")) else { return Vec::new() };
    let mut paths: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "json"));
    paths.sort();
    assert!(!paths.is_empty(), "{} has no documents", folder.display());
    let read = |path: &std::path::PathBuf| Part {
        place: path.file_stem().unwrap().to_string_lossy().into_owned(),
        value: serde_json::from_slice(&fs::read(path).unwrap()).unwrap(),
    };
    paths.iter().map(read).collect()
}

impl Part {
    pub(crate) fn place(&self) -> &str {
        &self.place
    }

    #[track_caller]
    pub(crate) fn at(&self, key: &str) -> Self {
        let place = format!("{}.{key}", self.place);
        let value = self.value.get(key).unwrap_or_else(|| panic!("no {place}")).clone();
        Self { place, value }
    }

    /// Returns the content of the part with this key.
    #[track_caller]
    pub(crate) fn json(&self, key: &str) -> Value {
        self.at(key).value
    }

    pub(crate) fn has(&self, key: &str) -> bool {
        self.value.get(key).is_some()
    }

    pub(crate) fn document(&self) -> document::Document {
        document::Document::new(&self.value)
    }

    #[track_caller]
    pub(crate) fn list(&self) -> Vec<Self> {
        let values = self.value.as_array().unwrap_or_else(|| panic!("{} is no list", self.place));
        let element = |(i, value): (usize, &Value)| Self {
            place: format!("{}[{i}]", self.place),
            value: value.clone(),
        };
        values.iter().enumerate().map(element).collect()
    }

    /// Returns this number; infinite for null.
    #[track_caller]
    pub(crate) fn float(&self) -> f64 {
        if self.value.is_null() {
            return f64::INFINITY;
        }
        self.value.as_f64().unwrap_or_else(|| panic!("{} is no number", self.place))
    }

    #[track_caller]
    pub(crate) fn number(&self, key: &str) -> f64 {
        self.at(key).float()
    }

    #[track_caller]
    pub(crate) fn numbers(&self, key: &str) -> Vec<f64> {
        self.at(key).floats()
    }

    #[track_caller]
    pub(crate) fn floats(&self) -> Vec<f64> {
        self.list().iter().map(Self::float).collect()
    }

    #[track_caller]
    pub(crate) fn flag(&self, key: &str) -> bool {
        let part = self.at(key);
        part.value.as_bool().unwrap_or_else(|| panic!("{} is no flag", part.place))
    }

    #[track_caller]
    pub(crate) fn flags(&self, key: &str) -> Vec<bool> {
        let flag = |part: &Self| part.value.as_bool().unwrap_or_else(|| panic!("{} is no flag", part.place));
        self.at(key).list().iter().map(flag).collect()
    }

    #[track_caller]
    pub(crate) fn string(&self) -> String {
        self.value.as_str().unwrap_or_else(|| panic!("{} is no text", self.place)).to_owned()
    }

    #[track_caller]
    pub(crate) fn texts(&self, key: &str) -> Vec<String> {
        self.at(key).list().iter().map(Self::string).collect()
    }

    /// Returns the state of ego that this part describes, at time 0: x, y, heading, v, a, steering, yaw
    /// rate.
    #[track_caller]
    pub(crate) fn ego(&self) -> EgoState {
        EgoState {
            vx: self.number("v"),
            ax: self.number("a"),
            steering: self.number("steering"),
            yaw_rate: self.number("yaw_rate"),
            ..EgoState::standing(Vec2::new(self.number("x"), self.number("y")), self.number("heading"))
        }
    }

    /// Returns the objects that are present at one sample, or, in documents of one sample, all of them.
    pub(crate) fn objects(&self, sample: usize) -> Vec<TrackedObject> {
        document::objects_at(&self.value["tracks"], sample)
    }

    pub(crate) fn shape(&self) -> EgoShape {
        document::shape(&self.value["vehicle"])
    }

    /// Returns the map. Baselines of two points are sampled every metre, as the devkit received them; others
    /// are so already.
    pub(crate) fn map(&self) -> PlanningMap {
        let map = document::map(&self.value["map"]);
        let lane = |(i, lane): (usize, &PlanningLane)| {
            let is_sampled = lane.baseline.segments() > 1;
            let baseline = if is_sampled { lane.baseline.clone() } else { sampled(&lane.baseline) };
            (PlanningLane { baseline, ..lane.clone() }, map.lane_area(i).clone())
        };
        PlanningMap::new(PlanningMapParts {
            lanes: map.lanes().iter().enumerate().map(lane).collect(),
            roadblocks: map.roadblocks().to_vec(),
            intersections: map.intersections().clone(),
            drivable: map.drivable().clone(),
        })
        .unwrap()
    }

    #[track_caller]
    pub(crate) fn route(&self, map: &PlanningMap) -> Route {
        Route::new(map, self.texts("route_roadblocks").iter().map(String::as_str)).unwrap()
    }

    /// Returns the lights at one sample.
    #[track_caller]
    pub(crate) fn lights(&self, map: &PlanningMap, sample: usize) -> Vec<Light> {
        let light = |id: &str, state| Light { lane: map.find_lane(id).unwrap(), state };
        let red = self.value["red_connectors"].as_array().into_iter().flatten();
        let mut lights: Vec<Light> = red.map(|id| light(id.as_str().unwrap(), LightState::Red)).collect();
        for changing in self.value["lights"].as_array().into_iter().flatten() {
            let state = match changing["status"][sample].as_str() {
                Some("red") => LightState::Red,
                Some("yellow") => LightState::Yellow,
                Some("green") => LightState::Green,
                Some(other) => panic!("{}: unknown status {other}", self.place),
                None => continue,
            };
            lights.push(light(changing["connector"].as_str().unwrap(), state));
        }
        lights
    }

    /// Returns the map of agents: its baselines, signals and stop lines.
    pub(crate) fn agent_roads(&self) -> AgentRoads {
        let map = self.map();
        let json = &self.value["map"];
        let id = |value: &Value| value["id"].as_str().unwrap().to_owned();
        let lanes = json["lanes"].as_array().unwrap().iter();
        let signalled = lanes.enumerate().filter(|(_, lane)| lane["traffic_lights"].as_bool() == Some(true));
        let signalled: Vec<usize> = signalled.map(|(i, _)| i).collect();
        let line = |line: &Value| SignalLine {
            id: id(line),
            outline: document::points(&line["polygon"]),
            connectors: line["connectors"]
                .as_array()
                .unwrap()
                .iter()
                .map(|id| map.find_lane(id.as_str().unwrap()).unwrap())
                .collect(),
        };
        let lines = json["stop_lines"].as_array().into_iter().flatten().map(line).collect();
        AgentRoads::new(map, &signalled, lines)
    }

    pub(crate) fn agent_parameters(&self) -> Parameters {
        let config = self.at("config");
        Parameters {
            target_speed: config.number("target_velocity"),
            min_gap: config.number("min_gap_to_lead_agent"),
            headway: config.number("headway_time"),
            acceleration: config.number("accel_max"),
            deceleration: config.number("decel_max"),
            min_path: config.number("minimum_path_length"),
            radius: config.number("radius"),
        }
    }

    #[track_caller]
    pub(crate) fn len(&self) -> usize {
        self.value.as_array().unwrap_or_else(|| panic!("{} is no list", self.place)).len()
    }

    /// Returns the text of this part; `None` for null.
    #[track_caller]
    pub(crate) fn text(&self) -> Option<&str> {
        assert!(self.value.is_null() || self.value.is_string(), "{} is no text", self.place);
        self.value.as_str()
    }
}

/// Returns the points of a line every metre, and its end.
fn sampled(line: &Polyline) -> Polyline {
    let count = (line.length() - 1e-9) as usize;
    let mut points: Vec<Vec2> = (0..=count).map(|metre| line.at(metre as f64)).collect();
    points.push(line.at(line.length()));
    Polyline::new(&points).unwrap()
}

/// The largest difference of numbers that are compared, with its place.
#[derive(Debug)]
pub(crate) struct Largest {
    tolerance: f64,
    difference: f64,
    place: String,
    compared: usize,
}

impl Largest {
    /// Compares with a tolerance, relative to 1 or to the expected value, whichever is larger.
    pub(crate) fn new(tolerance: f64) -> Self {
        Self { tolerance, difference: 0.0, place: String::new(), compared: 0 }
    }

    pub(crate) fn compare(&mut self, found: f64, expected: f64, place: impl FnOnce() -> String) {
        self.compared += 1;
        if found == expected {
            return;
        }
        let difference = (found - expected).abs() / expected.abs().max(1.0);
        if !(difference <= self.difference) {
            (self.difference, self.place) = (difference, format!("{}: {found} for {expected}", place()));
        }
    }

    /// Panics if a difference was above the tolerance.
    #[track_caller]
    pub(crate) fn check(&self, document: &str) {
        assert!(self.compared > 0, "{document}: nothing was compared");
        let Self { tolerance, difference, place, .. } = self;
        assert!(difference <= tolerance, "{document}: {difference:e} above {tolerance:e} at {place}");
    }
}
