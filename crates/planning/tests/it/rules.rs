//! The rules of the metrics that surprise, by arithmetic that can be done by hand.

use std::f64::consts::PI;

use reactsim_planning::map::{DrivableArea, LaneKind, PlanningMapParts};
use reactsim_planning::metrics::{
    ContactClass, History, Label, MetricValue, MissingInputs, PlannerMetric, PlannerScores, UndefinedReason,
    judge,
};
use reactsim_planning::{EgoShape, EgoState, ObjectKind, PlanningMap};

use crate::drive::{A, A2, C, D, Drive, LIMIT, O, SAMPLES, object, parts, rectangle, straight, v};

/// Front of ego before the rear axle, metres.
const FRONT: f64 = 4.049;

fn defined(scores: &PlannerScores, metric: PlannerMetric) -> f64 {
    scores.value(metric).value().unwrap()
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-9
}

#[test]
fn an_undisturbed_drive_scores_one() {
    let scores = Drive::straight(v(0.0, 1.75), 0.0, 10.0).judge();
    assert_eq!(scores.score.cls(), Some(1.0));
    assert_eq!(scores.mean_speed, 10.0);
}

#[test]
fn an_object_counts_at_its_first_contact_only() {
    // The object touches ego from behind while ego drives, and stands in its way later.
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 5.0);
    let vehicle = |x: f64, speed: f64| object("w", ObjectKind::Vehicle, v(x, 1.75), 0.0, v(speed, 0.0));
    drive.objects[0].push(vehicle(-3.0, 6.0));
    drive.objects[40].push(vehicle(25.0, 0.0));
    let scores = drive.judge();
    assert_eq!(scores.collisions.contacts.len(), 1);
    assert_eq!(scores.collisions.contacts[0].class, ContactClass::ActiveRear);
    assert_eq!(defined(&scores, PlannerMetric::Collisions), 1.0);
}

#[test]
fn touching_at_the_first_sample_is_a_contact() {
    let drive = Drive::straight(v(0.0, 0.0), 0.0, 1.0);
    // Half of the length of the object is 2 m; one step of rounding would decide at exact contact.
    let scores = drive.with("w", ObjectKind::Barrier, v(FRONT + 2.0 - 1e-9, 0.0), 0.0, v(0.0, 0.0)).judge();
    let contact = &scores.collisions.contacts[0];
    assert_eq!((contact.step, contact.class, contact.at_fault), (0, ContactClass::StoppedTrack, Some(true)));
    assert_eq!(contact.delta_v, 0.5);
}

#[test]
fn one_barrier_costs_half_and_the_time_to_collision() {
    let scores = Drive::straight(v(0.0, 1.75), 0.0, 10.0)
        .with("w", ObjectKind::Barrier, v(40.0, 1.75), 0.0, v(0.0, 0.0))
        .judge();
    assert_eq!(defined(&scores, PlannerMetric::Collisions), 0.5);
    assert_eq!(defined(&scores, PlannerMetric::TimeToCollision), 0.0);
    assert_eq!(scores.score.cls(), Some(0.34375));
}

#[test]
fn ego_is_never_at_fault_while_it_stands() {
    let scores = Drive::straight(v(0.0, 1.75), 0.0, 0.05)
        .with("w", ObjectKind::Vehicle, v(20.0, 1.75), PI, v(-5.0, 0.0))
        .judge();
    assert_eq!(scores.collisions.contacts[0].class, ContactClass::StoppedEgo);
    assert_eq!(defined(&scores, PlannerMetric::Collisions), 1.0);
}

/// Ego in its lane while another vehicle slides into its left side.
fn side_contact() -> Drive {
    Drive::straight(v(0.0, 1.75), 0.0, 10.0).with("w", ObjectKind::Vehicle, v(1.5, 6.0), 0.0, v(10.0, -1.0))
}

fn without_lanes(map: PlanningMapParts) -> PlanningMapParts {
    PlanningMapParts { lanes: Vec::new(), ..map }
}

