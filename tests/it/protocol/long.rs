//! Rollouts of any number of steps.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use reactsim::geometry::{Vec2, direction};
use reactsim::models::find;
use reactsim::rollout::{
    Beginning, Controller, ENTERED, Entering, Episode, JointPlan, LogAv, Memory, Observation, PlanError,
    Request, Rollout, Settings, Simulator, roll_out,
};
use reactsim::scene::{
    AgentState, CURRENT, DT, Frame, HISTORY, Length, LightState, LoggedAgent, MapParts, Scenario,
};

use super::{every_baseline, settings};
use crate::scenes::{bits, car, lane, mini, roll, scene};

/// Steps of the long rollouts.
const STEPS: usize = 200;
/// Number of frames that models may look back, besides the history.
const LOOK_BACK: usize = 90;

/// Returns the state after some steps at constant velocity.
fn later(state: &AgentState, steps: usize) -> AgentState {
    let v = state.velocity().unwrap_or_default() * (DT * steps as f64);
    AgentState { x: state.x + v.x, y: state.y + v.y, ..*state }
}

/// Extends a list of frames: who is there in the last one goes on.
fn extend(track: &mut Vec<Frame>, frames: usize) {
    let last = *track.last().unwrap();
    track.extend((1..=frames).map(|k| last.map(|state| later(&state, k))));
}

/// Returns a scenario whose log is extended to this number of steps: agents keep their velocities, and lights
/// their states.
fn lengthened(scenario: &Scenario, future: usize) -> Scenario {
    let mut long = scenario.clone();
    let more = future - long.length().future;
    long.log_future.tracks.iter_mut().for_each(|track| extend(track, more));
    for states in &mut long.log_future.lights {
        states.resize(future, states[states.len() - 1]);
    }
    for LoggedAgent { track, heights, .. } in &mut long.unselected {
        extend(track, more);
        if !heights.is_empty() {
            heights.resize(HISTORY + future, None);
        }
    }
    long.log_future.heights.iter_mut().for_each(|heights| heights.resize(future, None));
    long.timestamps.clear();
    long.deviation = None;
    assert_eq!(long.length(), Length { history: HISTORY, future });
    long
}

/// Returns a scenario, and the same with a longer log.
fn short_and_long() -> [Scenario; 2] {
    let short = mini().swap_remove(0);
    let long = lengthened(&short, STEPS);
    [short, long]
}

/// Returns a rollout in which the AV keeps its velocity.
fn coasting(scenario: &Scenario, controller: &Controller, replan: usize) -> Rollout {
    let now = scenario.start.now(0);
    let av = (1..=scenario.length().future).map(|k| later(&now, k)).collect();
    roll(scenario, av, controller, &settings(replan, true))
}

#[test]
fn a_long_rollout_begins_as_a_short_one_and_goes_on() {
    let [short, long] = short_and_long();
    for (model, controller) in every_baseline() {
        // A plan of 80 steps that ends with the log, and one that does not.
        let intervals: &[usize] = if model.needs_weights { &[5] } else { &[1, 5, 80] };
        for &replan in intervals {
            let what = format!("{} every {replan}", model.id);
            let (begun, whole) =
                (coasting(&short, &controller, replan), coasting(&long, &controller, replan));
            let frames = HISTORY + short.length().future;
            let same: Vec<Vec<Frame>> = whole.tracks.iter().map(|track| track[..frames].to_vec()).collect();
            assert!(bits(&same) == bits(&begun.tracks), "{what}: the first steps depend on the length");
            for (slot, track) in whole.tracks.iter().enumerate() {
                assert_eq!(track.len(), HISTORY + STEPS, "{what}");
                for (frame, state) in track.iter().enumerate().skip(HISTORY) {
                    assert!(
                        model.oracle || state.is_some(),
                        "{what}: agent {slot} vanishes at frame {frame}"
                    );
                    assert!(state.is_none_or(|s| s.is_finite()), "{what}: agent {slot} at frame {frame}");
                    let near = |s: AgentState| s.position().norm() < 50.0 * DT * (STEPS + 500) as f64;
                    assert!(state.is_none_or(near), "{what}: agent {slot} is far away at frame {frame}");
                }
            }
        }
    }
}

