//! Rules of the official code that no recording shows, and errors.

use reactsim_scene::{
    AgentKind, CURRENT, FRAMES, HISTORY,
    wosac::{ScenarioRollouts, WosacLog},
};

use super::super::{Config, Feature, Scorer, StepFeatures};
use super::fixture;

/// A scenario of which object 0 drives straight at 10 m/s along y = 0 and the others stand far away.
fn straight(objects: usize) -> (WosacLog, ScenarioRollouts) {
    let (mut log, mut rollouts) = fixture::scenario(7, objects, 2, [0.0, 0.0]);
    for (i, track) in log.tracks.iter_mut().enumerate() {
        track.kind = AgentKind::Vehicle;
        (track.length, track.width) = (4.0, 2.0);
        track.x = (0..FRAMES).map(|f| if i == 0 { f as f32 } else { 500.0 * i as f32 }).collect();
        track.y = vec![0.0; FRAMES];
        track.heading = vec![0.0; FRAMES];
        track.valid = vec![true; FRAMES];
    }
    fixture::follow_log(&log, &mut rollouts);
    log.tracks_to_predict = vec![0];
    (log, rollouts)
}

/// Returns the features of the object with this track in the first rollout.
fn features(log: &WosacLog, rollouts: &ScenarioRollouts, track: usize) -> StepFeatures {
    let scorer = Scorer::new(log).unwrap();
    let slot = scorer.evaluated().iter().position(|id| *id == log.tracks[track].id).unwrap();
    scorer.features(rollouts).unwrap()[0][slot].clone()
}

/// Moves an object of all rollouts and of the log to a place and heading.
fn place(log: &mut WosacLog, rollouts: &mut ScenarioRollouts, track: usize, x: f32, y: f32, heading: f32) {
    log.tracks[track].x[HISTORY..].fill(x);
    log.tracks[track].y[HISTORY..].fill(y);
    log.tracks[track].heading[HISTORY..].fill(heading);
    for scene in &mut rollouts.joint_scenes {
        let trajectory = &mut scene.trajectories[track];
        trajectory.x.fill(x);
        trajectory.y.fill(y);
        trajectory.heading.fill(heading);
    }
}

#[test]
fn objects_that_are_absent_now_do_not_exist() {
    let (mut log, mut rollouts) = straight(4);
    place(&mut log, &mut rollouts, 1, 50.0, 0.0, 0.0);
    let with = features(&log, &rollouts, 0);
    assert!((0..80).any(|k| with.has_event(Feature::CollisionIndication, k)));
    log.tracks[1].valid[CURRENT] = false;
    rollouts.joint_scenes.iter_mut().for_each(|scene| drop(scene.trajectories.remove(1)));
    let without = features(&log, &rollouts, 0);
    assert!((0..80).all(|k| !without.has_event(Feature::CollisionIndication, k)));
    let logged = &Scorer::new(&log).unwrap().logged_features()[0].clone();
    assert!((0..80).all(|k| !logged.has_event(Feature::CollisionIndication, k)));
}

#[test]
fn an_invalid_frame_before_now_moves_the_first_acceleration_of_every_rollout() {
    let (mut log, rollouts) = straight(3);
    let before = features(&log, &rollouts, 0).values(Feature::LinearAcceleration).unwrap()[0];
    assert!(before.abs() < 1e-3);
    // As stored in recordings: positions of invalid frames are 0.
    log.tracks[0].valid[CURRENT - 1] = false;
    log.tracks[0].x.iter_mut().for_each(|x| *x += 1000.0);
    log.tracks[0].x[CURRENT - 1] = 0.0;
    let mut moved = rollouts;
    moved.joint_scenes.iter_mut().flat_map(|s| &mut s.trajectories[0].x).for_each(|x| *x += 1000.0);
    let after = features(&log, &moved, 0);
    // Speed 10 m/s at step 2 and (1011 - 0) / 2 / 0.1 m/s now.
    let acceleration = after.values(Feature::LinearAcceleration).unwrap();
    assert!((acceleration[0] - (10.0 - 5055.0) / 2.0 / 0.1).abs() < 5.0, "{}", acceleration[0]);
    assert!(acceleration[1].abs() < 1e-2);
}

#[test]
fn speeds_are_unknown_at_the_last_steps() {
    let (log, rollouts) = straight(3);
    let features = features(&log, &rollouts, 0);
    let unknown = |feature: Feature| {
        let values = features.values(feature).unwrap();
        (0..80).filter(|&k| values[k].is_nan()).collect::<Vec<_>>()
    };
    assert_eq!(unknown(Feature::LinearSpeed), [79]);
    assert_eq!(unknown(Feature::AngularSpeed), [79]);
    assert_eq!(unknown(Feature::LinearAcceleration), [78, 79]);
    assert_eq!(unknown(Feature::AngularAcceleration), [78, 79]);
}

