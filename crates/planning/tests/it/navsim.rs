//! The scores of NAVSIM on drives made by hand.

use reactsim_geometry::Vec2;
use reactsim_planning::metrics::{
    HistoryError, MetricValue, NavsimInput, NavsimMetric, NavsimScores, NavsimVersion, UndefinedReason,
    judge, judge_navsim,
};
use reactsim_planning::pdm;
use reactsim_planning::planner::{self, Light, LightState, PlannerInput, Route, Sample};
use reactsim_planning::{EgoShape, EgoState, ObjectKind, Path, PlanningMap};

use crate::drive::{C, Drive, SAMPLES, straight, v};

/// The inputs of NAVSIM in addition to the history.
struct Extras {
    /// State of the light of connector `c`, by sample; `None` without lights.
    light: Option<fn(usize) -> LightState>,
    has_route: bool,
    past: Vec<EgoState>,
}

impl Default for Extras {
    fn default() -> Self {
        Self { light: Some(|_| LightState::Green), has_route: true, past: Vec::new() }
    }
}

/// Returns the centre line of the route.
fn centerline(map: &PlanningMap, route: &Route) -> Path {
    let samples = [Sample { ego: EgoState::standing(v(0.0, 1.75), 0.0), objects: Vec::new() }];
    let input = PlannerInput {
        iteration: 0,
        history: planner::History::new(&samples).unwrap(),
        lights: &[],
        route,
        map,
        shape: &EgoShape::PACIFICA,
        seen: None,
    };
    pdm::centerline(&input).unwrap()
}

fn judged(drive: Drive, extras: &Extras) -> NavsimScores {
    let map = PlanningMap::new(drive.map.clone()).unwrap();
    let route = Route::new(&map, ["r1", "rc", "r3"]).unwrap();
    let centerline = extras.has_route.then(|| centerline(&map, &route));
    let lights = extras
        .light
        .map(|state| (0..SAMPLES).map(|k| vec![Light { lane: C, state: state(k) }]).collect::<Vec<_>>());
    drive.with_history(|history| {
        let input = NavsimInput {
            history,
            scores: &judge(history).unwrap(),
            route: extras.has_route.then_some(&route),
            centerline: centerline.as_ref(),
            lights: lights.as_deref(),
            past: &extras.past,
        };
        judge_navsim(&input).unwrap()
    })
}

fn of(drive: Drive) -> NavsimScores {
    judged(drive, &Extras::default())
}

fn undisturbed() -> Drive {
    Drive::straight(v(0.0, 1.75), 0.0, 10.0)
}

#[test]
fn an_undisturbed_drive_scores_one_without_what_is_undefined() {
    let past = straight(v(-10.0, 1.75), 0.0, 10.0)[..10].to_vec();
    let scores = judged(undisturbed(), &Extras { past, ..Extras::default() });
    assert!((scores.progress_distance.unwrap() - 80.0).abs() < 1e-9);
    let reference = scores.masked_progress(NavsimVersion::V1);
    let pdms = scores.pdms(reference);
    assert_eq!((pdms.value, pdms.undefined().count()), (1.0, 0));
    let epdms = scores.epdms(reference, None);
    assert_eq!(epdms.value, 1.0);
    let undefined = [(NavsimMetric::ExtendedComfort, UndefinedReason::SuccessivePlans)];
    assert_eq!(epdms.undefined().collect::<Vec<_>>(), undefined);
}

#[test]
fn missing_inputs_leave_metrics_undefined() {
    let scores = judged(undisturbed(), &Extras { light: None, has_route: false, past: Vec::new() });
    let undefined: Vec<_> = scores.epdms(Some(80.0), None).undefined().collect();
    let expected = [
        (NavsimMetric::DrivingDirection, UndefinedReason::NoRoute),
        (NavsimMetric::TrafficLights, UndefinedReason::NoTrafficLights),
        (NavsimMetric::Progress, UndefinedReason::NoCenterline),
        (NavsimMetric::LaneKeeping, UndefinedReason::NoCenterline),
        (NavsimMetric::HistoryComfort, UndefinedReason::NoPast),
        (NavsimMetric::ExtendedComfort, UndefinedReason::SuccessivePlans),
    ];
    assert_eq!(undefined, expected);
    assert_eq!(scores.masked_progress(NavsimVersion::V1), None);
    let without_reference: Vec<_> = of(undisturbed()).pdms(None).undefined().collect();
    assert_eq!(without_reference, [(NavsimMetric::Progress, UndefinedReason::NoReferenceProgress)]);
}

