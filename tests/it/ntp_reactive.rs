//! The reactive network and its simulator: independence from the frame of reference, limits of what is
//! visible, and no effect of batches.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use burn::tensor::Device;
use reactsim::formats;
use reactsim::geometry::{Vec2, direction};
use reactsim::models::nn::device;
use reactsim::models::ntp::learn::{NextToken, Recipe};
use reactsim::models::ntp::reactive::{Config, Logits, Policy, ReactiveSimulator};
use reactsim::models::ntp::tokens::Kinematic;
use reactsim::models::ntp::{Driving, Sampling};
use reactsim::models::perception::{Class, KnownMotion};
use reactsim::rollout::{
    Beginning, Controller, Episode, JointPlan, LogAv, Memory, Observation, Purpose, Request, Rollout,
    Settings, roll_out, stream,
};
use reactsim::scene::{AgentKind, CURRENT, FRAMES, Frame, Scenario};
use reactsim::training::Task;

use crate::model_weights::{check_cut, replaced};
use crate::program::BENCH;

/// Returns a network with random weights: its output has the right form, but no meaning.
pub(crate) fn policy(device: &Device) -> Policy {
    let task = NextToken::new(Recipe::default(), Kinematic::default().build().unwrap(), device);
    let bytes = task.file(&task.init(7), &BTreeMap::new()).unwrap();
    Policy::read(&bytes, device).unwrap()
}

pub(crate) fn untrained() -> Vec<u8> {
    let network = Config {
        hidden: 16,
        heads: 2,
        head_width: 8,
        relation: 16,
        feed_forward: 16,
        head_hidden: 16,
        ..Config::default()
    };
    let vocabulary = crate::smart_simulator::coarse().build().unwrap();
    let task = NextToken::new(Recipe { network, ..Recipe::default() }, vocabulary, &device());
    task.file(&task.init(7), &BTreeMap::new()).unwrap()
}

pub(crate) fn scenarios(count: usize) -> Vec<Scenario> {
    formats::open(Path::new(BENCH)).unwrap().take(count).map(Result::unwrap).collect()
}

fn greedy() -> Driving {
    Driving { projection: true, keep_clear: true, sampling: Sampling { top_k: 1, temperature: 1.0 } }
}

pub(crate) fn tracks(scenario: &Scenario) -> Vec<Vec<Frame>> {
    (0..scenario.start.agents.len()).map(|a| scenario.logged(a)).collect()
}

pub(crate) fn lights(scenario: &Scenario) -> Vec<Vec<Option<reactsim::scene::LightState>>> {
    (0..scenario.start.lights.len()).map(|l| scenario.light_states(l)).collect()
}

const STEPS: [usize; 5] = [0, 5, 10, 15, 20];

fn logits_of(policy: &Policy, scenario: &Scenario, tracks: &[Vec<Frame>], device: &Device) -> Vec<Logits> {
    let lights = lights(scenario);
    let known = KnownMotion { start: &scenario.start, tracks, lights: &lights, av_lookahead: true };
    policy.logits(&known, &STEPS, device)
}

fn largest_difference(a: &[Logits], b: &[Logits]) -> f32 {
    assert_eq!(a.len(), b.len());
    let mut largest = 0.0f32;
    for (a, b) in a.iter().zip(b) {
        assert_eq!((a.frame, a.slot), (b.frame, b.slot));
        for (x, y) in a.values.iter().zip(&b.values) {
            largest = largest.max((x - y).abs());
        }
    }
    largest
}

fn run(controller: &Controller, batch: &[&Scenario], settings: &Settings) -> Vec<Rollout> {
    let av = |scenario| Arc::new(LogAv::new(scenario).unwrap());
    let requests = batch.iter().map(|s| Request { scenario: s, av: Some(av(s)), rollout: 0 }).collect();
    roll_out(requests, controller, settings).into_iter().map(Result::unwrap).collect()
}