#[test]
fn a_lateral_contact_in_the_own_lane_is_not_the_fault_of_ego() {
    let scores = side_contact().judge();
    let contact = &scores.collisions.contacts[0];
    assert_eq!((contact.class, contact.at_fault), (ContactClass::ActiveLateral, Some(false)));
}

#[test]
fn a_lateral_contact_without_lanes_leaves_two_metrics_undefined() {
    let mut drive = side_contact();
    drive.map = without_lanes(drive.map);
    let scores = drive.judge();
    let undecided = MetricValue::Undefined(UndefinedReason::LateralContactWithoutLanes);
    assert_eq!(scores.collisions.contacts[0].at_fault, None);
    assert_eq!(scores.value(PlannerMetric::Collisions), undecided);
    assert_eq!(scores.value(PlannerMetric::TimeToCollision), undecided);
    assert_eq!(scores.score.id(), "cls-partial");
    assert!(scores.labels.contains(&Label::TtcAheadOnly));
}

#[test]
fn without_lanes_four_metrics_are_undefined() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 10.0);
    drive.map = without_lanes(drive.map);
    let scores = drive.judge();
    let no_lanes = MetricValue::Undefined(UndefinedReason::NoLanes);
    for metric in [
        PlannerMetric::DrivingDirection,
        PlannerMetric::Progress,
        PlannerMetric::MakingProgress,
        PlannerMetric::SpeedLimit,
    ] {
        assert_eq!(scores.value(metric), no_lanes, "{}", metric.id());
    }
    assert_eq!(scores.in_common_lane, None);
    assert_eq!(scores.score.value(), 1.0);
    assert_eq!(scores.score.cls(), None);
}

/// Ego whose right side is `outside` metres below the drivable ground and below all lanes.
fn beside_the_road(outside: f64) -> PlannerScores {
    let mut drive = Drive::straight(v(0.0, 1.1485), 0.0, 10.0);
    drive.map.lanes.truncate(1);
    drive.map.lanes[A].0.successors.clear();
    drive.map.lanes[A].1 = rectangle([-50.0, 150.0], [outside, 3.5]);
    drive.map.drivable = DrivableArea::of_areas(vec![rectangle([-50.0, 150.0], [outside, 3.5])]);
    drive.judge()
}

#[test]
fn a_corner_may_be_less_than_thirty_centimetres_off_the_road() {
    let inside = beside_the_road(0.29);
    assert_eq!(defined(&inside, PlannerMetric::DrivableArea), 1.0);
    assert!(!inside.drivable_area.corners_inside[0], "tolerated, but outside");
    let off_road = beside_the_road(0.3 + 1e-9);
    assert_eq!(defined(&off_road, PlannerMetric::DrivableArea), 0.0);
    assert_eq!(off_road.drivable_area.off_road[0].step, 0);
}

#[test]
fn a_corner_in_a_lane_is_inside_where_the_drivable_ground_leaves_the_lane_out() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 10.0);
    drive.map.drivable = DrivableArea::of_areas(vec![rectangle([300.0, 400.0], [-3.5, 3.5])]);
    let scores = drive.judge();
    assert!(scores.drivable_area.corners_inside.iter().all(|&inside| inside));
}

#[test]
fn without_drivable_ground_the_metric_is_undefined() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 10.0);
    drive.map.drivable = DrivableArea::Unknown;
    let value = drive.judge().value(PlannerMetric::DrivableArea);
    assert_eq!(value, MetricValue::Undefined(UndefinedReason::NoDrivableArea));
}

#[test]
fn the_driving_direction_sums_eleven_increments() {
    // 1.9 m/s against lane `o`: 1.9 m in the documented second, but 2.09 m in eleven increments.
    let scores = Drive::straight(v(0.0, -1.75), 0.0, 1.9).judge();
    assert!(near(scores.driving_direction.lowest, -2.09));
    assert_eq!(defined(&scores, PlannerMetric::DrivingDirection), 0.5);
    let slower = Drive::straight(v(0.0, -1.75), 0.0, 1.8).judge();
    assert_eq!(defined(&slower, PlannerMetric::DrivingDirection), 1.0);
}

