//! Agreement of whole episodes of PDM-Closed with the nuPlan devkit and tuplan_garage. Where the shared
//! data is missing, the test is skipped with a message.

use reactsim_planning::closed_loop::{Episode, EpisodeStart, Replay, Surroundings};
use reactsim_planning::metrics::{History, MissingInputs, judge};
use reactsim_planning::pdm::PdmClosed;
use reactsim_planning::planner::{Planner, PlannerError, PlannerInput, Sample};
use reactsim_planning::tracking::Controller;
use reactsim_planning::{EgoState, Trajectory};

use crate::document::states;
use crate::part::{Largest, Part, documents};

/// Tolerance of every real number. Ends of plans are rounded to 1e-6 in the documents.
const TOLERANCE: f64 = 1e-6;

#[test]
fn episodes_agree_with_the_devkit_and_tuplan_garage() {
    for document in documents("loop") {
        let mut largest = Largest::new(TOLERANCE);
        compare(&document, &mut largest);
        largest.check(document.place());
    }
}

/// PDM-Closed, with a record of its decisions.
#[derive(Default)]
struct Recorded {
    planner: PdmClosed,
    best: Vec<f64>,
    brakes: Vec<bool>,
}

impl Planner for Recorded {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlannerError> {
        let trajectory = self.planner.plan(input)?;
        let cycle = self.planner.cycle().unwrap();
        self.best.push(cycle.best as f64);
        self.brakes.push(cycle.is_emergency_brake);
        Ok(trajectory)
    }
}

/// Compares one episode.
fn compare(document: &Part, largest: &mut Largest) {
    let (map, shape) = (document.map(), document.shape());
    let (route, lights) = (document.route(&map), document.lights(&map));
    let best = document.numbers("best");
    let surroundings = |sample| Surroundings { objects: document.objects(sample), lights: lights.clone() };
    let traffic: Vec<Surroundings> = (0..=best.len()).map(surroundings).collect();
    let ego = document.at("initial").ego();
    let start = EpisodeStart {
        history: vec![Sample { ego, objects: traffic[0].objects.clone() }],
        lights: traffic[0].lights.clone(),
    };
    let episode = Episode {
        map: &map,
        route: &route,
        shape: &shape,
        controller: Controller::LqrBicycle,
        steps: best.len(),
        replan_interval: 1,
    };
    let mut planner = Recorded::default();
    let drive = episode.run(start, &mut planner, &mut Replay::new(traffic)).unwrap();
    compare_states(&drive.samples, &states(&document.json("ego"), document.number("dt")), largest);
    let ends = document.at("plan_end").list();
    for (step, (trajectory, expected)) in drive.trajectories.iter().zip(ends).enumerate() {
        let end = trajectory.states()[trajectory.states().len() - 1];
        for (found, expected) in [end.x, end.y, end.heading].into_iter().zip(expected.floats()) {
            largest.compare(found, expected, || format!("plan_end[{step}]"));
        }
    }
    assert_eq!(planner.best, best, "{}: best", document.place());
    assert_eq!(planner.brakes, document.flags("emergency_brake"), "{}: brakes", document.place());
    compare_score(document, &drive.samples, largest);
}

/// Compares the states of ego.
fn compare_states(samples: &[Sample], expected: &[EgoState], largest: &mut Largest) {
    assert_eq!(samples.len(), expected.len());
    let values = |state: &EgoState| {
        let (pose, motion) = ([state.x, state.y, state.heading], [state.vx, state.vy, state.ax, state.ay]);
        let turn = [state.steering, state.yaw_rate, state.yaw_acceleration];
        [&pose[..], &motion[..], &turn[..]].concat()
    };
    for (step, (sample, expected)) in samples.iter().zip(expected).enumerate() {
        for (value, (found, expected)) in values(&sample.ego).into_iter().zip(values(expected)).enumerate() {
            largest.compare(found, expected, || format!("ego[{step}], value {value}"));
        }
    }
}

/// Compares the score of the drive.
fn compare_score(document: &Part, samples: &[Sample], largest: &mut Largest) {
    let ego: Vec<EgoState> = samples.iter().map(|sample| sample.ego).collect();
    let objects: Vec<_> = samples.iter().map(|sample| sample.objects.clone()).collect();
    let expert = states(&document.json("expert"), document.number("dt"));
    let map = document.map();
    let history = History {
        map: &map,
        shape: document.shape(),
        ego: &ego,
        expert: Some(&expert),
        objects: &objects,
        missing: MissingInputs::AsDevkit,
    };
    let score = judge(&history).unwrap().score.value();
    largest.compare(score, document.at("expected").number("scenario_score"), || "scenario_score".to_owned());
}