/// Returns the first plan of two seconds of the shipped network, of which `executed` steps are executed.
fn planned(scenario: &Scenario, executed: usize) -> JointPlan {
    let Controller::Fair(simulator) = reactsim::models::find("ntp-reactive").unwrap().simulator().unwrap()
    else {
        panic!("sees the future")
    };
    let start = &scenario.start;
    let mut beginning = [Beginning {
        start,
        stream: stream(0, "outlook", 0, Purpose::Plan),
        moves_av: false,
        steps: 5,
        future: 80,
        identity: None,
        memory: Memory::NONE,
    }];
    simulator.begin_batch(&mut beginning).unwrap();
    let [Beginning { mut stream, mut memory, .. }] = beginning;
    let known = |track: Vec<Frame>| track[..=CURRENT].to_vec();
    let tracks: Vec<Vec<Frame>> = tracks(scenario).into_iter().map(known).collect();
    let lights: Vec<_> = lights(scenario).into_iter().map(|l| l[..=CURRENT].to_vec()).collect();
    let mut batch = [Episode {
        seen: Observation::new(start, &tracks, &lights, None),
        memory: &mut memory,
        stream: &mut stream,
        moves_av: false,
        shares_traffic: false,
        plan: JointPlan::with_outlook(tracks.len(), 20, executed),
        outcomes: BTreeMap::new(),
        error: None,
    }];
    simulator.plan(&mut batch).unwrap();
    let [Episode { plan, .. }] = batch;
    plan
}

#[test]
fn agents_that_stand_do_so_in_the_outlook() {
    let (mut standing, mut present) = (0, 0);
    for scenario in &scenarios(6) {
        let (whole, outlook) = (planned(scenario, 20), planned(scenario, 5));
        for slot in 1..whole.agents() {
            let states = |plan: &JointPlan| (0..20).map(|k| plan.get(slot, k)).collect::<Vec<_>>();
            let (whole, outlook) = (states(&whole), states(&outlook));
            assert_eq!(whole[..5], outlook[..5], "what is executed does not depend on the outlook");
            let Some(last) = outlook[19] else { continue };
            present += 1;
            let stays = outlook[4..].iter().all(|s| s.unwrap().position() == last.position());
            standing += usize::from(stays);
            // Whom the network lets stand does not move in the whole plan either.
            let moved = (whole[19].unwrap().position() - last.position()).norm();
            assert!(!stays || moved < 0.5, "{} {slot}: {moved} m", scenario.id);
        }
    }
    assert!(standing > present / 3 && standing < present, "{standing} of {present} stand");
}

#[test]
fn a_cached_step_is_the_last_of_all_steps() {
    let device = device();
    let policy = policy(&device);
    let scenario = &scenarios(1)[0];
    let (tracks, lights) = (tracks(scenario), lights(scenario));
    let known = KnownMotion { start: &scenario.start, tracks: &tracks, lights: &lights, av_lookahead: true };
    let all = logits_of(&policy, scenario, &tracks, &device);
    let last: Vec<Logits> = all.into_iter().filter(|l| l.frame == STEPS[4]).collect();
    let step = policy.cached_step(&known, &STEPS, &device).unwrap();
    let found = last.iter().zip(step.logits());
    let found: Vec<Logits> = found.map(|(l, values)| Logits { values, ..l.clone() }).collect();
    assert!(found.len() > 10 && found.len() == step.classes().len());
    assert!(largest_difference(&last, &found) < 1e-4);
    let input = step.input();
    assert_eq!(input["bodies"].dims()[0], found.len());
    assert_eq!(input["agents.sources"].dims(), [found.len(), policy.config.agents]);
    assert!(policy.cached_step(&known, &[], &device).is_none());
}

