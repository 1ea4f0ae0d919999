//! Worked cases of agents that enter or leave: `late` has the steps 20 to 80, `early` the steps 1 to 30.

use std::f64::consts::PI;

use reactsim_geometry::{Polygon, Vec2};
use reactsim_metrics::{Case, Metrics, Options, Score, Scores};
use reactsim_scene::{
    AgentState, CURRENT, DT, FRAMES, Frame, LaneArea, LaneParts, MapParts, Scenario, ScenarioParts,
};

use super::scenes::car;

/// First step of `late`.
const ENTERS: usize = 20;
/// Last step of `early`.
const LEAVES: usize = 30;

/// Returns the state at each step of a drive along the x axis, which is at `x` at the current frame.
fn straight(x: f64, y: f64, speed: f64) -> Vec<Frame> {
    let heading = if speed < 0.0 { PI } else { 0.0 };
    let at = |f: usize| x + speed * DT * (f as f64 - CURRENT as f64);
    (0..FRAMES).map(|f| Some(AgentState { x: at(f), y, heading, vx: speed, vy: 0.0 })).collect()
}

/// Changes the states at these steps.
fn at(track: &mut [Frame], steps: impl IntoIterator<Item = usize>, change: impl Fn(&mut AgentState)) {
    for step in steps {
        track[CURRENT + step].iter_mut().for_each(&change);
    }
}

/// Returns a lane along the x axis, 8 m wide and drivable.
fn road() -> MapParts {
    let ring =
        vec![Vec2::new(-500.0, -4.0), Vec2::new(500.0, -4.0), Vec2::new(500.0, 4.0), Vec2::new(-500.0, 4.0)];
    let lane = LaneParts {
        id: "east".into(),
        points: vec![Vec2::new(-500.0, 0.0), Vec2::new(500.0, 0.0)],
        area: LaneArea::Polygon(ring.clone()),
        ..LaneParts::default()
    };
    let drivable_area = Some(vec![Polygon { exterior: ring, holes: Vec::new() }]);
    MapParts { lanes: vec![lane], drivable_area, ..MapParts::default() }
}

/// Returns the scores of a rollout in which `early` and `late` drive these tracks, of which the steps without
/// them are cut. Their logs are straight drives at 10 m/s, from −100 m and 0 m.
fn scores(options: Options, mut early: Vec<Frame>, mut late: Vec<Frame>) -> Scores {
    let mut entering = straight(0.0, 0.0, 10.0);
    entering[..CURRENT + ENTERS].fill(None);
    let av = straight(-400.0, 0.0, 0.0);
    let logs = [("av", av.clone()), ("early", straight(-100.0, 0.0, 10.0)), ("late", entering)];
    let parts = ScenarioParts {
        id: "worked".into(),
        origin: Some(Vec2::zeros()),
        agents: logs.map(|(id, track)| car(id, track)).into(),
        map: road(),
        ..ScenarioParts::default()
    };
    let scenario = Scenario::assemble(parts).unwrap().with_entered(&[0]);
    early[CURRENT + LEAVES + 1..].fill(None);
    late[..CURRENT + ENTERS].fill(None);
    let tracks = [av, early, late];
    Metrics::default().score_case(&Case::of_rollout(&scenario, tracks.each_ref().map(Vec::as_slice), options))
}

/// Returns agent, first and last step of the events of a metric.
fn events<'s>(scores: &'s Scores, metric: &str) -> Vec<(&'s str, usize, usize)> {
    let own = scores.events.iter().filter(|event| event.metric == metric);
    own.map(|event| (event.agent.as_str(), event.step, event.last_step)).collect()
}

/// 30 and 61 steps: the first frame of an agent that enters is one.
const STEPS: u64 = 30 + 61;

