//! Agreement of the tracker with values of the nuPlan devkit. Where the shared data is missing, the test is
//! skipped with a message.

use reactsim_geometry::Vec2;
use reactsim_planning::tracking::{Bicycle, Controller, LateralState, Reference, command, is_stopping};
use reactsim_planning::{EgoShape, EgoState, Trajectory};

use crate::part::{Largest, Part, documents};

const TOLERANCE: f64 = 1e-9;

#[test]
fn the_tracker_agrees_with_the_devkit() {
    for document in documents("tracking") {
        let mut largest = Largest::new(TOLERANCE);
        compare(&document, &mut largest);
        largest.check(document.place());
    }
}

/// Compares the tracking of one reference.
fn compare(document: &Part, largest: &mut Largest) {
    let expected = document.at("expected");
    let shape = EgoShape { wheelbase: document.at("vehicle").number("wheel_base"), ..EgoShape::PACIFICA };
    let mut ego = document.at("initial").ego();
    let trajectory = Trajectory::new(reference_states(&document.at("reference")), &ego).unwrap();
    let reference = Reference::new(&trajectory);
    compare_reference(&trajectory, &reference, &expected, largest);
    let (commands, states) = (expected.at("commands"), expected.at("states"));
    let steps = commands.numbers("acceleration").len();
    for step in 0..steps {
        let target = reference.target(ego.time);
        let lateral = LateralState::new((&ego).into(), ego.steering, target.pose);
        let command = command(lateral, ego.vx, &target, shape.wheelbase);
        let found = [
            ("reference_velocity", target.speed),
            ("lateral_error", lateral.offset),
            ("heading_error", lateral.heading),
            ("acceleration", command.acceleration),
            ("steering_rate", command.steering_rate),
        ];
        for (name, value) in found {
            largest.compare(value, commands.numbers(name)[step], || format!("commands.{name}[{step}]"));
        }
        assert_eq!(is_stopping(ego.vx, target.speed), commands.flags("stopping")[step], "stopping[{step}]");
        let lagged = Bicycle::of(&shape).lagged(&ego, command);
        ego = Controller::LqrBicycle.advance(&ego, &shape, &trajectory).unwrap();
        let found = [
            ("x", ego.x),
            ("y", ego.y),
            ("heading", ego.heading),
            ("v", ego.vx),
            ("a", ego.ax),
            ("steering", ego.steering),
            ("steering_rate", lagged.steering_rate),
            ("yaw_rate", ego.yaw_rate),
            ("yaw_acceleration", ego.yaw_acceleration),
        ];
        for (name, value) in found {
            largest.compare(value, states.numbers(name)[step + 1], || format!("states.{name}[{}]", step + 1));
        }
    }
}

/// Returns the states of the reference: poses at rest, at constant intervals.
fn reference_states(reference: &Part) -> Vec<EgoState> {
    let (x, y, heading) = (reference.numbers("x"), reference.numbers("y"), reference.numbers("heading"));
    let interval = reference.number("interval");
    (0..x.len())
        .map(|i| EgoState {
            time: interval * i as f64,
            ..EgoState::standing(Vec2::new(x[i], y[i]), heading[i])
        })
        .collect()
}

/// Compares the resampled trajectory and its profile.
fn compare_reference(
    trajectory: &Trajectory,
    reference: &Reference<'_>,
    expected: &Part,
    largest: &mut Largest,
) {
    let (poses, resampled) = (trajectory.resampled(), expected.at("resampled"));
    let profile = reference.profile();
    let series: [(&str, Vec<f64>, Vec<f64>); 5] = [
        ("x", poses.iter().map(|pose| pose.position.x).collect(), resampled.numbers("x")),
        ("y", poses.iter().map(|pose| pose.position.y).collect(), resampled.numbers("y")),
        ("heading", poses.iter().map(|pose| pose.heading).collect(), resampled.numbers("heading")),
        ("velocity_profile", profile.speeds.clone(), expected.numbers("velocity_profile")),
        ("curvature_profile", profile.curvatures.clone(), expected.numbers("curvature_profile")),
    ];
    for (name, found, expected) in series {
        assert_eq!(found.len(), expected.len(), "{name}");
        for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
            largest.compare(*found, expected, || format!("{name}[{i}]"));
        }
    }
}