#[test]
fn progress_is_relative_to_the_larger_one() {
    let progress = |scores: &NavsimScores, version, reference: f64| {
        let score = match version {
            NavsimVersion::V1 => scores.pdms(Some(reference)),
            NavsimVersion::V2 => scores.epdms(Some(reference), None),
        };
        score.values.iter().find(|(metric, _)| *metric == NavsimMetric::Progress).unwrap().1.value().unwrap()
    };
    let scores = of(undisturbed());
    for version in [NavsimVersion::V1, NavsimVersion::V2] {
        assert!((progress(&scores, version, 100.0) - 0.8).abs() < 1e-12);
        assert_eq!(progress(&scores, version, 60.0), 1.0);
    }
    // A barrier halves the product: v1 compares 40 m, v2 the whole 80 m.
    let barrier = |drive: Drive| drive.with("b", ObjectKind::Barrier, v(40.0, 1.75), 0.0, Vec2::zeros());
    let hit = of(barrier(undisturbed()));
    assert!((progress(&hit, NavsimVersion::V1, 100.0) - 0.4).abs() < 1e-12);
    assert!((progress(&hit, NavsimVersion::V2, 100.0) - 0.8).abs() < 1e-12);
    // Progress up to 5 m is not compared.
    let slow = of(Drive::straight(v(0.0, 1.75), 0.0, 0.5));
    assert_eq!(progress(&slow, NavsimVersion::V1, 4.9), 1.0);
    let crash = of(undisturbed().with("w", ObjectKind::Vehicle, v(8.0, 1.75), 0.0, Vec2::zeros()));
    assert_eq!(progress(&crash, NavsimVersion::V1, 4.9), 0.0);
    assert_eq!(progress(&crash, NavsimVersion::V2, 4.9), 1.0);
}

#[test]
fn any_number_of_static_objects_costs_half() {
    let mut drive = undisturbed();
    for (id, x) in [("b", 40.0), ("c", 60.0), ("d", 70.0)] {
        drive = drive.with(id, ObjectKind::Barrier, v(x, 1.75), 0.0, Vec2::zeros());
    }
    assert_eq!(of(drive).value(NavsimMetric::Collisions), MetricValue::Defined(0.5));
}

#[test]
fn lateral_contacts_are_the_fault_of_ego_across_lanes() {
    let beside = |y: f64| {
        let drive = Drive::straight(v(0.0, y), 0.0, 10.0);
        of(drive.with("w", ObjectKind::Vehicle, v(1.5, y + 4.25), 0.0, v(10.0, -1.0)))
            .value(NavsimMetric::Collisions)
    };
    assert_eq!(beside(1.75), MetricValue::Defined(1.0));
    assert_eq!(beside(0.0), MetricValue::Defined(0.0));
}

#[test]
fn corners_off_the_road_have_no_tolerance() {
    // The left side is 0.1 m off the road, which nuPlan tolerates.
    let scores = of(Drive::straight(v(0.0, 3.5 - 1.1485 + 0.1), 0.0, 10.0));
    assert_eq!(scores.value(NavsimMetric::DrivableArea), MetricValue::Defined(0.0));
}

#[test]
fn lanes_off_the_route_are_oncoming_except_in_intersections() {
    let direction = |x: f64, speed: f64| {
        of(Drive::straight(v(x, -1.75), 0.0, speed)).value(NavsimMetric::DrivingDirection)
    };
    // Eleven increments of 0.18 m are 1.98 m, of 0.19 m 2.09 m.
    assert_eq!(direction(0.0, 1.8), MetricValue::Defined(1.0));
    assert_eq!(direction(0.0, 1.9), MetricValue::Defined(0.5));
    assert_eq!(direction(0.0, 5.6), MetricValue::Defined(0.0));
    // The intersection extends from 150 to 180 m.
    assert_eq!(direction(151.0, 3.0), MetricValue::Defined(1.0));
}

