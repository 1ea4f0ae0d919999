//! Plans on a straight road made by hand.

use reactsim_geometry::Vec2;

use super::*;
use crate::fixtures::{LanePart, car, map, straight_road};
use crate::planner::{History, Light, LightState, Route, Sample};
use crate::{EgoShape, EgoState, PlanningMap, TrackedObject};

/// Plans once on the straight road; `iteration`: iteration of the input.
fn plan_at(
    iteration: usize,
    map: &PlanningMap,
    speed: f64,
    objects: Vec<TrackedObject>,
    lights: &[Light],
) -> Result<(PdmClosed, Trajectory), PlanningError> {
    let ids: Vec<&str> = map.roadblocks().iter().map(|block| block.id.as_str()).collect();
    let route = Route::new(map, ids).unwrap();
    let ego = EgoState { time: 2.0, vx: speed, ..EgoState::standing(Vec2::new(10.0, 1.75), 0.0) };
    let samples = [Sample { ego, objects }];
    let input = PlannerInput {
        iteration,
        history: History::new(&samples).unwrap(),
        lights,
        route: &route,
        map,
        shape: &EgoShape::PACIFICA,
        seen: None,
    };
    let mut planner = PdmClosed::new();
    let trajectory = planner.plan(&input)?;
    Ok((planner, trajectory))
}

fn plan(map: &PlanningMap, speed: f64, objects: Vec<TrackedObject>) -> (PdmClosed, Trajectory) {
    plan_at(0, map, speed, objects, &[]).unwrap()
}

#[test]
fn free_roads_are_driven_at_the_limit() {
    let (planner, trajectory) = plan(&straight_road(Some(8.0)), 8.0, Vec::new());
    assert_eq!(trajectory.states().len(), 81);
    assert!((trajectory.start() - 2.0).abs() < 1e-12 && (trajectory.end() - 10.0).abs() < 1e-9);
    let cycle = planner.cycle().unwrap();
    assert_eq!((cycle.proposals.len(), cycle.best), (15, 4));
    assert_eq!(cycle.scores.total[4], 1.0);
    assert_eq!(planner.route(), [0]);
    assert_eq!(planner.centerline().unwrap().length(), 200.0);
}

#[test]
fn slow_cars_are_followed() {
    let road = straight_road(Some(12.0));
    let (_, free) = plan(&road, 8.0, Vec::new());
    let (_, behind) = plan(&road, 8.0, vec![car("a", 40.0, 1.75, 2.0)]);
    let end = |trajectory: &Trajectory| trajectory.states()[80].x;
    assert!(end(&behind) + 10.0 < end(&free));
    // The rear of the car is at 53.75 m after 8 s, the front of ego 4.049 m before its rear axle.
    assert!(end(&behind) + 4.049 < 53.75);
}

#[test]
fn unavoidable_contacts_trigger_the_brake() {
    let (planner, trajectory) = plan(&straight_road(Some(8.0)), 4.5, vec![car("a", 17.0, 1.75, 0.0)]);
    assert!(planner.cycle().unwrap().is_emergency_brake);
    assert_eq!(planner.cycle().unwrap().scores.no_collision, [0.0; 15]);
    assert!((trajectory.states()[0].x - 10.0).abs() < 1e-12);
}

#[test]
fn overlapping_objects_are_ignored() {
    let (planner, _) = plan(&straight_road(Some(8.0)), 4.5, vec![car("a", 12.0, 1.75, 0.0)]);
    let cycle = planner.cycle().unwrap();
    assert!(!cycle.is_emergency_brake);
    assert_eq!(cycle.scores.no_collision, [1.0; 15]);
}

#[test]
fn red_lights_stop_ego() {
    let road = map(&[
        LanePart { x: [0.0, 40.0], successors: &["through"], limit: Some(8.0), ..LanePart::new("lane") },
        LanePart {
            kind: crate::map::LaneKind::Connector,
            x: [40.0, 60.0],
            roadblock: "junction",
            ..LanePart::new("through")
        },
    ]);
    let red = Light { lane: 1, state: LightState::Red };
    let (_, stopped) = plan_at(0, &road, 6.0, Vec::new(), &[red]).unwrap();
    assert!(stopped.states()[80].x + 4.049 < 40.0);
    let (_, free) =
        plan_at(0, &road, 6.0, Vec::new(), &[Light { state: LightState::Yellow, ..red }]).unwrap();
    assert!(free.states()[80].x + 4.049 > 45.0);
}

#[test]
fn parallels_that_leave_the_road_are_not_drivable() {
    // The lane is 3.5 m wide and ego 2.297 m: 1 m beside the centre line it leaves the lane.
    let road = straight_road(Some(8.0));
    let (planner, _) = plan(&road, 8.0, Vec::new());
    let inside = &planner.cycle().unwrap().scores.drivable_area;
    assert_eq!(inside[..5], [1.0; 5]);
    assert!(inside[5..].iter().all(|&score| score == 0.0), "{inside:?}");
}

#[test]
fn plans_begin_at_iteration_zero() {
    let error = plan_at(3, &straight_road(None), 5.0, Vec::new(), &[]).unwrap_err();
    assert_eq!(error.to_string(), "first plan is at iteration 3; planners start at iteration 0");
}
