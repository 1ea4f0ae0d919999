//! The worked cases of `docs/over-reaction.md`. All agents drive along the x axis; the AV is stopped with its
//! centre at 100 m.

use reactsim_scene::{
    Agent, AgentKind, AgentState, CURRENT, Certificate, DT, FRAMES, FUTURE, Frame, HISTORY, MapIndex,
    Response, Road, RoadMap,
};

use super::super::{Case, LoggedTrack, Object, Options, Score, Scores, score_case};

/// x of the AV's centre, metres.
const AV_AT: f64 = 100.0;

fn agent(id: &str) -> Agent {
    Agent { id: id.to_owned(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 }
}

/// Returns a track that starts at `x` with 10 m/s and brakes from now on with this deceleration until it
/// stops.
fn drive(x: f64, y: f64, deceleration: f64) -> Vec<Frame> {
    let state = |f: usize| {
        let t = DT * (f as f64 - CURRENT as f64);
        let braking = if deceleration > 0.0 { t.clamp(0.0, 10.0 / deceleration) } else { 0.0 };
        let stopped = if deceleration > 0.0 { (t - 10.0 / deceleration).max(0.0) } else { 0.0 };
        let x = x + 10.0 * (t - stopped) - 0.5 * deceleration * braking * braking;
        AgentState { x, y, heading: 0.0, vx: 10.0 - deceleration * braking, vy: 0.0 }
    };
    (0..FRAMES).map(|f| Some(state(f))).collect()
}

fn parked_at(x: f64, y: f64) -> Vec<Frame> {
    vec![Some(AgentState { x, y, heading: 0.0, vx: 0.0, vy: 0.0 }); FRAMES]
}

fn response(id: &str, leader: Option<&str>, track: &[Frame], peak: f64) -> Response {
    Response {
        agent: id.to_owned(),
        leader: leader.map(str::to_owned),
        reaction_step: 3,
        nudge: 0.0,
        peak_deceleration: peak,
        clearance: 1.0,
        effort: None,
        track: track[CURRENT..].iter().copied().flatten().collect(),
    }
}

/// Agents with their logs and their tracks in the rollout; the AV is the first.
struct World {
    agents: Vec<(Agent, Vec<Frame>, Vec<Frame>)>,
    certificate: Option<Certificate>,
}

impl World {
    /// Creates the AV, and `a` 50 m behind it, which brakes with 2 m/s² in the certificate: 25 m in 5 s.
    fn new(driven: Vec<Frame>) -> Self {
        let log = drive(AV_AT - 50.0, 0.0, 0.0);
        let track = drive(AV_AT - 50.0, 0.0, 2.0);
        let av = (agent("av"), drive(AV_AT, 0.0, 0.0), parked_at(AV_AT, 0.0));
        Self {
            agents: vec![av, (agent("a"), log, driven)],
            certificate: Some(Certificate { responses: vec![response("a", None, &track, 2.0)] }),
        }
    }

    fn with(mut self, id: &str, log: Vec<Frame>, driven: Vec<Frame>) -> Self {
        self.agents.push((agent(id), log, driven));
        self
    }

    fn with_response(mut self, response: Response) -> Self {
        if let Some(certificate) = &mut self.certificate {
            certificate.responses.push(response);
        }
        self
    }

    fn scores(&self) -> Scores {
        self.scores_if(false)
    }

    /// Returns the scores if vehicles that vanish have left, or have not.
    fn scores_if(&self, may_leave: bool) -> Scores {
        let map = RoadMap::default();
        let index = MapIndex::new(&map);
        let objects = self.agents.iter().map(|(agent, _, track)| Object { agent, track: track.into() });
        let log = self.agents.iter().map(|(_, log, _)| LoggedTrack {
            history: &log[..HISTORY],
            future: &log[HISTORY..],
            recorded_history: None,
        });
        let case = Case::new(Road::new(&map, &index), objects.collect(), 0, Options::default());
        let case = case.with_log(log.collect()).with_certificate(self.certificate.as_ref());
        score_case(&case.with_leaving(may_leave))
    }
}

#[track_caller]
fn near(found: Option<f64>, expected: f64) {
    assert!(found.is_some_and(|v| (v - expected).abs() < 1e-9), "{found:?} is not {expected}");
}

/// Returns the events of a metric: agent, whether the event counts, and the first value.
fn events<'s>(scores: &'s Scores, metric: &str) -> Vec<(&'s str, bool, f64)> {
    let own = scores.events.iter().filter(|e| e.metric == metric);
    own.map(|e| (e.agent.as_str(), e.counted, e.values[0].1)).collect()
}

#[test]
fn the_certificate_itself_is_not_an_over_reaction() {
    let scores = World::new(drive(AV_AT - 50.0, 0.0, 2.0)).scores();
    assert_eq!(scores.score("over-reaction"), Some(Score::Mean { sum: 0.0, n: 1 }));
    assert_eq!(scores.score("over-braking"), Some(Score::Mean { sum: 0.0, n: 1 }));
    assert!(scores.events.is_empty(), "{:?}", scores.events);
}