#[test]
fn red_connectors_must_not_be_touched() {
    let lights = |light: fn(usize) -> LightState| {
        let extras = Extras { light: Some(light), ..Extras::default() };
        judged(Drive::straight(v(140.0, 1.75), 0.0, 5.0), &extras).value(NavsimMetric::TrafficLights)
    };
    assert_eq!(lights(|_| LightState::Red), MetricValue::Defined(0.0));
    assert_eq!(lights(|_| LightState::Yellow), MetricValue::Defined(1.0));
    // The front passes x = 150 m at sample 12. A light that turns red afterwards counts as well.
    assert_eq!(
        lights(|k| if k < 12 { LightState::Red } else { LightState::Green }),
        MetricValue::Defined(1.0)
    );
    assert_eq!(
        lights(|k| if k < 20 { LightState::Green } else { LightState::Red }),
        MetricValue::Defined(0.0)
    );
}

#[test]
fn objects_are_met_where_they_will_be() {
    let ttc = |x: f64, speed: f64| {
        let drive = undisturbed().with("w", ObjectKind::Vehicle, v(x, 1.75), 0.0, v(speed, 0.0));
        of(drive).value(NavsimMetric::TimeToCollision)
    };
    // Bumper to bumper: 4.049 m before and 2 m behind the reference points. Projections reach 9 m.
    assert_eq!(ttc(4.049 + 2.0 + 1.0, 10.0), MetricValue::Defined(1.0));
    assert_eq!(ttc(4.049 + 2.0 + 8.9, 0.0), MetricValue::Defined(0.0));
    // At sample 71, the last one that is judged, the gap is 9.1 m; it would be short afterwards.
    assert_eq!(ttc(4.049 + 2.0 + 71.0 + 9.1, 0.0), MetricValue::Defined(1.0));
    assert_eq!(ttc(4.049 + 2.0 + 71.0 + 8.9, 0.0), MetricValue::Defined(0.0));
}

#[test]
fn deviations_of_two_seconds_fail_lane_keeping() {
    let keeping = |from: usize, to: usize| {
        let mut drive = undisturbed();
        drive.ego[from..to].iter_mut().for_each(|state| state.y += 0.6);
        of(drive).value(NavsimMetric::LaneKeeping)
    };
    assert_eq!(keeping(10, 29), MetricValue::Defined(1.0));
    assert_eq!(keeping(10, 30), MetricValue::Defined(0.0));
    // Intersections interrupt nothing: 10 samples before x = 150 m, 30 within, 10 after.
    let mut drive = Drive::straight(v(150.0 - 1.461 - 20.5, 1.75), 0.0, 10.0);
    drive.ego[11..61].iter_mut().for_each(|state| state.y += 0.6);
    assert_eq!(of(drive).value(NavsimMetric::LaneKeeping), MetricValue::Defined(0.0));
}

#[test]
fn history_comfort_includes_the_past() {
    let comfort = |past_speed: f64| {
        let past = straight(v(-10.0, 1.75), 0.0, past_speed)[..10].to_vec();
        let past = past.into_iter().map(|state| EgoState { ax: past_speed - 10.0, ..state }).collect();
        judged(undisturbed(), &Extras { past, ..Extras::default() }).value(NavsimMetric::HistoryComfort)
    };
    assert_eq!(comfort(10.0), MetricValue::Defined(1.0));
    assert_eq!(comfort(15.0), MetricValue::Defined(0.0));
}

#[test]
fn metrics_that_the_human_driver_fails_count_as_one() {
    let beside = || of(Drive::straight(v(0.0, -1.75), 0.0, 6.0));
    let unfiltered = beside().epdms(Some(48.0), None);
    assert_eq!((unfiltered.value, unfiltered.filtered.len()), (0.0, 0));
    let filtered = beside().epdms(Some(48.0), Some(&beside()));
    assert_eq!(filtered.filtered, [NavsimMetric::DrivingDirection, NavsimMetric::LaneKeeping]);
    assert_eq!(filtered.value, 1.0);
    // v1 has no filter and neither metric.
    assert_eq!(beside().pdms(Some(48.0)).value, 1.0);
}

#[test]
fn lights_are_given_per_sample() {
    let drive = undisturbed();
    let found = drive.with_history(|history| {
        let scores = judge(history).unwrap();
        let lights = vec![Vec::new(); 3];
        let input = NavsimInput {
            history,
            scores: &scores,
            route: None,
            centerline: None,
            lights: Some(&lights),
            past: &[],
        };
        judge_navsim(&input).unwrap_err()
    });
    assert_eq!(found, HistoryError::Lights { ego: SAMPLES, lights: 3 });
}
