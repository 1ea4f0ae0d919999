//! Plans driven along the lanes.

use reactsim::curation::LaneRoutes;
use reactsim::scene::{AgentState, FUTURE, Scenario};

use super::road::{candidate, on_road};
use super::rules::drivable;
use crate::scenes::{car, mini, real};

/// Returns the plan whose state after `t` seconds is given by position, heading and speed.
fn plan(scenario: &Scenario, at: impl Fn(f64) -> (f64, f64, f64)) -> Vec<AgentState> {
    candidate(scenario, at).track[1..].to_vec()
}

#[test]
fn a_plan_gives_lane_and_speed_and_no_more() {
    let scenario = on_road("lanes", vec![car("av", 0.0, 0.0, 0.0, 10.0)]);
    let routes = LaneRoutes::of(&scenario).unwrap();
    // It strays from its lane by 1.2 m while it brakes at 1 m/s2.
    let braking = |t: f64| 10.0 * t - 0.5 * t * t;
    let straying = routes.drive(&plan(&scenario, |t| (braking(t), 1.2 * t.sin(), 0.0))).unwrap();
    drivable(&scenario, "straying", &straying);
    let end = straying[FUTURE - 1];
    assert!(straying.iter().all(|s| s.y.abs() < 0.05), "{straying:?}");
    // The acceleration changes gradually, so that the AV brakes a little later.
    assert!((0.0..3.0).contains(&(end.x - braking(8.0))), "{end:?}");
    // One that goes over to the left lane does so.
    let beside = routes.drive(&plan(&scenario, |t| (10.0 * t, 3.0 * (0.5 * t).min(1.0), 0.0))).unwrap();
    drivable(&scenario, "beside", &beside);
    assert!((beside[FUTURE - 1].y - 3.5).abs() < 0.1, "{:?}", beside[FUTURE - 1]);
}

#[test]
fn an_av_without_lanes_or_in_reverse_has_no_route() {
    let fields = on_road("fields", vec![car("av", 0.0, -40.0, 0.0, 10.0)]);
    let routes = LaneRoutes::of(&fields).unwrap();
    assert_eq!(routes.drive(&plan(&fields, |t| (10.0 * t, -40.0, 0.0))), None);
    let reversing = on_road("reversing", vec![car("av", 0.0, 0.0, 0.0, -3.0)]);
    assert!(LaneRoutes::of(&reversing).is_none());
}

#[test]
fn routes_of_whole_scenarios_are_drivable() {
    let mut driven = 0;
    for scenario in mini().iter().chain(&real(6)) {
        let Some(routes) = LaneRoutes::of(scenario) else { continue };
        let logged: Option<Vec<AgentState>> = scenario.log_future.tracks[0].iter().copied().collect();
        if let Some(found) = logged.and_then(|logged| routes.drive(&logged)) {
            drivable(scenario, "logged", &found);
            driven += 1;
        }
    }
    assert!(driven >= 3, "only {driven}");
}
