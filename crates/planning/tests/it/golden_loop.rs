//! Agreement of whole episodes of PDM-Closed and of the IDM planner with the nuPlan devkit and tuplan_garage,
//! with recorded and with reactive traffic. Where the shared data is missing, the test is skipped with a
//! message.

use std::sync::Arc;

use reactsim_planning::closed_loop::{Episode, EpisodeStart, Replay, Surroundings, Traffic};
use reactsim_planning::idm_agents::{IdmAgents, SeenEgo, Step, seen};
use reactsim_planning::idm_planner::IdmPlanner;
use reactsim_planning::pdm::PdmClosed;
use reactsim_planning::planner::{Planner, PlannerInput, Sample};
use reactsim_planning::tracking::Controller;
use reactsim_planning::{EgoShape, EgoState, PlanningError, TrackedObject, Trajectory};

use crate::document::{Document, states};
use crate::golden_metrics;
use crate::part::{Largest, Part, documents};

/// Tolerance of every real number. Ends of plans are rounded to 1e-6 in the documents.
const TOLERANCE: f64 = 1e-6;

#[test]
fn episodes_agree_with_the_devkit_and_tuplan_garage() {
    for folder in ["loop", "loop15", "loop15_reactive"] {
        for document in documents(folder) {
            let mut largest = Largest::new(TOLERANCE);
            compare(&document, &mut largest);
            largest.check(document.place());
        }
    }
}

/// PDM-Closed, with a record of its decisions.
#[derive(Default)]
struct Recorded {
    planner: PdmClosed,
    best: Vec<usize>,
    brakes: Vec<bool>,
}

impl Planner for Recorded {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let trajectory = self.planner.plan(input)?;
        let cycle = self.planner.cycle().unwrap();
        self.best.push(cycle.best);
        self.brakes.push(cycle.is_emergency_brake);
        Ok(trajectory)
    }
}

/// Reactive agents and recorded objects.
struct ReactiveTraffic {
    agents: IdmAgents,
    recorded: Vec<Surroundings>,
    shape: EgoShape,
}

impl ReactiveTraffic {
    /// Returns the surroundings at a sample, which the agents have reached.
    fn now(&self, sample: usize) -> Surroundings {
        let recorded = &self.recorded[sample];
        let agents = self.agents.agents().iter().map(|agent| agent.object());
        let objects = agents.chain(seen(&recorded.objects).cloned()).collect();
        Surroundings { objects, lights: recorded.lights.clone() }
    }
}

impl Traffic for ReactiveTraffic {
    fn advance(&mut self, iteration: usize, ego: &EgoState) -> Result<Surroundings, PlanningError> {
        let ego = SeenEgo::new(ego, &self.shape);
        let recorded = &self.recorded[iteration];
        let (objects, lights) = (&recorded.objects, &recorded.lights);
        self.agents.step(&Step { center: ego.footprint.center, ego: Some(ego), objects, lights });
        Ok(self.now(iteration))
    }
}

/// Compares one episode.
fn compare(document: &Part, largest: &mut Largest) {
    let (map, shape, steps) = (document.map(), document.shape(), document.at("plan_end").len());
    let route = document.route(&map);
    let surroundings = |k| Surroundings { objects: document.objects(k), lights: document.lights(&map, k) };
    let recorded: Vec<Surroundings> = (0..=steps).map(surroundings).collect();
    let ego = document.at("initial").ego();
    let (now, mut traffic): (Surroundings, Box<dyn Traffic>) = if document.has("agents") {
        let (roads, parameters) = (Arc::new(document.agent_roads()), document.agent_parameters());
        let seen_ego = SeenEgo::new(&ego, &shape);
        let agents = IdmAgents::new(roads, parameters, &recorded[0].objects, Some(&seen_ego));
        let traffic = ReactiveTraffic { agents, recorded, shape };
        (traffic.now(0), Box::new(traffic))
    } else {
        (recorded[0].clone(), Box::new(Replay::new(recorded)))
    };
    let start = EpisodeStart { history: vec![Sample { ego, objects: now.objects }], lights: now.lights };
    let episode = Episode {
        map: &map,
        route: &route,
        shape: &shape,
        controller: Controller::LqrBicycle,
        steps,
        replan_interval: 1,
    };
    let is_pdm = document.has("best");
    let mut pdm = Recorded::default();
    let planner: &mut dyn Planner = if is_pdm { &mut pdm } else { &mut IdmPlanner::new() };
    let drive = episode.run(start, planner, traffic.as_mut()).unwrap();
    compare_states(&drive.samples, &states(&document.json("ego"), document.number("dt")), largest);
    let ties = ties(document, is_pdm);
    for (step, trajectory) in drive.trajectories.iter().enumerate().filter(|(k, _)| ties[*k].len() == 1) {
        let end = trajectory.states()[trajectory.states().len() - 1];
        let expected = document.at("plan_end").list()[step].floats();
        for (found, expected) in [end.x, end.y, end.heading].into_iter().zip(expected) {
            largest.compare(found, expected, || format!("plan_end[{step}]"));
        }
    }
    if is_pdm {
        for (step, best) in pdm.best.iter().enumerate() {
            assert!(ties[step].contains(&(*best as f64)), "{}: best[{step}]", document.place());
        }
        assert_eq!(pdm.brakes, document.flags("emergency_brake"), "{}: brakes", document.place());
    }
    compare_metrics(document, drive.samples.into_iter().map(|sample| sample.objects).collect());
}

/// Returns the proposals of PDM-Closed that are the best in each step: more than one where their scores differ
/// by rounding only. One element per step for other planners.
fn ties(document: &Part, is_pdm: bool) -> Vec<Vec<f64>> {
    if document.has("ties") {
        document.at("ties").list().iter().map(Part::floats).collect()
    } else if is_pdm {
        document.numbers("best").into_iter().map(|best| vec![best]).collect()
    } else {
        vec![vec![0.0]; document.at("plan_end").len()]
    }
}

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

/// Compares all metrics of the recorded ego among the objects of the episode.
fn compare_metrics(document: &Part, objects: Vec<Vec<TrackedObject>>) {
    let differences = golden_metrics::compare(&Document { objects, ..document.document() });
    assert!(differences.is_empty(), "{}", differences.join("\n"));
}