/// A simulator that observes another past: all frames since the history that are older than a number of frames.
/// It never continues from a new start, so that a network may look back to the beginning.
struct OtherPast {
    inner: Box<dyn Simulator>,
    look_back: usize,
}

/// What an episode observes instead.
struct Past {
    tracks: Vec<Vec<Frame>>,
    lights: Vec<Vec<Option<LightState>>>,
}

impl Past {
    fn of(seen: &Observation<'_>, look_back: usize) -> Self {
        let forgotten = HISTORY..seen.frame().saturating_sub(look_back).max(HISTORY);
        let mut tracks = seen.tracks().to_vec();
        for state in tracks.iter_mut().flat_map(|track| &mut track[forgotten.clone()]).flatten() {
            *state = AgentState { x: state.x + 1000.0, y: -state.y, heading: 1.0, vx: -7.0, vy: 3.0 };
        }
        let mut lights: Vec<_> = (0..seen.start().lights.len()).map(|l| seen.light(l).to_vec()).collect();
        lights.iter_mut().for_each(|states| states[forgotten.clone()].fill(None));
        Self { tracks, lights }
    }
}

impl Simulator for OtherPast {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        self.inner.begin_batch(batch)
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        self.inner.end_batch(memories);
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let pasts: Vec<Past> = batch.iter().map(|episode| Past::of(&episode.seen, self.look_back)).collect();
        let mut inner: Vec<Episode<'_>> = Vec::new();
        for (episode, past) in batch.iter_mut().zip(&pasts) {
            let seen = &episode.seen;
            inner.push(Episode {
                seen: Observation::new(seen.start(), &past.tracks, &past.lights, seen.av_next()),
                memory: &mut *episode.memory,
                stream: &mut *episode.stream,
                moves_av: episode.moves_av,
                shares_traffic: episode.shares_traffic,
                plan: JointPlan::new(episode.plan.agents(), episode.plan.steps()),
                outcomes: std::mem::take(&mut episode.outcomes),
                error: None,
            });
        }
        self.inner.plan(&mut inner)?;
        let done: Vec<_> = inner.into_iter().map(|e| (e.plan, e.outcomes, e.error)).collect();
        for (episode, (plan, outcomes, error)) in batch.iter_mut().zip(done) {
            (episode.plan, episode.outcomes, episode.error) = (plan, outcomes, error);
        }
        Ok(())
    }
}

#[test]
fn no_plan_depends_on_more_than_the_last_nine_seconds() {
    let [_, long] = short_and_long();
    let others = every_baseline();
    for ((model, controller), (_, other)) in every_baseline().zip(others) {
        let (Controller::Fair(all), Controller::Fair(recent)) = (controller, other) else { continue };
        let [wanted, found] = [(all, usize::MAX), (recent, LOOK_BACK)].map(|(inner, look_back)| {
            coasting(&long, &Controller::Fair(Box::new(OtherPast { inner, look_back })), 5)
        });
        let same = bits(&found.tracks) == bits(&wanted.tracks) && found.outcomes == wanted.outcomes;
        assert!(same, "{}: an old frame changes a plan", model.id);
    }
}