#[test]
fn off_road_steps_are_those_of_agents_that_begin_on_the_road() {
    let (mut early, mut late) = (straight(-100.0, 0.0, 10.0), straight(0.0, 0.0, 10.0));
    at(&mut early, 21..=80, |state| state.y = 9.0);
    at(&mut late, 50..60, |state| state.y = 9.0);
    let found = scores(Options::default(), early.clone(), late.clone());
    assert_eq!(found.score("offroad"), Some(Score::Rate { hits: 10 + 10, valid: STEPS }));
    assert_eq!(events(&found, "offroad"), [("early", 21, 30), ("late", 50, 59)]);
    // An agent that enters off the road is not judged there.
    at(&mut late, [ENTERS], |state| state.y = 9.0);
    let found = scores(Options::default(), early, late);
    assert_eq!(found.score("offroad"), Some(Score::Rate { hits: 10, valid: 30 }));
}

#[test]
fn progress_along_the_lane_is_summed_from_the_first_frame() {
    let found = scores(Options::default(), straight(-100.0, 0.0, -6.0), straight(100.0, 0.0, -6.0));
    assert_eq!(found.score("direction"), Some(Score::Rate { hits: 2, valid: 2 }));
    // Both are 2.4 m backwards four steps after their first frames.
    assert_eq!(events(&found, "direction"), [("early", 4, 30), ("late", 24, 80)]);
}

#[test]
fn an_agent_that_enters_has_one_transition_less_than_steps() {
    let (early, mut late) = (straight(-100.0, 0.0, 10.0), straight(0.0, 0.0, 10.0));
    let valid = STEPS - 1;
    let found = scores(Options::default(), early.clone(), late.clone());
    for id in ["acceleration", "curvature", "curvature-velocity"] {
        assert_eq!(found.score(id), Some(Score::Rate { hits: 0, valid }), "{id}");
    }
    at(&mut late, [40], |state| state.vx = 14.0);
    at(&mut late, [50], |state| state.heading = 1.0);
    let found = scores(Options::default(), early, late);
    // 40 m/s² and back; 1 rad over 1 m and back, of which the direction of the velocity shows the way back.
    for (id, hits) in [("acceleration", 2), ("curvature", 2), ("curvature-velocity", 1)] {
        assert_eq!(found.score(id), Some(Score::Rate { hits, valid }), "{id}");
    }
}

#[test]
fn agents_collide_while_both_are_present() {
    let (early, mut late) = (straight(0.0, 0.0, 10.0), straight(0.0, 3.0, 10.0));
    at(&mut late, 25..=80, |state| state.y = 1.0);
    let found = scores(Options::default(), early, late);
    assert_eq!(found.score("aa-collision"), Some(Score::Rate { hits: 2 * 6, valid: STEPS }));
    assert_eq!(events(&found, "aa-collision"), [("early", 25, 30)]);
}

#[test]
fn displacements_are_of_the_steps_with_both() {
    let (mut early, mut late) = (straight(-100.0, 0.0, 10.0), straight(0.0, 0.0, 10.0));
    at(&mut early, 1..=80, |state| state.y = 2.0);
    at(&mut late, 21..=80, |state| state.y = 1.0);
    let ade = scores(Options::default(), early, late).value("ade").unwrap();
    // 2 m at 30 steps; 1 m at 60 of 61 steps.
    assert!((ade - (2.0 + 60.0 / 61.0) / 2.0).abs() < 1e-12, "{ade}");
}

#[test]
fn pairs_that_overlap_when_the_later_one_enters_can_be_left_out() {
    let pair = |exclude_initial_overlap: bool, y: f64| {
        let options = Options { exclude_initial_overlap, ..Options::default() };
        let (early, mut late) = (straight(0.0, 0.0, 10.0), straight(0.0, 1.0, 10.0));
        at(&mut late, [ENTERS], |state| state.y = y);
        scores(options, early, late).score("aa-collision")
    };
    assert_eq!(pair(false, 1.0), Some(Score::Rate { hits: 2 * 11, valid: STEPS }));
    assert_eq!(pair(true, 1.0), Some(Score::Rate { hits: 0, valid: STEPS }));
    // Apart at first.
    assert_eq!(pair(true, 3.0), Some(Score::Rate { hits: 2 * 10, valid: STEPS }));
}