#[test]
fn driving_farther_than_the_certificate_is_not_an_over_reaction() {
    // 10²/(2 x 1.25) = 40 m, which leaves 6 m of the 46 m gap.
    let scores = World::new(drive(AV_AT - 50.0, 0.0, 1.25)).scores();
    assert_eq!(scores.score("over-reaction"), Some(Score::Mean { sum: 0.0, n: 1 }));
    assert_eq!(scores.value("over-braking"), Some(0.0));
}

#[test]
fn stopping_at_once_loses_the_path_of_the_certificate() {
    // 10 m/s to 0 in one step: 100 m/s², 98 m/s² more than needed.
    let driven = World::new(frozen()).scores();
    near(driven.value("over-reaction"), 25.0);
    near(driven.value("over-braking"), 98.0);
    let event = driven.events.iter().find(|e| e.metric == "over-reaction").unwrap();
    assert_eq!((event.step, event.last_step, event.partner.as_deref()), (FUTURE, FUTURE, Some("av")));
    let names: Vec<&str> = event.values.iter().map(|v| v.0).collect();
    assert_eq!(names, ["lost", "driven", "reference", "peak", "reference_peak"]);
}

/// Returns a track that is stopped from the current frame on.
fn frozen() -> Vec<Frame> {
    let mut track = drive(AV_AT - 50.0, 0.0, 0.0);
    for frame in &mut track[HISTORY..] {
        *frame = Some(AgentState { x: AV_AT - 50.0, y: 0.0, heading: 0.0, vx: 0.0, vy: 0.0 });
    }
    track
}

#[test]
fn harder_braking_than_needed_costs_both() {
    // 10²/(2 x 4) = 12.5 m instead of 25 m.
    let scores = World::new(drive(AV_AT - 50.0, 0.0, 4.0)).scores();
    near(scores.value("over-reaction"), 12.5);
    near(scores.value("over-braking"), 2.0);
    assert_eq!(events(&scores, "over-braking").len(), 1);
}

#[test]
fn absent_agents_drive_nothing() {
    let mut driven = drive(AV_AT - 50.0, 0.0, 2.0);
    driven[HISTORY + 10..].fill(None);
    // In the first second 10 - 1 = 9 m.
    near(World::new(driven.clone()).scores().value("over-reaction"), 16.0);
    // The distance between disappearing and reappearing is not counted.
    driven[FRAMES - 1] = drive(AV_AT - 50.0, 0.0, 2.0)[FRAMES - 1];
    near(World::new(driven).scores().value("over-reaction"), 16.0);
}

#[test]
fn log_replay_is_undefined() {
    let scores = World::new(drive(AV_AT - 50.0, 0.0, 0.0)).scores();
    assert_eq!((scores.score("over-reaction"), scores.score("over-braking")), (None, None));
    let event = scores.events.iter().find(|e| e.metric == "over-reaction").unwrap();
    assert_eq!((event.reason, event.counted), (Some("under_reacted"), false));
    // Less than 5 m away at 10 m/s from step 42 on (4 m of 46 m are left); the boxes have separated after
    // step 53.
    assert_eq!((event.step, event.last_step), (42, 53));
}

#[test]
fn a_close_call_is_under_reaction_too() {
    // Continues at 10 m/s and stops in one step, 0.5 m before the AV: until then 0.1 s or less remained.
    let mut driven = drive(AV_AT - 50.0, 0.0, 0.0);
    for (k, frame) in driven[HISTORY..].iter_mut().enumerate() {
        let x = (AV_AT - 50.0 + (k + 1) as f64).min(AV_AT - 4.5);
        *frame = Some(AgentState { x, y: 0.0, heading: 0.0, vx: f64::NAN, vy: f64::NAN });
    }
    let scores = World::new(driven).scores();
    assert_eq!(scores.value("aav-overlap"), Some(0.0));
    assert_eq!(scores.value("over-reaction"), None);
}

#[test]
fn of_two_responders_one_collides() {
    let y = 4.0;
    let log = drive(AV_AT - 50.0, y, 0.0);
    let response = response("b", None, &drive(AV_AT - 50.0, y, 2.0), 2.0);
    let world = World::new(drive(AV_AT - 50.0, 0.0, 0.0));
    let world = world.with("b", log, drive(AV_AT - 50.0, y, 4.0)).with_response(response);
    let scores = world.scores();
    assert_eq!(scores.score("over-reaction").map(|s| matches!(s, Score::Mean { n: 1, .. })), Some(true));
    near(scores.value("over-reaction"), 12.5);
    let found = events(&scores, "over-reaction");
    assert_eq!(found.iter().map(|e| (e.0, e.1)).collect::<Vec<_>>(), [("a", false), ("b", true)]);
}