#[test]
fn reversing_in_the_own_lane_is_motion_against_it() {
    let scores = Drive::straight(v(50.0, 1.75), 0.0, -3.0).judge();
    assert_eq!(defined(&scores, PlannerMetric::DrivingDirection), 0.5);
    assert_eq!(scores.mean_speed, 3.0);
}

#[test]
fn a_change_of_lane_loses_the_progress_of_two_samples() {
    // The centre passes x = 150 between the samples 8 and 9: its lane changes from `a` to `c`.
    let scores = Drive::straight(v(140.0, 1.75), 0.0, 10.0).judge();
    assert_eq!(scores.center_lanes[8], [A]);
    assert_eq!(scores.center_lanes[9], [C, D]);
    assert!(near(scores.driving_direction.progress[8], 8.0));
    assert!(near(scores.driving_direction.progress[10], 8.0));
    // Eleven increments up to sample 11: the samples 1 to 8 and 11.
    assert!(near(scores.driving_direction.progress[11], 9.0));
}

#[test]
fn a_projection_on_the_start_of_a_lane_is_no_motion() {
    // Ego drives against `o` and over its start at x = 150 m, which lies within the polygon of a long lane.
    let mut drive = Drive::straight(v(147.0, -1.75), 0.0, 3.0);
    drive.map.lanes[O].1 = rectangle([-50.0, 200.0], [-3.5, 0.0]);
    let scores = drive.judge();
    // The centre is 1.539 m before the start: five steps of 0.3 m count, the sixth would end at arc length 0.
    assert!(near(scores.driving_direction.lowest, -1.5));
    assert_eq!(defined(&scores, PlannerMetric::DrivingDirection), 1.0);
}

/// Ego stands, and the expert drives at a speed.
fn standing_beside(expert_speed: f64) -> PlannerScores {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 0.0);
    drive.expert = Some(straight(v(0.0, 1.75), 0.0, expert_speed));
    drive.judge()
}

#[test]
fn a_standing_planner_makes_progress_if_the_expert_is_slow() {
    let slow = standing_beside(1.2);
    assert!(near(slow.progress.expert_total, 9.6));
    assert!(near(defined(&slow, PlannerMetric::Progress), 2.0 / 9.6));
    assert_eq!(defined(&slow, PlannerMetric::MakingProgress), 1.0);
    assert_eq!(defined(&standing_beside(1.3), PlannerMetric::MakingProgress), 0.0);
    assert_eq!(defined(&standing_beside(0.2), PlannerMetric::Progress), 1.0);
}

#[test]
fn the_return_to_the_route_is_credited_with_the_whole_distance() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 5.0);
    for state in &mut drive.ego[20..40] {
        state.y = -1.75;
    }
    let scores = drive.judge();
    let steps = &scores.progress.ego_progress;
    assert!(steps[20..40].iter().all(|&step| step == 0.0));
    assert!(near(steps[40], 10.5));
    assert_eq!(defined(&scores, PlannerMetric::Progress), 1.0);
}

#[test]
fn an_expert_without_lanes_gives_one_in_the_devkit_only() {
    let off_lanes = |missing| {
        let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 10.0);
        drive.expert = Some(straight(v(0.0, 50.0), 0.0, 10.0));
        drive.missing = missing;
        drive.judge().value(PlannerMetric::Progress)
    };
    assert_eq!(off_lanes(MissingInputs::AsDevkit), MetricValue::Defined(1.0));
    let undefined = MetricValue::Undefined(UndefinedReason::ExpertWithoutLanes);
    assert_eq!(off_lanes(MissingInputs::Undefined), undefined);
}

