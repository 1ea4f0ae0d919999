use std::sync::Arc;

use reactsim_geometry::Vec2;
use reactsim_scene::{
    Agent, AgentKind, AgentState, CURRENT, DT, Frame, HISTORY, LaneParts, Length, LoggedAgent, MapParts,
    Scenario, ScenarioParts, Start, levels::MapHeights,
};

use super::{Entered, Entering, MAX_PRESENT, TrackHeights};
use crate::{
    Controller, ENTERED, ENTERED_LATE, KEPT_OUT, LEFT, LogAv, OVER_LIMIT, PAST_ROAD_END, PlanError, Planning,
    Request, Rollout, Settings, SingleEpisode, Stream, roll_out,
};

/// Steps of the scenarios here.
const STEPS: usize = 60;

/// Vehicles that keep their velocity. The memory holds the ids of the agents since the last change, and how
/// often agents came or went.
struct Keep;

struct Known {
    ids: Vec<String>,
    changes: usize,
}

impl SingleEpisode for Keep {
    type Memory = Known;

    fn id(&self) -> &'static str {
        "keep"
    }

    fn begin(&self, start: &Start, _: &mut Stream) -> Known {
        assert_eq!(start.history[0].len(), HISTORY);
        Known { ids: start.agents.iter().map(|agent| agent.id.clone()).collect(), changes: 0 }
    }

    fn resume(&self, before: Known, kept: &[Option<usize>], start: &Start, stream: &mut Stream) -> Known {
        let new = self.begin(start, stream);
        for (id, slot) in new.ids.iter().zip(kept) {
            let position = before.ids.iter().position(|other| other == id);
            assert_eq!(position, *slot, "{id}");
        }
        Known { changes: before.changes + 1, ..new }
    }

    fn plan_one(&self, known: &mut Known, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        assert_eq!(episode.seen.changes(), known.changes);
        assert_eq!(episode.plan.agents(), known.ids.len());
        for agent in 1..known.ids.len() {
            let now = episode.seen.state(agent).expect("agents of the start are present");
            for step in 0..episode.plan.steps() {
                episode.plan.set(agent, step, Some(later(now, step + 1)));
            }
        }
        Ok(())
    }
}

fn later(now: AgentState, steps: usize) -> AgentState {
    let time = steps as f64 * DT;
    AgentState { x: now.x + now.vx * time, y: now.y + now.vy * time, ..now }
}