#[test]
fn time_to_collision_has_unwrapped_headings_and_ignores_overlaps() {
    let (mut log, mut rollouts) = straight(3);
    place(&mut log, &mut rollouts, 1, 60.0, 0.0, 0.0);
    let times = |log: &WosacLog, rollouts: &ScenarioRollouts| {
        features(log, rollouts, 0).values(Feature::TimeToCollision).unwrap().to_owned()
    };
    let ahead = times(&log, &rollouts);
    // At step 2 object 0 is at 12 m and ends at 14 m; the standing object begins at 58 m: 44 m at 10 m/s.
    assert!((ahead[1] - 4.4).abs() < 1e-4 && (ahead[44] - 0.1).abs() < 1e-4, "{ahead:?}");
    // From 56 m on the boxes touch or overlap.
    assert!(ahead[45..].iter().all(|time| *time == 5.0), "{:?}", &ahead[45..]);
    // The same direction, written with another turn.
    place(&mut log, &mut rollouts, 1, 60.0, 0.0, std::f32::consts::TAU);
    assert!(times(&log, &rollouts).iter().all(|time| *time == 5.0));
    // Hardly in the way: overlaps of up to 0.5 m count only for small differences of the headings.
    place(&mut log, &mut rollouts, 1, 60.0, 1.8, 0.0);
    assert!(times(&log, &rollouts)[1] < 5.0);
    place(&mut log, &mut rollouts, 1, 60.0, 2.2, 0.3);
    assert_eq!(times(&log, &rollouts)[1], 5.0);
}

#[test]
fn lights_of_2024_have_no_fields_and_ttc_counts_all_types() {
    let (mut log, rollouts) = straight(3);
    log.tracks[0].kind = AgentKind::Pedestrian;
    let scorer = Scorer::new(&log).unwrap();
    let configs = [Config::CHALLENGE_2025, Config::CHALLENGE_2024];
    let metrics = scorer.score(&rollouts, &configs).unwrap();
    assert!(metrics[0].likelihood(Feature::TrafficLightViolation).is_some());
    assert_eq!(metrics[1].likelihood(Feature::TrafficLightViolation), None);
    assert_eq!(metrics[1].simulated_traffic_light_violation_rate, None);
    assert_eq!(metrics[0].average_displacement_error, 0.0);
    let single = scorer.score(&rollouts, &configs[1..]).unwrap();
    assert_eq!(single[0], metrics[1], "configurations do not influence each other");
}

#[test]
fn logs_that_cannot_be_scored_are_refused() {
    let error = |change: fn(&mut WosacLog)| {
        let (mut log, _) = straight(3);
        change(&mut log);
        Scorer::new(&log).err().unwrap().to_string()
    };
    let no_future = error(|log| {
        for track in &mut log.tracks {
            for column in [&mut track.x, &mut track.y, &mut track.z, &mut track.heading] {
                column.truncate(HISTORY);
            }
            track.valid.truncate(HISTORY);
        }
        log.signals.truncate(HISTORY);
    });
    assert!(no_future.contains("the log ends at the current frame"), "{no_future}");
    let no_edge = error(|log| log.road_edges.iter_mut().for_each(|edge| edge.truncate(1)));
    assert!(no_edge.contains("the map has no road edge"), "{no_edge}");
    let absent = error(|log| log.tracks[0].valid[CURRENT] = false);
    assert!(absent.contains("object 1000 of tracks_to_predict or the AV is invalid"), "{absent}");
    let nothing = error(|log| log.tracks.iter_mut().for_each(|track| track.kind = AgentKind::Cyclist));
    let feature = Feature::TimeToCollision.name();
    assert!(nothing.contains(&format!("no logged step of {feature} can be judged")), "{nothing}");
    for (change, expected) in [
        ((|log| log.av = 9) as fn(&mut WosacLog), "sdc_track_index is 9"),
        (|log| log.tracks[1].id = log.tracks[0].id, "tracks[1].id is 1000"),
        (|log| log.tracks[1].x[30] = f32::NAN, "tracks[1].states[30].center_x is NaN"),
        (|log| log.tracks[2].width = -1.0, "tracks[2].states[10].width is -1"),
        (|log| log.signals.truncate(80), "dynamic_map_states is 80 entries"),
        (|log| log.road_edges[0][0][2] = f32::INFINITY, "a point of the map is inf"),
    ] {
        let error = error(change);
        assert!(error.starts_with("scenario `made-up-7`: ") && error.contains(expected), "{error}");
    }
}

#[test]
fn rollouts_of_another_scenario_are_refused() {
    let (log, mut rollouts) = straight(3);
    rollouts.scenario_id = "other".into();
    let error = Scorer::new(&log).unwrap().score(&rollouts, &Config::ALL).unwrap_err();
    assert!(error.to_string().contains("scenario_id is `other`, expected `made-up-7`"), "{error}");
}

#[test]
fn scenarios_of_other_formats_can_be_scored() {
    use reactsim_scene::wosac::{JointScene, ObjectTrajectory};
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/mini");
    let (mut scored, mut refused) = (0, 0);
    for scenario in reactsim_formats::open(&folder).unwrap() {
        let log = WosacLog::of_scenario(&scenario.unwrap()).unwrap();
        log.check().unwrap();
        let future = |values: &[f32]| values[HISTORY..].to_vec();
        let trajectory = |track: &reactsim_scene::wosac::WosacTrack| ObjectTrajectory {
            object_id: track.id,
            x: future(&track.x),
            y: future(&track.y),
            z: future(&track.z),
            heading: future(&track.heading),
        };
        let scene = JointScene { trajectories: log.simulated().map(trajectory).collect() };
        let rollouts =
            ScenarioRollouts { scenario_id: log.scenario_id.clone(), joint_scenes: vec![scene; 2] };
        match Scorer::new(&log) {
            Ok(scorer) => {
                let metrics = scorer.score(&rollouts, &[Config::CHALLENGE_2025]).unwrap()[0];
                assert_eq!(metrics.min_average_displacement_error, 0.0);
                assert!((0.0..=1.0).contains(&metrics.metametric));
                scored += 1;
            }
            Err(error) => {
                assert!(error.to_string().contains("the map has no road edge"), "{error}");
                refused += 1;
            }
        }
    }
    assert!(scored + refused > 0);
}
