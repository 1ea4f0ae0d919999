//! A small road and drives on it, made by hand.
//!
//! The road runs along x: lane `a` eastwards from x = -50 to 150 m and y = 0 to 3.5 m, lane `o` westwards
//! below it, and behind an intersection from x = 150 to 180 m lane `a2` eastwards. Two equal connectors,
//! `c` and `d`, lead from `a` to `a2`.

use reactsim_geometry::{Polyline, Vec2};
use reactsim_planning::map::{
    Area, Areas, DrivableArea, Intersections, LaneKind, PlanningLane, PlanningMapParts, Roadblock,
};
use reactsim_planning::metrics::{History, MissingInputs, PlannerScores, judge};
use reactsim_planning::{EgoShape, EgoState, ObjectKind, PlanningMap, TrackedObject};

/// Indices of the lanes.
pub(crate) const A: usize = 0;
pub(crate) const O: usize = 1;
pub(crate) const A2: usize = 2;
pub(crate) const C: usize = 3;
pub(crate) const D: usize = 4;

/// Number of samples of a drive.
pub(crate) const SAMPLES: usize = 81;
/// Speed limit of `a` and `o`, m/s; that of `a2` is 15.
pub(crate) const LIMIT: f64 = 13.0;

pub(crate) fn v(x: f64, y: f64) -> Vec2 {
    Vec2::new(x, y)
}

pub(crate) fn rectangle(x: [f64; 2], y: [f64; 2]) -> Area {
    Area::ring(vec![v(x[0], y[0]), v(x[1], y[0]), v(x[1], y[1]), v(x[0], y[1])]).unwrap()
}

fn lane(
    id: &str,
    kind: LaneKind,
    x: [f64; 2],
    y: f64,
    limit: Option<f64>,
    roadblock: usize,
) -> (PlanningLane, Area) {
    let lane = PlanningLane {
        id: id.to_owned(),
        kind,
        baseline: Polyline::new(&[v(x[0], y), v(x[1], y)]).unwrap(),
        speed_limit: limit,
        roadblock,
        predecessors: Vec::new(),
        successors: Vec::new(),
    };
    (lane, rectangle([x[0].min(x[1]), x[0].max(x[1])], [y - 1.75, y + 1.75]))
}

pub(crate) fn parts() -> PlanningMapParts {
    let (road, connector) = (LaneKind::Lane, LaneKind::Connector);
    let mut lanes = vec![
        lane("a", road, [-50.0, 150.0], 1.75, Some(LIMIT), 0),
        lane("o", road, [150.0, -50.0], -1.75, Some(LIMIT), 1),
        lane("a2", road, [180.0, 400.0], 1.75, Some(15.0), 2),
        lane("c", connector, [150.0, 180.0], 1.75, Some(5.0), 3),
        lane("d", connector, [150.0, 180.0], 1.75, Some(5.0), 3),
    ];
    lanes[A].0.successors = vec![C, D];
    lanes[A2].0.predecessors = vec![C, D];
    for connector in [C, D] {
        lanes[connector].0.predecessors = vec![A];
        lanes[connector].0.successors = vec![A2];
    }
    let roadblock = |id: &str| Roadblock { id: id.to_owned(), area: None };
    PlanningMapParts {
        lanes,
        roadblocks: ["r1", "r2", "r3", "rc"].map(roadblock).to_vec(),
        intersections: Intersections::Areas(Areas::new(vec![rectangle([150.0, 180.0], [-3.5, 3.5])])),
        drivable: DrivableArea::of_areas(vec![rectangle([-50.0, 400.0], [-3.5, 3.5])]),
    }
}

/// A drive of ego with its surroundings.
pub(crate) struct Drive {
    pub(crate) map: PlanningMapParts,
    pub(crate) ego: Vec<EgoState>,
    pub(crate) expert: Option<Vec<EgoState>>,
    pub(crate) objects: Vec<Vec<TrackedObject>>,
    pub(crate) missing: MissingInputs,
}

impl Drive {
    /// Ego drives straight on; the expert drives as ego does. `start` is the rear axle, metres.
    pub(crate) fn straight(start: Vec2, heading: f64, speed: f64) -> Self {
        let ego = straight(start, heading, speed);
        Self {
            map: parts(),
            expert: Some(ego.clone()),
            ego,
            objects: vec![Vec::new(); SAMPLES],
            missing: MissingInputs::Undefined,
        }
    }

    /// Adds an object that is present at all samples and moves straight on, with any heading.
    pub(crate) fn with(
        mut self,
        id: &str,
        kind: ObjectKind,
        start: Vec2,
        heading: f64,
        velocity: Vec2,
    ) -> Self {
        for (k, objects) in self.objects.iter_mut().enumerate() {
            objects.push(object(id, kind, start + velocity * (k as f64 * 0.1), heading, velocity));
        }
        self
    }

    pub(crate) fn judge(self) -> PlannerScores {
        self.with_history(|history| judge(history).unwrap())
    }

    pub(crate) fn with_history<T>(self, use_history: impl FnOnce(&History<'_>) -> T) -> T {
        let map = PlanningMap::new(self.map).unwrap();
        use_history(&History {
            map: &map,
            shape: EgoShape::PACIFICA,
            ego: &self.ego,
            expert: self.expert.as_deref(),
            objects: &self.objects,
            missing: self.missing,
        })
    }
}

/// Returns an object of 4 m × 2 m.
pub(crate) fn object(
    id: &str,
    kind: ObjectKind,
    center: Vec2,
    heading: f64,
    velocity: Vec2,
) -> TrackedObject {
    TrackedObject { id: id.into(), kind, center, heading, length: 4.0, width: 2.0, velocity }
}

/// Returns the states of a vehicle that moves along `heading` at a speed, m/s, negative in reverse.
pub(crate) fn straight(start: Vec2, heading: f64, speed: f64) -> Vec<EgoState> {
    let ahead = reactsim_geometry::direction(heading);
    let state = |k: usize| {
        let time = k as f64 * 0.1;
        EgoState { time, vx: speed, ..EgoState::standing(start + ahead * (speed * time), heading) }
    };
    (0..SAMPLES).map(state).collect()
}