#[test]
fn what_is_computed_step_by_step_is_what_one_pass_gives() {
    let device = device();
    let policy = policy(&device);
    // The most probable token is always taken.
    let driving = Driving { keep_clear: false, ..greedy() };
    let simulator = ReactiveSimulator::new(policy.clone(), driving, device.clone()).without_rests();
    let controller = Controller::Fair(Box::new(simulator));
    for scenario in &scenarios(3) {
        let rollout = &run(&controller, &[scenario], &Settings::default())[0];
        let lights = lights(scenario);
        let known = KnownMotion {
            start: &scenario.start,
            tracks: &rollout.tracks,
            lights: &lights,
            av_lookahead: true,
        };
        let frames: Vec<usize> = (0..FRAMES - 1).step_by(5).collect();
        let mut checked = 0;
        for Logits { frame, slot, values } in policy.logits(&known, &frames, &device) {
            let agent = &scenario.start.agents[slot];
            if frame < CURRENT || slot == 0 || agent.kind == AgentKind::Vehicle {
                continue;
            }
            // Pedestrians and cyclists move exactly as their tokens, so that the token can be recognised.
            let class = Class::of(agent.kind).unwrap();
            let best =
                (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b]).then(b.cmp(&a))).unwrap();
            let (from, to) = (rollout.tracks[slot][frame].unwrap(), rollout.tracks[slot][frame + 5].unwrap());
            let token = policy.vocabulary.end(class, best);
            let ahead = direction(from.heading);
            let end =
                from.position() + ahead * token.position.x + Vec2::new(-ahead.y, ahead.x) * token.position.y;
            let runner_up =
                (0..values.len()).filter(|&i| i != best).map(|i| values[i]).fold(f32::MIN, f32::max);
            if values[best] - runner_up > 1e-4 {
                assert!((end - to.position()).norm() < 1e-6, "{} {frame} {slot}", scenario.id);
                checked += 1;
            }
        }
        assert!(checked > 0 || scenario.start.agents.iter().all(|a| a.kind == AgentKind::Vehicle));
    }
}

#[test]
fn agents_that_stand_rest_for_a_plan() {
    let device = device();
    let weights = concat!(env!("CARGO_MANIFEST_DIR"), "/weights/ntp-reactive.safetensors");
    let policy = Policy::read(&std::fs::read(weights).unwrap(), &device).unwrap();
    let driving = Driving { sampling: Sampling { top_k: 8, temperature: 0.5 }, ..greedy() };
    let simulator = || ReactiveSimulator::new(policy.clone(), driving, device.clone());
    let run = |simulator: ReactiveSimulator, scenario: &Scenario| {
        run(&Controller::Fair(Box::new(simulator)), &[scenario], &Settings::default()).remove(0)
    };
    let (mut differ, mut stand, mut set_off) = (0, [0, 0], [0, 0]);
    for scenario in &scenarios(40) {
        let rollouts = [run(simulator(), scenario), run(simulator().without_rests(), scenario)];
        differ += usize::from(rollouts[0].tracks != rollouts[1].tracks);
        for (i, rollout) in rollouts.iter().enumerate() {
            for track in &rollout.tracks[1..] {
                let moved = |from: usize| {
                    let at = |frame: usize| track[frame].map(|s| s.position());
                    Some((at(from + 5)? - at(from)?).norm())
                };
                for frame in (CURRENT..FRAMES - 10).step_by(5) {
                    let stands = moved(frame).is_some_and(|distance| distance < 0.05);
                    stand[i] += u32::from(stands);
                    set_off[i] += u32::from(stands && moved(frame + 5).is_some_and(|d| d > 0.1));
                }
            }
        }
    }
    assert!(differ > 0, "nobody rests");
    // Agents that may set off do not rest, and others rest for no more than a plan.
    assert!(stand[0] > 1000 && 2 * set_off[0] > set_off[1], "{set_off:?} of {stand:?} set off");
}

#[test]
fn a_scene_that_is_turned_and_moved_is_the_same() {
    let device = device();
    let policy = policy(&device);
    for scenario in scenarios(2) {
        let before = logits_of(&policy, &scenario, &tracks(&scenario), &device);
        let (angle, shift) = (2.1f64, Vec2::new(13.0, -4.0));
        let turned = moved(scenario, angle, shift);
        let after = logits_of(&policy, &turned, &tracks(&turned), &device);
        let largest = largest_difference(&before, &after);
        assert!(largest < 1e-4, "{largest}");
    }
}

