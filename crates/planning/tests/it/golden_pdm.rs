//! Agreement of planning cycles with values of tuplan_garage. Where the shared data is missing, the test
//! is skipped with a message.

use reactsim_planning::pdm::{Cycle, PdmClosed, Proposal};
use reactsim_planning::planner::{History, Planner, PlannerInput, Sample};
use reactsim_planning::{EgoState, Path};

use crate::part::{Largest, Part, documents};

/// Tolerance of every real number. Positions and scores in the documents are rounded to 1e-6 and 1e-9.
const TOLERANCE: f64 = 1e-6;

#[test]
fn planning_cycles_agree_with_tuplan_garage() {
    for document in documents("pdm") {
        let mut largest = Largest::new(TOLERANCE);
        compare(&document, &mut largest);
        largest.check(document.place());
    }
}

/// Compares one planning cycle.
fn compare(document: &Part, largest: &mut Largest) {
    let map = document.map();
    let route = document.route(&map);
    let samples = [Sample { ego: document.at("initial").ego(), objects: document.objects(0) }];
    let input = PlannerInput {
        iteration: 0,
        history: History::new(&samples).unwrap(),
        lights: &document.lights(&map, 0),
        route: &route,
        map: &map,
        shape: &document.shape(),
        seen: None,
    };
    let mut planner = PdmClosed::new();
    let trajectory = planner.plan(&input).unwrap();
    let expected = document.at("expected");
    let cycle = planner.cycle().unwrap();
    compare_centerline(planner.centerline().unwrap(), &expected, largest);
    compare_proposals(cycle, &expected, largest);
    compare_simulation(cycle, &expected.at("simulated"), largest);
    compare_scores(cycle, &expected, largest);
    assert_eq!(cycle.best as f64, expected.number("best"), "{}: best", document.place());
    assert_eq!(cycle.is_emergency_brake, expected.flag("emergency_brake"), "{}: brake", document.place());
    let states = trajectory.states();
    compare_states(states, &expected.at("trajectory"), largest);
}

fn compare_centerline(found: &Path, expected: &Part, largest: &mut Largest) {
    let expected = expected.at("centreline");
    assert_eq!(found.states().len() as f64, expected.number("points"));
    largest.compare(found.length(), expected.number("length"), || "length".to_owned());
    let ends = [("first", found.states()[0]), ("last", found.states()[found.states().len() - 1])];
    for (name, state) in ends {
        let point = expected.numbers(name);
        largest.compare(state.position.x, point[0], || format!("centreline.{name}"));
        largest.compare(state.position.y, point[1], || format!("centreline.{name}"));
    }
}

fn compare_proposals(cycle: &Cycle, expected: &Part, largest: &mut Largest) {
    for (i, target) in expected.numbers("target_velocities").into_iter().enumerate() {
        largest.compare(cycle.proposals[i].target_speed, target, || format!("target_velocities[{i}]"));
    }
    let expected = expected.at("proposals");
    type Value = fn(&Proposal, usize) -> f64;
    let series: [(&str, Value); 5] = [
        ("progress", |proposal, step| proposal.progress[step]),
        ("velocity", |proposal, step| proposal.speeds[step]),
        ("lead_progress", |proposal, step| proposal.leaders[step].progress),
        ("lead_velocity", |proposal, step| proposal.leaders[step].speed),
        ("lead_rear", |proposal, step| proposal.leaders[step].rear),
    ];
    for (name, of) in series {
        let rows = expected.at(name).list();
        assert_eq!(rows.len(), cycle.proposals.len(), "{name}");
        for (number, row) in rows.iter().enumerate() {
            for (step, value) in row.floats().into_iter().enumerate() {
                let found = of(&cycle.proposals[number], step);
                largest.compare(found, value, || format!("proposals.{name}[{number}][{step}]"));
            }
        }
    }
}

fn compare_simulation(cycle: &Cycle, expected: &Part, largest: &mut Largest) {
    type Value = fn(&EgoState) -> f64;
    let series: [(&str, Value); 4] = [
        ("x", |state| state.x),
        ("y", |state| state.y),
        ("heading", |state| state.heading),
        ("v", |state| state.vx),
    ];
    for (name, of) in series {
        for (number, row) in expected.at(name).list().iter().enumerate() {
            for (step, value) in row.floats().into_iter().enumerate() {
                let found = of(&cycle.simulated[number][step]);
                largest.compare(found, value, || format!("simulated.{name}[{number}][{step}]"));
            }
        }
    }
}

fn compare_scores(cycle: &Cycle, expected: &Part, largest: &mut Largest) {
    let scores = &cycle.scores;
    let verdicts = [
        ("no_collision", &scores.no_collision),
        ("drivable_area", &scores.drivable_area),
        ("driving_direction", &scores.driving_direction),
        ("ttc", &scores.ttc),
        ("comfortable", &scores.comfortable),
    ];
    for (name, found) in verdicts {
        assert_eq!(*found, expected.numbers(name), "{name}");
    }
    let reals = [
        ("progress_raw", &scores.progress_distance),
        ("progress", &scores.progress),
        ("collision_time", &scores.collision_time),
        ("scores", &scores.total),
    ];
    for (name, found) in reals {
        for (number, value) in expected.numbers(name).into_iter().enumerate() {
            largest.compare(found[number], value, || format!("{name}[{number}]"));
        }
    }
}

fn compare_states(states: &[EgoState], expected: &Part, largest: &mut Largest) {
    type Value = fn(&EgoState) -> f64;
    let series: [(&str, Value); 3] =
        [("x", |state| state.x), ("y", |state| state.y), ("heading", |state| state.heading)];
    for (name, of) in series {
        let values = expected.numbers(name);
        assert_eq!(values.len(), states.len(), "{name}");
        for (step, value) in values.into_iter().enumerate() {
            largest.compare(of(&states[step]), value, || format!("trajectory.{name}[{step}]"));
        }
    }
}
