//! Visibility: later events do not change earlier motion.

use rayon::prelude::*;
use reactsim::models::Baseline;
use reactsim::rollout::{Controller, Settings};
use reactsim::scene::{
    AgentState, CURRENT, FUTURE, Frame, HISTORY, LightState, Scenario, StopKind, StopLineParts,
};

use super::{INTERVALS, every_baseline, scenarios, settings};
use crate::scenes::{self, bits, bystander, car, coasting, light, real, roll, scene, straight};
use crate::small_scenarios;

/// Returns the AV of `base` up to step `t`; then it stands still, turned aside.
fn halting(base: &[AgentState], now: AgentState, t: usize) -> Vec<AgentState> {
    let last = if t == 0 { now } else { base[t - 1] };
    let halted = AgentState { heading: last.heading + 0.4, vx: 0.0, vy: 0.0, ..last };
    base[..t].iter().copied().chain(std::iter::repeat_n(halted, FUTURE - t)).collect()
}

/// Returns the frames of the world agents up to a step.
fn agents_until(tracks: &[Vec<Frame>], step: usize) -> Vec<Vec<Option<[u64; 5]>>> {
    bits(&tracks[1..]).into_iter().map(|t| t[..=CURRENT + step].to_vec()).collect()
}

#[test]
fn nothing_depends_on_what_the_av_does_later() {
    let all = scenarios(2);
    let baselines: Vec<_> = every_baseline().collect();
    let reactions: usize = baselines
        .par_iter()
        .map(|(model, controller)| {
            // Networks are slow: one scene is enough for them.
            let scenes = if model.needs_weights { 1 } else { all.len() };
            all.iter()
                .enumerate()
                .take(scenes)
                .map(|(n, s)| reactions_to_a_halt(model, controller, n, s))
                .sum::<usize>()
        })
        .sum();
    assert!(reactions > 20, "hardly anything reacted at all ({reactions}): the test would show nothing");
}

/// Checks that agents do not differ before they can see the AV differ, and counts how often they do
/// afterwards.
fn reactions_to_a_halt(model: &Baseline, controller: &Controller, n: usize, scenario: &Scenario) -> usize {
    let (now, base) = (scenario.start.now(0), coasting(scenario));
    let mut reactions = 0;
    for (replan, lookahead) in INTERVALS.into_iter().flat_map(|r| [(r, true), (r, false)]) {
        let settings = settings(replan, lookahead);
        let straight = roll(scenario, base.clone(), controller, &settings);
        for t in [[0, 6, 35], [1, 20, 79], [4, 5, 50]][n % 3] {
            let other = roll(scenario, halting(&base, now, t), controller, &settings);
            // Agents at t + 1 may see the AV at t + 1, or with lookahead 0 up to t only.
            let same = if lookahead { t } else { t + 1 };
            let (a, b) = (agents_until(&straight.tracks, same), agents_until(&other.tracks, same));
            assert!(
                a == b,
                "{}: {}: the AV after step {t} changes agents up to step {same} (replan {replan})",
                model.id,
                scenario.id
            );
            let (a, b) = (agents_until(&straight.tracks, FUTURE), agents_until(&other.tracks, FUTURE));
            reactions += usize::from(a != b);
        }
    }
    reactions
}

#[test]
fn the_lookahead_is_one_step_and_no_more() {
    // A simulator that reacts to the AV: with lookahead its first step may differ, without it must not.
    let scenario =
        scene("near", vec![car("av", 14.0, 0.0, 0.0, 10.0), car("a", 0.0, 0.0, 0.0, 10.0)], straight());
    let base = coasting(&scenario);
    let (_, controller) = every_baseline().find(|m| m.0.id == "idm").unwrap();
    let first = |av: &[AgentState], lookahead: bool| {
        let rollout = roll(&scenario, av.to_vec(), &controller, &settings(1, lookahead));
        bits(&rollout.tracks[1..])[0][HISTORY]
    };
    let other = halting(&base, scenario.start.now(0), 0);
    assert_ne!(first(&base, true), first(&other, true));
    assert_eq!(first(&base, false), first(&other, false));
}

/// Rewrites a future in one of several ways.
fn rewrite(tracks: &mut [Vec<Frame>], how: usize) {
    for track in tracks {
        match how {
            0 => track.fill(None),
            1 => track.iter_mut().flatten().for_each(|s| {
                (s.x, s.y, s.heading) = (s.x + 3.0, s.y - 2.0, s.heading + 1.0);
            }),
            _ => track.reverse(),
        }
    }
}

#[test]
fn fair_simulators_do_not_see_the_log() {
    let assembled = |how: Option<usize>| {
        (0..2).map(move |i| {
            let mut parts = small_scenarios::parts(i, true);
            if let Some(how) = how {
                for agent in &mut parts.agents {
                    let mut future = [agent.track.split_off(HISTORY)];
                    rewrite(&mut future, how);
                    agent.track.append(&mut future[0]);
                }
            }
            Scenario::assemble(parts).unwrap()
        })
    };
    let read = || scenes::mini().into_iter().chain(real(2));
    let before: Vec<Scenario> = assembled(None).chain(read()).collect();
    let settings = Settings::default();
    let rolled = |scenarios: &[Scenario], controller: &Controller| -> Vec<_> {
        // The AV drives in the same way, whatever the log.
        let all = before.iter().zip(scenarios);
        all.map(|(a, b)| bits(&roll(b, coasting(a), controller, &settings).tracks)).collect()
    };
    let baselines: Vec<_> = every_baseline().collect();
    let expected: Vec<_> = baselines.iter().map(|(_, controller)| rolled(&before, controller)).collect();
    for how in 0..3 {
        let mut after: Vec<Scenario> = assembled(Some(how)).collect();
        let mut loaded: Vec<Scenario> = read().collect();
        for scenario in &mut loaded {
            rewrite(&mut scenario.log_future.tracks, how);
            for unselected in &mut scenario.unselected {
                unselected.track.truncate(HISTORY);
                unselected.track.resize(HISTORY + FUTURE, None);
            }
        }
        after.append(&mut loaded);
        for ((model, controller), expected) in baselines.iter().zip(&expected) {
            for ((a, b), scenario) in expected.iter().zip(rolled(&after, controller)).zip(&before) {
                let id = &scenario.id;
                assert_eq!(
                    *a == b,
                    !model.oracle,
                    "{}: {id}: the log's future was rewritten ({how})",
                    model.id
                );
            }
        }
    }
}

#[test]
fn nothing_depends_on_what_lights_show_later() {
    let at_the_line = |green_from: usize| {
        let mut map = straight();
        let at = reactsim::geometry::Vec2::new(40.0, 0.0);
        map.stop_lines.push(StopLineParts { kind: StopKind::Light, lane: "main".into(), at });
        let mut parts = scenes::parts("light", vec![bystander(), car("a", 0.0, 0.0, 0.0, 10.0)], map);
        let shows = move |f| if f < green_from { LightState::Stop } else { LightState::Go };
        parts.lights.push(light("main", (40.0, 0.0), shows));
        Scenario::assemble(parts).unwrap()
    };
    for (model, controller) in every_baseline() {
        for t in [0, 5, 13, 30] {
            for replan in INTERVALS {
                let settings = settings(replan, true);
                let [a, b] = [200, CURRENT + t + 1]
                    .map(at_the_line)
                    .map(|s| roll(&s, coasting(&s), &controller, &settings).tracks);
                // A light that is seen at step t + 1 affects only later states.
                assert!(agents_until(&a, t + 1) == agents_until(&b, t + 1), "{}: light after {t}", model.id);
            }
        }
    }
}