/// Returns the scenario turned about the origin, then shifted.
pub(crate) fn moved(mut scenario: Scenario, angle: f64, shift: Vec2) -> Scenario {
    use reactsim::geometry::Polyline;
    let turn = |p: Vec2| {
        Vec2::new(p.x * angle.cos() - p.y * angle.sin(), p.x * angle.sin() + p.y * angle.cos()) + shift
    };
    let frames = scenario.start.history.iter_mut().chain(&mut scenario.log_future.tracks);
    for state in frames.flatten().flatten() {
        let (p, v) = (turn(state.position()), turn(Vec2::new(state.vx, state.vy)) - shift);
        (state.x, state.y, state.vx, state.vy) = (p.x, p.y, v.x, v.y);
        state.heading += angle;
    }
    let map = scenario.start.map.edit();
    for lane in &mut map.lanes {
        let points: Vec<Vec2> = lane.baseline.points().iter().copied().map(turn).collect();
        lane.baseline = Polyline::new(&points).unwrap();
    }
    map.road_edges.iter_mut().flat_map(|e| &mut e.points).for_each(|p| *p = turn(*p));
    map.road_lines.iter_mut().flat_map(|l| &mut l.points).for_each(|p| *p = turn(*p));
    map.speed_bumps.iter_mut().flat_map(|b| &mut b.outline).for_each(|p| *p = turn(*p));
    map.stop_lines.iter_mut().flat_map(|s| &mut s.ends).for_each(|p| *p = turn(*p));
    map.crosswalks.iter_mut().flat_map(|c| &mut c.outline).for_each(|p| *p = turn(*p));
    if let Some(area) = &mut map.drivable_area {
        for polygon in area {
            let rings = std::iter::once(&mut polygon.exterior).chain(&mut polygon.holes);
            rings.flatten().for_each(|p| *p = turn(*p));
        }
    }
    scenario.start.lights.iter_mut().for_each(|l| l.stop_point = turn(l.stop_point));
    scenario
}

/// Reverses the order of the agents behind the AV.
pub(crate) fn reverse_agents(scenario: &mut Scenario) {
    scenario.start.agents[1..].reverse();
    scenario.start.history[1..].reverse();
    scenario.log_future.tracks[1..].reverse();
}

#[test]
fn the_order_of_agents_does_not_matter() {
    let device = device();
    let policy = policy(&device);
    let mut scenario = scenarios(1).remove(0);
    let before = logits_of(&policy, &scenario, &tracks(&scenario), &device);
    // The AV stays in slot 0.
    let n = scenario.start.agents.len();
    reverse_agents(&mut scenario);
    let mut after = logits_of(&policy, &scenario, &tracks(&scenario), &device);
    after.iter_mut().filter(|l| l.slot > 0).for_each(|l| l.slot = n - l.slot);
    after.sort_by_key(|l| (l.frame, l.slot));
    let largest = largest_difference(&before, &after);
    assert!(largest < 1e-4, "{largest}");
}

#[test]
fn foreign_and_damaged_policies_are_refused() {
    let device = device();
    let task = NextToken::new(Recipe::default(), Kinematic::default().build().unwrap(), &device);
    let good = task.file(&task.init(7), &BTreeMap::new()).unwrap();
    let refusal = |bytes: &[u8]| Policy::read(bytes, &device).unwrap_err().to_string();
    check_cut(&good, refusal);
    for (from, to, part) in [
        ("\\\"kind\\\":\\\"reactive\\\"", "\\\"kind\\\":\\\"reactivf\\\"", "`reactivf`"),
        ("\\\"hidden\\\":64", "\\\"hidden\\\":32", "expected ["),
        ("\\\"heads\\\":4", "\\\"heads\\\":0", "heads = 0"),
    ] {
        let text = refusal(&replaced(&good, from, to));
        assert!(text.contains(part), "{part}: {text}");
    }
    let config = Config { past: 0, ..Config::default() };
    assert!(config.check().unwrap_err().to_string().contains("has past = "));
}

#[test]
fn samples_teach_the_nearest_token_and_only_where_there_is_one() {
    let device = device();
    let task = NextToken::new(Recipe::default(), Kinematic::default().build().unwrap(), &device);
    for scenario in scenarios(2) {
        let sample = task.prepare(&scenario, None).unwrap();
        let output = task.loss(&task.init(0), &[sample], None);
        let loss = f64::from(output.loss.into_scalar::<f32>()) / output.items;
        // The loss is about that of a uniform guess among a thousand tokens.
        assert!((5.0..9.0).contains(&loss), "{loss}");
    }
}