#[test]
fn gaps_in_the_log_leave_the_progress_undefined() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 10.0);
    drive.expert = None;
    let scores = drive.judge();
    let undefined = MetricValue::Undefined(UndefinedReason::IncompleteExpert);
    assert_eq!(scores.value(PlannerMetric::Progress), undefined);
    assert_eq!(scores.value(PlannerMetric::MakingProgress), undefined);
}

/// Ego at 10 m/s behind a vehicle at 6 m/s with this gap at the last sample, metres.
fn closing_in(last_gap: f64) -> PlannerScores {
    let rear = FRONT + last_gap + 4.0 * 8.0;
    Drive::straight(v(0.0, 1.75), 0.0, 10.0)
        .with("w", ObjectKind::Vehicle, v(rear + 2.0, 1.75), 0.0, v(6.0, 0.0))
        .judge()
}

#[test]
fn contacts_projected_within_nine_steps_violate_the_time_to_collision() {
    // The gap closes by 0.4 m per projected step.
    let tenth = closing_in(3.65);
    assert!(near(*tenth.time_to_collision.ttc.last().unwrap(), 1.0));
    assert_eq!(defined(&tenth, PlannerMetric::TimeToCollision), 1.0);
    let ninth = closing_in(3.55);
    assert!(near(*ninth.time_to_collision.ttc.last().unwrap(), 0.9));
    assert_eq!(ninth.time_to_collision.short[0].step, 80);
    assert_eq!(defined(&ninth, PlannerMetric::TimeToCollision), 0.0);
}

#[test]
fn the_horizon_of_three_seconds_is_not_tested() {
    // 2.9 s of closing at 4 m/s are 11.6 m.
    assert!(near(*closing_in(11.55).time_to_collision.ttc.last().unwrap(), 2.9));
    assert_eq!(*closing_in(11.65).time_to_collision.ttc.last().unwrap(), f64::INFINITY);
}

#[test]
fn objects_are_projected_along_their_heading_not_their_velocity() {
    // The vehicle ahead faces ego and reverses away from it as fast as ego drives.
    let scores = Drive::straight(v(0.0, 1.75), 0.0, 10.0)
        .with("w", ObjectKind::Vehicle, v(20.0, 1.75), PI, v(10.0, 0.0))
        .judge();
    assert!(scores.collisions.contacts.is_empty());
    assert_eq!(defined(&scores, PlannerMetric::TimeToCollision), 0.0);
}

/// Ego drives 1 m/s above the limit.
fn too_fast(parts: impl Fn(&mut PlanningMapParts), missing: MissingInputs) -> PlannerScores {
    let mut drive = Drive::straight(v(-40.0, 1.75), 0.0, LIMIT + 1.0);
    drive.missing = missing;
    parts(&mut drive.map);
    drive.judge()
}

#[test]
fn the_excess_of_speed_has_one_sample_more_than_intervals() {
    let scores = too_fast(|_| (), MissingInputs::Undefined);
    assert!(near(defined(&scores, PlannerMetric::SpeedLimit), 1.0 - 81.0 * 0.1 / (2.23 * 8.0)));
}

#[test]
fn unknown_limits_give_one_in_the_devkit_only() {
    let no_limit = |map: &mut PlanningMapParts| map.lanes[A].0.speed_limit = None;
    let scores = too_fast(no_limit, MissingInputs::AsDevkit);
    assert_eq!(defined(&scores, PlannerMetric::SpeedLimit), 1.0);
    let scores = too_fast(no_limit, MissingInputs::Undefined);
    let undefined = MetricValue::Undefined(UndefinedReason::UnknownSpeedLimits);
    assert_eq!(scores.value(PlannerMetric::SpeedLimit), undefined);
    assert!(scores.labels.contains(&Label::SpeedLimitsUnknown));
}

#[test]
fn connectors_have_the_largest_limit_around_them() {
    // The own limits of the connectors are 5 m/s; `a` has 13, `a2` has 15.
    let mut drive = Drive::straight(v(150.0, 1.75), 0.0, 15.0);
    drive.ego.truncate(15);
    drive.objects.truncate(15);
    let scores = drive.judge();
    assert_eq!(scores.center_lanes[0], [C, D]);
    assert_eq!(defined(&scores, PlannerMetric::SpeedLimit), 1.0);
}

