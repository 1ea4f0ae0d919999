//! Golden documents: a map, the motion of ego, expert and objects, and expected values.

use std::collections::BTreeMap;

use reactsim_geometry::{Polyline, Vec2};
use reactsim_planning::map::Areas;
use reactsim_planning::map::{
    Area, DrivableArea, Intersections, LaneKind, PlanningLane, PlanningMapParts, Roadblock,
};
use reactsim_planning::{EgoShape, EgoState, ObjectId, ObjectKind, PlanningMap, TrackedObject};
use serde_json::Value;

pub(crate) struct Document {
    pub(crate) name: String,
    pub(crate) shape: EgoShape,
    pub(crate) map: PlanningMap,
    pub(crate) ego: Vec<EgoState>,
    pub(crate) expert: Vec<EgoState>,
    pub(crate) objects: Vec<Vec<TrackedObject>>,
    pub(crate) expected: Value,
}

impl Document {
    pub(crate) fn new(json: &Value) -> Self {
        let dt = json["dt"].as_f64().unwrap();
        let ego = states(&json["ego"], dt);
        Self {
            name: json["name"].as_str().unwrap().to_owned(),
            shape: shape(&json["vehicle"]),
            map: map(&json["map"]),
            expert: states(&json["expert"], dt),
            objects: (0..ego.len()).map(|k| objects_at(&json["tracks"], k)).collect(),
            ego,
            expected: json["expected"].clone(),
        }
    }

    /// Returns the ids of lanes.
    pub(crate) fn ids(&self, lanes: &[usize]) -> Vec<String> {
        lanes.iter().map(|&lane| self.map.lane(lane).id.clone()).collect()
    }
}

/// Returns a number; `null` means infinite.
pub(crate) fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::INFINITY)
}

pub(crate) fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

pub(crate) fn shape(vehicle: &Value) -> EgoShape {
    EgoShape {
        width: number(&vehicle["width"]),
        length: number(&vehicle["length"]),
        wheelbase: number(&vehicle["wheel_base"]),
        rear_axle_to_center: number(&vehicle["rear_axle_to_center"]),
    }
}

pub(crate) fn states(lists: &Value, dt: f64) -> Vec<EgoState> {
    let list = |name: &str| numbers(&lists[name]);
    let (x, y, heading) = (list("x"), list("y"), list("heading"));
    let (vx, vy, ax, ay) = (list("vx"), list("vy"), list("ax"), list("ay"));
    let (steering, yaw_rate, yaw_acceleration) =
        (list("steering"), list("yaw_rate"), list("yaw_acceleration"));
    let state = |k: usize| EgoState {
        time: k as f64 * dt,
        x: x[k],
        y: y[k],
        heading: heading[k],
        vx: vx[k],
        vy: vy[k],
        ax: ax[k],
        ay: ay[k],
        steering: steering[k],
        yaw_rate: yaw_rate[k],
        yaw_acceleration: yaw_acceleration[k],
    };
    (0..x.len()).map(state).collect()
}

pub(crate) fn objects_at(tracks: &Value, k: usize) -> Vec<TrackedObject> {
    tracks.as_array().unwrap().iter().filter_map(|track| object_at(track, k)).collect()
}

fn object_at(track: &Value, k: usize) -> Option<TrackedObject> {
    // Documents of one sample have numbers instead of lists.
    let at = |name: &str| track[name].get(k).unwrap_or(&track[name]).as_f64();
    Some(TrackedObject {
        id: ObjectId::from(track["id"].as_str()?),
        kind: ObjectKind::from_name(track["type"].as_str()?).unwrap(),
        center: Vec2::new(at("x")?, at("y")?),
        heading: at("heading")?,
        length: track["length"].as_f64()?,
        width: track["width"].as_f64()?,
        velocity: Vec2::new(at("vx")?, at("vy")?),
    })
}

pub(crate) fn map(json: &Value) -> PlanningMap {
    let ids = |list: &Value| -> BTreeMap<String, usize> {
        let name = |item: &Value| item["id"].as_str().unwrap().to_owned();
        list.as_array().unwrap().iter().enumerate().map(|(i, item)| (name(item), i)).collect()
    };
    let (lane_ids, roadblock_ids) = (ids(&json["lanes"]), ids(&json["roadblocks"]));
    let links = |lane: &Value| -> Vec<usize> {
        let successors = lane["successors"].as_array().unwrap().iter();
        successors.map(|id| lane_ids[id.as_str().unwrap()]).collect()
    };
    let lanes = json["lanes"].as_array().unwrap();
    let all_links: Vec<Vec<usize>> = lanes.iter().map(links).collect();
    let predecessors = |i: usize| (0..lanes.len()).filter(|&p| all_links[p].contains(&i)).collect();
    let lane = |(i, lane): (usize, &Value)| {
        let parts = PlanningLane {
            id: lane["id"].as_str().unwrap().to_owned(),
            kind: LaneKind::from_name(lane["kind"].as_str().unwrap()).unwrap(),
            baseline: Polyline::new(&points(&lane["baseline"])).unwrap(),
            speed_limit: lane["speed_limit"].as_f64(),
            roadblock: roadblock_ids[lane["roadblock"].as_str().unwrap()],
            predecessors: predecessors(i),
            successors: all_links[i].clone(),
        };
        (parts, area(&lane["polygon"]))
    };
    let roadblock = |roadblock: &Value| Roadblock {
        id: roadblock["id"].as_str().unwrap().to_owned(),
        area: Some(area(&roadblock["polygon"])),
    };
    let parts = PlanningMapParts {
        lanes: lanes.iter().enumerate().map(lane).collect(),
        roadblocks: json["roadblocks"].as_array().unwrap().iter().map(roadblock).collect(),
        intersections: Intersections::Areas(Areas::new(areas(&json["intersections"]))),
        drivable: DrivableArea::of_areas(areas(&json["drivable_area"])),
    };
    PlanningMap::new(parts).unwrap()
}

pub(crate) fn points(list: &Value) -> Vec<Vec2> {
    let point = |p: &Value| Vec2::new(number(&p[0]), number(&p[1]));
    list.as_array().unwrap().iter().map(point).collect()
}

fn area(ring: &Value) -> Area {
    Area::ring(points(ring)).unwrap()
}

fn areas(rings: &Value) -> Vec<Area> {
    rings.as_array().unwrap().iter().map(area).collect()
}