fn vehicle(id: &str, at: impl Fn(usize) -> Option<(f64, f64, f64)>, frames: usize) -> LoggedAgent {
    let agent = Agent { id: id.to_owned(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
    let state = |(x, y, vx)| AgentState { x, y, heading: 0.0, vx, vy: 0.0 };
    LoggedAgent { agent, track: (0..frames).map(|f| at(f).map(state)).collect(), heights: Vec::new() }
}

fn scenario(history: usize, others: &[LoggedAgent]) -> Scenario {
    scenario_on(MapParts::default(), history, others)
}

fn scenario_on(map: MapParts, history: usize, others: &[LoggedAgent]) -> Scenario {
    let length = Length { history, future: STEPS };
    let av = vehicle("av", |f| Some((f as f64 - (history - 1) as f64, 0.0, 10.0)), length.frames());
    let agents = std::iter::once(av).chain(others.iter().cloned()).collect();
    let parts = ScenarioParts {
        id: "made".into(),
        origin: Some(Vec2::zeros()),
        length,
        agents,
        map,
        ..Default::default()
    };
    Scenario::assemble(parts).unwrap()
}

fn run(scenario: &Scenario, entering: Entering, controller: &Controller) -> Rollout {
    let av = Arc::new(LogAv::new(scenario).unwrap());
    let request = Request { scenario, av: Some(av), rollout: 0 };
    let settings = Settings { entering, ..Settings::default() };
    roll_out(vec![request], controller, &settings).remove(0).unwrap()
}

fn keep() -> Controller {
    Controller::Fair(Box::new(Keep))
}

fn x(track: &[Frame], frame: usize) -> Option<f64> {
    track[frame].map(|state| state.x)
}

#[test]
fn an_agent_enters_at_its_first_pose_and_is_simulated_from_then_on() {
    let frames = HISTORY + STEPS;
    // Seen at frames 2 to 4, hidden now, and again from frame 33 on.
    let hidden = vehicle(
        "hidden",
        |f| ((2..5).contains(&f) || f >= 33).then_some((f as f64 - 3.0, 20.0, 5.0)),
        frames,
    );
    let made = scenario(HISTORY, &[hidden]);
    let off = run(&made, Entering::Off, &keep());
    assert_eq!((off.tracks.len(), off.entered.len()), (1, 0));

    let on = run(&made, Entering::Log, &keep());
    assert_eq!(on.entered, [Entered { logged: 0, frame: 33, waited: 0 }]);
    let track = &on.tracks[1];
    assert_eq!(track.len(), frames);
    let seen: Vec<usize> = (0..33).filter(|f| track[*f].is_some()).collect();
    assert_eq!(seen, [2, 3, 4]);
    assert_eq!(x(track, 33), Some(30.0));
    // Its log of 1 m per frame is withheld: it keeps its velocity of 5 m/s, also from the plan at frame 35
    // on.
    assert_eq!((x(track, 34), x(track, 35)), (Some(30.5), Some(31.0)));
    let last = track[35].unwrap();
    assert_eq!(x(track, 45), Some(later(last, 10).x));
    assert_eq!(on.tracks[0], off.tracks[0]);
}

#[test]
fn an_agent_waits_until_its_place_is_free() {
    let frames = HISTORY + STEPS;
    let slow = vehicle("slow", |f| Some((10.0 + 2.0 * DT * (f as f64 - CURRENT as f64), 9.0, 2.0)), frames);
    // The place is behind `slow` by less than a vehicle length at frame 20: 12 m against 10 m.
    let late = vehicle("late", |f| (f >= 20).then_some((10.0, 9.0, 1.0)), frames);
    let never = vehicle("never", |f| (f >= 20).then_some((10.5, 9.0, 0.0)), frames);
    let made = scenario(HISTORY, &[slow, late, never]);
    let done = run(&made, Entering::Log, &keep());
    // `slow` is more than 4 m ahead of the place at 14 m, after frame 30; the other place is then taken.
    assert_eq!(done.entered.len(), 1);
    let Entered { frame, waited, .. } = done.entered[0];
    assert_eq!((frame, waited), (31, 11));
    assert!((x(&done.tracks[2], 31).unwrap() - 10.0).abs() < 1e-9);
    assert_eq!((done.outcomes[ENTERED], done.outcomes[ENTERED_LATE], done.outcomes[KEPT_OUT]), (1, 1, 1));
    assert!(!done.outcomes.contains_key(OVER_LIMIT));
}

#[test]
fn an_agent_on_a_bridge_does_not_wait_for_the_road_below() {
    let frames = HISTORY + STEPS;
    let lane = |id: &str, from: Vec2, to: Vec2| LaneParts {
        id: id.into(),
        points: (0..=40).map(|k| from + (to - from) * (f64::from(k) / 40.0)).collect(),
        ..LaneParts::default()
    };
    let lanes = vec![
        lane("below", Vec2::new(-100.0, 0.0), Vec2::new(300.0, 0.0)),
        lane("above", Vec2::new(200.0, -100.0), Vec2::new(200.0, 100.0)),
    ];
    let heights = MapHeights { lanes: vec![vec![0.0; 41], vec![7.0; 41]], ..MapHeights::default() };
    let rolled_out = |height: f64| {
        let at = |id: &str, from: usize, height: f64| {
            let there = vehicle(id, |f| (f >= from).then_some((200.0, 0.0, 0.0)), frames);
            LoggedAgent { heights: vec![Some(height); frames], ..there }
        };
        let map = MapParts { lanes: lanes.clone(), heights: heights.clone(), ..MapParts::default() };
        // A third one comes later, when the bridge is taken.
        let others = [at("below", 0, 0.0), at("late", 30, height), at("later", 40, height)];
        let made = scenario_on(map, HISTORY, &others);
        assert!(made.start.has_levels());
        let done = run(&made, Entering::Log, &keep());
        let entered: Vec<_> = done.entered.iter().map(|agent| (agent.frame, agent.waited)).collect();
        let kept_out = done.outcomes[KEPT_OUT];
        (made, done, entered, kept_out)
    };
    let (.., entered, kept_out) = rolled_out(0.0);
    assert_eq!((entered, kept_out), (vec![], 2));
    let (made, done, entered, kept_out) = rolled_out(7.0);
    assert_eq!((entered, kept_out), (vec![(30, 0)], 1));
    // Heights are the same however often they are asked for.
    let mut followed = TrackHeights::default();
    for end in [HISTORY, HISTORY + 1, 40, 41, frames] {
        for (slot, track) in done.tracks.iter().enumerate().skip(1).filter(|(slot, _)| *slot < 2 || end > 30)
        {
            let track = &track[..end];
            let known = followed.along(&made, &done.entered, slot, track).to_vec();
            assert_eq!(known, TrackHeights::default().along(&made, &done.entered, slot, track));
            let at = |height: f64| known.last().copied().flatten() == Some(height);
            assert!(at(if slot == 2 { 7.0 } else { 0.0 }), "{slot}: {known:?}");
        }
    }
}

#[test]
fn an_agent_leaves_where_the_log_loses_it_far_away() {
    let frames = HISTORY + STEPS;
    let ahead = |speed: f64, from: f64| move |f: usize| from + speed * DT * (f as f64 - CURRENT as f64);
    // Lost by the log at frame 30, 60 m ahead of the AV there; it drives away from it.
    let fast = ahead(20.0, 40.0);
    let far = vehicle("far", |f| (f <= 30).then(|| (fast(f), 9.0, 20.0)), frames);
    // Lost at the same frame, but near the AV: it was hidden.
    let near = vehicle("near", |f| (f <= 30).then(|| (ahead(10.0, 20.0)(f), -9.0, 10.0)), frames);
    let made = scenario(HISTORY, &[far, near]);
    let done = run(&made, Entering::Log, &keep());
    let slot = |id: &str| made.start.agents.iter().position(|agent| agent.id == id).unwrap();
    let last = |slot: usize| (0..frames).rev().find(|f| done.tracks[slot][*f].is_some());
    assert_eq!((last(slot("far")), last(slot("near"))), (Some(30), Some(frames - 1)));
    assert_eq!(done.outcomes, [(LEFT, 1)].into());
}

#[test]
fn simulators_observe_the_history_that_they_are_for() {
    let others =
        |history: usize| [vehicle("b", |f| Some((20.0 + 0.5 * f as f64, 9.0, 5.0)), history + STEPS)];
    // `Keep` asserts that it gets 11 frames.
    for history in [2, HISTORY, 21, 100] {
        let made = scenario(history, &others(history));
        let done = run(&made, Entering::Off, &keep());
        assert_eq!(done.tracks[0].len(), history + STEPS);
        let start = x(&done.tracks[1], history - 1).unwrap();
        assert!((x(&done.tracks[1], history - 1 + STEPS).unwrap() - start - 30.0).abs() < 1e-9);
    }
}

#[test]
fn no_more_agents_enter_than_can_be_present() {
    let frames = HISTORY + STEPS;
    let later = |i: usize| {
        let place =
            move |f: usize| (f > 20).then_some((5.0 * (i % 20) as f64, 20.0 + 5.0 * (i / 20) as f64, 0.0));
        vehicle(&i.to_string(), place, frames)
    };
    let made = scenario(HISTORY, &(0..MAX_PRESENT + 20).map(later).collect::<Vec<_>>());
    let done = run(&made, Entering::Log, &keep());
    assert_eq!(done.tracks.len(), MAX_PRESENT);
    assert_eq!(done.outcomes, [(ENTERED, MAX_PRESENT as u64 - 1), (OVER_LIMIT, 21)].into());
}

/// Returns a vehicle that creeps across the end of a road.
fn turned(mut vehicle: LoggedAgent) -> LoggedAgent {
    for (frame, state) in vehicle.track.iter_mut().enumerate() {
        let y = 18.0 + 0.06 * frame as f64;
        *state = state.map(|s| AgentState { y, heading: std::f64::consts::FRAC_PI_2, vy: 0.6, ..s });
    }
    vehicle
}

#[test]
fn vehicles_leave_past_the_end_of_a_road() {
    let frames = HISTORY + STEPS;
    let lane = |id: &str, from: (f64, f64), to: (f64, f64)| LaneParts {
        id: id.into(),
        points: vec![Vec2::new(from.0, from.1), Vec2::new(to.0, to.1)],
        ..LaneParts::default()
    };
    // The AV drives along y = 0 from x = 0 to 60 m. Each road carries one vehicle at 10 m/s.
    let roads = [
        lane("end", (0.0, 20.0), (200.0, 20.0)),
        // Without a link, but the road continues.
        lane("gap", (0.0, 40.0), (200.0, 40.0)),
        lane("further", (200.5, 40.0), (400.0, 40.0)),
        // Within 50 m of the AV.
        lane("near", (0.0, -20.0), (60.0, -20.0)),
        lane("crossing", (160.0, 0.0), (160.0, 70.0)),
    ];
    let map = MapParts { lanes: roads.to_vec(), ..MapParts::default() };
    let driven = |id, x: f64, y| vehicle(id, |f| Some((x + f as f64 - 10.0, y, 10.0)), frames);
    let others = [
        driven("ends", 170.0, 20.0),
        driven("continues", 170.0, 40.0),
        driven("observed", 40.0, -20.0),
        driven("crosses", 140.0, 70.0),
        driven("aside", 170.0, 23.0),
        vehicle("parked", |_| Some((199.0, 20.5, 0.0)), frames),
        turned(vehicle("unaligned", |_| Some((201.0, 20.0, 0.0)), frames)),
    ];
    let made = scenario_on(map, HISTORY, &others);
    let on = run(&made, Entering::Log, &keep());
    let of = |id: &str| made.start.agents.iter().position(|agent| agent.id == id).unwrap();
    // Its front is at 199 m, and would be at 200 m after another step.
    let track = &on.tracks[of("ends")];
    assert_eq!((x(track, 37), x(track, 38)), (Some(197.0), None));
    assert!(track[38..].iter().all(Option::is_none));
    for id in ["continues", "observed", "crosses", "aside", "parked", "unaligned"] {
        assert!(on.tracks[of(id)].iter().all(Option::is_some), "{id}");
    }
    assert_eq!(on.outcomes[PAST_ROAD_END], 1);
    let off = run(&made, Entering::Off, &keep());
    assert!(off.tracks.iter().flatten().all(Option::is_some));
}

/// Vehicles that stand still, planned from a new start every 20 steps. The memory counts the starts; the list
/// has the step of each, and where the AV was in it.
struct Renewed(Arc<std::sync::Mutex<Vec<(usize, f64)>>>);

impl SingleEpisode for Renewed {
    type Memory = usize;

    fn id(&self) -> &'static str {
        "renewed"
    }

    fn begin(&self, _: &Start, _: &mut Stream) -> usize {
        0
    }

    fn horizon(&self) -> Option<usize> {
        Some(20)
    }

    fn resume(&self, before: usize, kept: &[Option<usize>], _: &Start, _: &mut Stream) -> usize {
        assert_eq!(kept, [Some(0), Some(1)]);
        before + 1
    }

    fn plan_one(&self, starts: &mut usize, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let seen = episode.seen;
        let mut known = self.0.lock().unwrap();
        if known.len() == *starts {
            known.push((seen.step(), seen.start().now(0).x));
        }
        assert_eq!(seen.changes(), *starts);
        (0..episode.plan.steps()).for_each(|step| episode.plan.set(1, step, seen.state(1)));
        Ok(())
    }
}

#[test]
fn simulators_get_a_new_start_when_their_horizon_is_over() {
    let known = Arc::default();
    let controller = Controller::Fair(Box::new(Renewed(Arc::clone(&known))));
    let made = scenario(HISTORY, &[vehicle("other", |_| Some((0.0, 20.0, 0.0)), HISTORY + STEPS)]);
    let done = run(&made, Entering::Off, &controller);
    assert_eq!(*known.lock().unwrap(), [(0, 0.0), (20, 20.0), (40, 40.0)]);
    assert!(done.tracks.iter().flatten().all(Option::is_some));
}