#[test]
fn maps_of_connectors_use_their_own_limits() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 14.0);
    drive.map.lanes.iter_mut().for_each(|(lane, _)| lane.kind = LaneKind::Connector);
    let scores = drive.judge();
    assert!(near(scores.speed_limit.overspeed[0], 1.0));
    assert!(scores.labels.contains(&Label::LanesOverlapping));
}

#[test]
fn overlapping_lanes_take_the_lane_along_the_heading() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 10.0);
    drive.map.lanes.iter_mut().for_each(|(lane, _)| lane.kind = LaneKind::Connector);
    // The oncoming lane comes first in map order and covers both sides of the road.
    drive.map.lanes.swap(0, 1);
    drive.map.lanes[0].1 = rectangle([-50.0, 150.0], [-3.5, 3.5]);
    drive.map.lanes.truncate(2);
    drive.map.lanes.iter_mut().for_each(|(lane, _)| lane.successors.clear());
    let scores = drive.judge();
    assert_eq!(scores.center_lanes[0], [0, 1]);
    assert_eq!(defined(&scores, PlannerMetric::DrivingDirection), 1.0);
    assert!(near(scores.progress.expert_total, 80.0), "the route is that of the matching lane");
    assert!(scores.labels.contains(&Label::DirectionOverlapping));
}

#[test]
fn leaving_overlapping_connectors_empties_the_lanes_before() {
    // Ego is in both connectors and then leaves the road.
    let leaving = |kind: LaneKind| {
        let mut drive = Drive::straight(v(152.0, 1.75), 0.0, 1.0);
        drive.map.lanes[A].0.kind = kind;
        drive.map.lanes[O].0.kind = kind;
        drive.map.lanes[A2].0.kind = kind;
        drive.ego[60..].iter_mut().for_each(|state| state.y = 60.0);
        drive.judge().center_lanes
    };
    assert!(leaving(LaneKind::Lane).iter().all(Vec::is_empty));
    let kept = leaving(LaneKind::Connector);
    assert_eq!(kept[0], [C, D]);
    assert!(kept[60].is_empty());
}

#[test]
fn braking_to_standstill_overshoots_the_bound() {
    let mut drive = Drive::straight(v(0.0, 1.75), 0.0, 8.0);
    for (k, state) in drive.ego.iter_mut().enumerate() {
        let braking = (2.0 - k as f64 * 0.1).max(0.0);
        state.vx = 4.0 * braking;
        state.x = 8.0 - 2.0 * braking * braking;
        state.ax = if k < 20 { -4.0 } else { 0.0 };
    }
    let scores = drive.judge();
    let acceleration = &scores.comfort.longitudinal_acceleration;
    assert!(acceleration.values.contains(&-4.375));
    assert!(!acceleration.within);
    assert_eq!(defined(&scores, PlannerMetric::Comfort), 0.0);
}

#[test]
fn bad_histories_are_refused() {
    let map = PlanningMap::new(parts()).unwrap();
    let ego = straight(v(0.0, 1.75), 0.0, 1.0);
    let refusal = |ego: &[EgoState], samples_of_objects: usize| {
        let objects = &vec![Vec::new(); samples_of_objects][..];
        let (shape, missing) = (EgoShape::PACIFICA, MissingInputs::Undefined);
        judge(&History { map: &map, shape, ego, expert: None, objects, missing }).unwrap_err().to_string()
    };
    assert_eq!(refusal(&ego[..3], 3), "the history has 3 samples of ego; the metrics need at least 4");
    assert!(refusal(&ego, 3).starts_with("the history has 81 samples of ego, but 3 of objects;"));
    let mut broken = ego.clone();
    broken[5].ax = f64::NAN;
    assert_eq!(refusal(&broken, SAMPLES), "sample 5: the state of ego is not finite");
}