#[test]
fn followers_belong_to_neither_set() {
    // `b` follows `a`, and stops at once; `a` drives the certificate.
    let track = drive(AV_AT - 80.0, 0.0, 2.0);
    let world = World::new(drive(AV_AT - 50.0, 0.0, 2.0))
        .with("b", drive(AV_AT - 80.0, 20.0, 0.0), parked_at(AV_AT - 80.0, 20.0))
        .with_response(response("b", Some("a"), &track, 2.0));
    let scores = world.scores();
    assert_eq!(scores.score("over-reaction"), Some(Score::Mean { sum: 0.0, n: 1 }));
    assert_eq!(scores.score("undisturbed-loss"), None);
}

#[test]
fn absent_responders_are_left_out() {
    let track = drive(0.0, 0.0, 2.0);
    let mut world = World::new(drive(AV_AT - 50.0, 0.0, 2.0))
        .with_response(response("nobody", None, &track, 2.0))
        .with_response(response("av", None, &track, 2.0));
    assert_eq!(world.scores().score("over-reaction"), Some(Score::Mean { sum: 0.0, n: 1 }));
    world.agents[1].2[CURRENT] = None;
    assert_eq!(world.scores().score("over-reaction"), None);
}

#[test]
fn nothing_is_judged_without_a_certificate() {
    let mut world = World::new(frozen()).with("c", drive(0.0, 20.0, 0.0), drive(0.0, 20.0, 2.0));
    near(world.scores().value("undisturbed-loss"), 55.0);
    world.certificate = None;
    let scores = world.scores();
    for id in ["over-reaction", "over-braking", "undisturbed-loss"] {
        assert_eq!(scores.score(id), None, "{id}");
        assert!(events(&scores, id).is_empty(), "{id}");
    }
}

#[test]
fn undisturbed_vehicles_are_measured_against_their_log() {
    let world = |driven: Vec<Frame>| {
        World::new(drive(AV_AT - 50.0, 0.0, 2.0))
            .with("c", drive(0.0, 20.0, 0.0), driven)
            // Parked, and close to the AV: neither is evaluated.
            .with("parked", parked_at(0.0, -20.0), parked_at(0.0, -20.0))
            .with("near", drive(AV_AT - 60.0, 6.0, 0.0), parked_at(AV_AT - 60.0, 6.0))
            .scores()
    };
    let replay = world(drive(0.0, 20.0, 0.0));
    assert_eq!(replay.score("undisturbed-loss"), Some(Score::Mean { sum: 0.0, n: 1 }));
    let farther = world(drive(1.0, 20.0, -1.0));
    assert_eq!(farther.score("undisturbed-loss"), Some(Score::Mean { sum: 0.0, n: 1 }));
    // 80 m in the log, 25 m in the rollout.
    let lost = world(drive(0.0, 20.0, 2.0));
    near(lost.value("undisturbed-loss"), 55.0);
    let found = events(&lost, "undisturbed-loss");
    assert_eq!((found.len(), found[0].0, found[0].1), (1, "c", true));
    let gone = world(drive(0.0, 20.0, 0.0).into_iter().take(HISTORY).collect());
    near(gone.value("undisturbed-loss"), 80.0);
}

#[test]
fn vehicles_that_leave_are_compared_up_to_there() {
    // `a` leaves after 1 s of the certificate. `c` brakes with 2 m/s² and leaves after 2 s and 16 m of 20 m,
    // and `d` after 0.3 s, in which its log moves too little. The log loses `e` at the same time as the
    // rollout.
    let cut = |mut track: Vec<Frame>, steps: usize| {
        track[HISTORY + steps..].fill(None);
        track
    };
    let along = |y: f64, deceleration: f64| drive(0.0, y, deceleration);
    let mut world = World::new(cut(drive(AV_AT - 50.0, 0.0, 2.0), 10))
        .with("c", along(20.0, 0.0), cut(along(20.0, 2.0), 20))
        .with("d", along(40.0, 0.0), cut(along(40.0, 0.0), 3))
        .with("e", cut(along(60.0, 0.0), 30), cut(along(60.0, 2.0), 30));
    // Who vanishes within 50 m of the AV has not left.
    near(world.scores_if(true).value("over-reaction"), 16.0);
    world.agents[0].2 = parked_at(AV_AT + 20.0, 0.0);
    let [vanished, left] = [false, true].map(|may_leave| world.scores_if(may_leave));
    near(vanished.value("over-reaction"), 16.0);
    near(left.value("over-reaction"), 0.0);
    near(vanished.value("undisturbed-loss"), (64.0 + 77.0) / 2.0);
    near(left.value("undisturbed-loss"), 4.0);
    near(vanished.value("progress"), (0.2 + 3.0 / 80.0) / 2.0);
    // The log of `a` comes close to the AV only after it has left: 9 m of 10 m.
    near(left.value("progress"), (0.8 + 0.9) / 2.0);
}

#[test]
fn the_reference_of_braking_is_the_harder_of_profile_and_track() {
    // The log brakes with 3 m/s² until the response begins, which itself needs only 2 m/s².
    let mut world = World::new(drive(AV_AT - 50.0, 0.0, 3.0));
    let track = drive(AV_AT - 50.0, 0.0, 3.0);
    world.certificate = Some(Certificate { responses: vec![response("a", None, &track, 2.0)] });
    near(world.scores().value("over-braking"), 0.0);
}