/// Paths are planned for 8 s, in which this car drives less than half of its round.
#[test]
fn drivers_of_idm_stay_on_their_road() {
    const RADIUS: f64 = 60.0;
    let half = |from: f64| (0..=90).map(|k| direction(from + PI * f64::from(k) / 90.0) * RADIUS).collect();
    let mut lanes = [lane("first", half(0.0), Some(12.0)), lane("second", half(PI), Some(12.0))];
    for (lane, next) in lanes.iter_mut().zip(["second", "first"]) {
        lane.successors = vec![next.to_owned()];
        lane.predecessors = vec![next.to_owned()];
    }
    let agents = vec![car("av", 0.0, 0.0, 0.0, 0.0), car("one", RADIUS, 0.0, FRAC_PI_2, 10.0)];
    let ring = scene("ring", agents, MapParts { lanes: lanes.into(), ..MapParts::default() });
    let ring = lengthened(&ring, 600);
    for id in ["idm", "idm@styles"] {
        let controller = find(id).unwrap().simulator().unwrap();
        for replan in [1, 5, 7, 80] {
            let rollout = coasting(&ring, &controller, replan);
            let driven: Vec<Vec2> =
                rollout.tracks[1][HISTORY..].iter().map(|state| state.unwrap().position()).collect();
            let off = driven.iter().map(|p| (p.norm() - RADIUS).abs()).fold(0.0, f64::max);
            let length: f64 = driven.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
            assert!(off < 1.5, "{id} every {replan}: {off} m off the road");
            assert!(length > 400.0, "{id} every {replan}: {length} m in a minute");
        }
    }
}

/// A minute on a motorway of eight lanes, on which cars arrive every 2.5 s until 249 are there.
#[test]
fn a_minute_with_hundreds_of_agents_is_rolled_out() {
    const LANES: usize = 8;
    const FIRST_CARS: usize = 7;
    const INTERVAL: usize = 25;
    let lanes = (0..LANES).map(|lane_index| {
        let y = 3.5 * lane_index as f64;
        lane(&format!("lane-{lane_index}"), vec![Vec2::new(-100.0, y), Vec2::new(2000.0, y)], Some(12.0))
    });
    let map = MapParts { lanes: lanes.collect(), ..MapParts::default() };
    let on_lane = |id: &str, x: f64, lane_index: usize| car(id, x, 3.5 * lane_index as f64, 0.0, 10.0);
    let mut agents = vec![on_lane("av", 0.0, 0)];
    for lane_index in 0..LANES {
        let cars = (0..FIRST_CARS).map(|i| (format!("first-{lane_index}-{i}"), 40.0 * (i + 1) as f64));
        agents.extend(cars.map(|(id, x)| on_lane(&id, x, lane_index)));
    }
    let mut street = lengthened(&scene("motorway", agents, map), 600);
    let first_frames = (HISTORY..HISTORY + 600).step_by(INTERVAL);
    for (first, lane_index) in first_frames.flat_map(|first| (0..LANES).map(move |l| (first, l))) {
        let mut late = on_lane(&format!("late-{lane_index}-{first}"), -50.0, lane_index);
        let enters = late.track[CURRENT].unwrap();
        let logged = |frame: usize| (frame >= first).then(|| later(&enters, frame - first));
        late.track = (0..HISTORY + 600).map(logged).collect();
        street.unselected.push(late);
    }
    let entering = Settings { entering: Entering::Log, ..settings(5, true) };
    for id in ["idm", "nuplan-idm", "constant-velocity"] {
        let controller = find(id).unwrap().simulator().unwrap();
        let request =
            Request { scenario: &street, av: Some(Arc::new(LogAv::new(&street).unwrap())), rollout: 0 };
        let done = roll_out(vec![request], &controller, &entering).remove(0).unwrap();
        assert_eq!(done.outcomes[ENTERED], 192, "{id}");
        let mut last: Vec<Vec2> = done.tracks.iter().map(|t| t.last().unwrap().unwrap().position()).collect();
        assert_eq!(last.len(), 249, "{id}");
        last.sort_by(|a, b| (a.y.round(), a.x).partial_cmp(&(b.y.round(), b.x)).unwrap());
        let gaps = last.windows(2).filter(|pair| (pair[1].y - pair[0].y).abs() < 1.0);
        let least = gaps.map(|pair| pair[1].x - pair[0].x).fold(f64::INFINITY, f64::min);
        assert!(least > 4.6, "{id}: {least} m between two cars");
    }
}
