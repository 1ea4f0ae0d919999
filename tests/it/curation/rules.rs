//! Properties of every candidate by rules, on hand-made scenes, shipped scenarios and real logs.

use reactsim::curation::{
    CandidateSource, CurationOutcome, CurationSettings, Rules, SOURCES, curate_scenario,
};
use reactsim::dynamics::{MAX_ACCELERATION, MAX_CURVATURE};
use reactsim::geometry::wrap;
use reactsim::rollout::{Purpose, Stream, stream};
use reactsim::scene::{AgentState, CURRENT, DT, Deviation, FUTURE, MapParts, Scenario};

use super::road::on_road;
use crate::scenes::{car, mini, real, scene};

fn streams(scenario: &Scenario, seed: u64) -> Vec<Stream> {
    (0..16).map(|n| stream(seed, &scenario.id, n, Purpose::Candidate)).collect()
}

/// Largest jerk, m/s³, and largest change of the acceleration from the log's to the first step's, m/s².
const JERK: f64 = 25.0;
const JUMP: f64 = 2.5;

/// Checks sections 7 and 8 of the metrics, and that the AV neither jumps nor trembles.
#[track_caller]
pub(super) fn drivable(scenario: &Scenario, maneuver: &str, future: &[AgentState]) {
    assert_eq!(future.len(), FUTURE);
    let mut before = scenario.start.now(0);
    let (mut v0, mut a0) = (before.speed(), None::<f64>);
    let known = scenario.start.history[0].iter().all(Option::is_some);
    for (k, state) in future.iter().enumerate() {
        let about = || format!("{} `{maneuver}` at step {}", scenario.id, k + 1);
        let v1 = (state.position() - before.position()).norm() / DT;
        let a = (v1 - v0) / DT;
        assert!(a.abs() <= MAX_ACCELERATION + 1e-9, "{}: {a} m/s2", about());
        if v0 >= 0.6 && v1 >= 0.6 {
            let bend = wrap(state.heading - before.heading) / (v0 * DT + 0.5 * a * DT * DT);
            assert!(bend.abs() <= MAX_CURVATURE + 1e-9, "{}: {bend} 1/m", about());
        }
        if let Some(a0) = a0 {
            let jerk = (a - a0) / DT;
            assert!(jerk.abs() <= JERK, "{}: {jerk} m/s3", about());
        } else if known {
            // Acceleration in the log until now.
            let earlier = scenario.logged_velocity(0, CURRENT - 5).unwrap().norm();
            let jump = a - ((v0 - earlier) / 0.5).clamp(-4.0, 4.0);
            assert!(jump.abs() <= JUMP, "{}: {jump} m/s2 at once", about());
        }
        if v1 == 0.0 {
            assert_eq!((state.heading, state.vx, state.vy), (before.heading, 0.0, 0.0), "{}", about());
        } else {
            assert!(v1 > 1e-3, "{}: {v1} m/s is a tremble", about());
        }
        assert!((state.vx - (state.x - before.x) / DT).abs() < 1e-9, "{}", about());
        (before, v0, a0) = (*state, v1, Some(a));
    }
}

fn all_drivable(scenario: &Scenario) -> usize {
    let proposals = Rules.propose(scenario, &mut streams(scenario, 0));
    assert_eq!(proposals.len(), 16);
    let made = proposals.iter().flatten();
    made.inspect(|p| drivable(scenario, &p.maneuver, &p.future)).count()
}

#[test]
fn candidates_are_drivable() {
    let mut made = 0;
    for scenario in mini().iter().chain(&real(12)) {
        made += all_drivable(scenario);
    }
    assert!(made >= 6 * 10, "only {made}");
}

#[test]
fn the_same_streams_give_the_same_and_others_do_not() {
    let scenario = on_road("seeds", vec![car("av", 0.0, 0.0, 0.0, 10.0), car("b", -20.0, 0.0, 0.0, 10.0)]);
    let propose = |seed| Rules.propose(&scenario, &mut streams(&scenario, seed));
    assert_eq!(propose(0), propose(0));
    assert_ne!(propose(0), propose(1));
    // A stream's proposal does not depend on the other streams.
    let alone = Rules.propose(&scenario, &mut streams(&scenario, 0)[..1]);
    assert_eq!(alone[0], propose(0)[0]);
}

#[test]
fn a_parked_av_stands_exactly_still_or_sets_off() {
    let scenario = on_road("parked", vec![car("av", 0.0, 0.0, 0.0, 0.0), car("b", -30.0, 0.0, 0.0, 8.0)]);
    let now = scenario.start.now(0);
    let mut moved = 0;
    for proposal in Rules.propose(&scenario, &mut streams(&scenario, 0)).into_iter().flatten() {
        drivable(&scenario, &proposal.maneuver, &proposal.future);
        let stands = proposal.future.iter().take_while(|s| s.speed() == 0.0);
        assert!(stands.into_iter().all(|s| (s.x, s.y, s.heading) == (now.x, now.y, now.heading)));
        moved += usize::from(proposal.future[FUTURE - 1].x > 1.0);
        let pulls_out = ["pull out", "squeeze past"].iter().any(|what| proposal.maneuver.starts_with(what));
        assert_eq!(proposal.intent == Some(Deviation::Lateral), pulls_out, "{}", proposal.maneuver);
    }
    assert!(moved > 0);
}

#[test]
fn a_logged_change_of_lanes_is_merged_sooner_and_later() {
    // The log changes to the left lane between x = 30 and 60.
    let mut av = car("av", 0.0, 0.0, 0.0, 10.0);
    for state in av.track.iter_mut().flatten() {
        let u = ((state.x - 30.0) / 30.0).clamp(0.0, 1.0);
        state.y = 3.5 * u * u * (3.0 - 2.0 * u);
        let slope = 3.5 * 6.0 * u * (1.0 - u) / 30.0;
        (state.heading, state.vy) = (slope.atan(), state.vx * slope);
    }
    // There are no other agents, so that every draw is as good as any other, and the first is proposed.
    let scenario = on_road("merging", vec![av]);
    let mut offsets = std::collections::BTreeMap::new();
    for seed in 0..30 {
        for proposal in Rules.propose(&scenario, &mut streams(&scenario, seed)).into_iter().flatten() {
            if proposal.maneuver.starts_with("merge") {
                let middle = proposal.future.iter().find(|s| s.x >= 45.0).map(|s| s.y);
                let word = proposal.maneuver.rsplit(' ').next().unwrap().to_owned();
                offsets.entry(word).or_insert_with(Vec::new).extend(middle);
            }
        }
    }
    assert!(offsets["earlier"].iter().all(|&y| y > 1.75), "{offsets:?}");
    assert!(offsets["later"].iter().all(|&y| y < 1.75), "{offsets:?}");
}

#[test]
fn no_two_candidates_are_the_same() {
    // An AV that has to wait at a red light leaves little to vary.
    for scenario in mini().iter().chain(&real(6)) {
        let CurationOutcome::Retained(record, unproposed) =
            curate_scenario(scenario, SOURCES[0], &CurationSettings::default())
        else {
            continue;
        };
        let tracks: Vec<_> = record.candidates.iter().map(|c| &c.candidate.track).collect();
        for (i, a) in tracks.iter().enumerate() {
            for b in &tracks[..i] {
                let apart = a.iter().zip(b.iter()).map(|(a, b)| (a.position() - b.position()).norm());
                assert!(apart.fold(0.0, f64::max) > 0.2, "{}", scenario.id);
            }
        }
        let missing: u64 = unproposed.values().sum();
        assert_eq!(record.candidates.len() as u64 + missing, 16);
    }
}

#[test]
fn odd_scenes_are_no_trouble() {
    let around = || vec![car("av", 0.0, 0.0, 0.3, 9.0), car("b", -15.0, -4.0, 0.3, 9.0)];
    // No map at all; an AV off its lane, across the road; no other agents.
    let bare = scene("bare", around(), MapParts::default());
    let across = on_road("across", vec![car("av", 0.0, 60.0, 2.0, 9.0), car("b", -15.0, 60.0, 2.0, 9.0)]);
    let lonely = on_road("lonely", vec![car("av", 0.0, 0.0, 0.0, 9.0)]);
    let backwards =
        on_road("backwards", vec![car("av", 0.0, 0.0, 0.0, -3.0), car("b", -15.0, 0.0, 0.0, 0.0)]);
    for scenario in [bare, across, lonely, backwards] {
        all_drivable(&scenario);
        let loose = CurationSettings {
            preselection: reactsim::curation::Preselection { min_vehicles: 0, ..Default::default() },
            ..CurationSettings::default()
        };
        for settings in [CurationSettings::default(), loose] {
            if let CurationOutcome::Retained(record, _) = curate_scenario(&scenario, SOURCES[0], &settings) {
                assert!(record.candidates.iter().all(|c| c.rejected_by.is_none() || !c.reason.is_empty()));
            }
        }
    }
}

#[test]
fn an_av_that_vanishes_falls_in_step_one() {
    let mut agents = vec![car("av", 0.0, 0.0, 0.0, 9.0)];
    agents.extend((0..4).map(|i| car(&format!("c{i}"), -12.0 - 10.0 * f64::from(i), 0.0, 0.0, 12.0)));
    agents[0].track[60] = None;
    let scenario = on_road("vanishing", agents);
    let curated = curate_scenario(&scenario, SOURCES[0], &CurationSettings::default());
    assert_eq!(curated, CurationOutcome::Rejected { rule: reactsim::curation::AV_ABSENT.to_owned() });
}

#[test]
fn step_one_counts_vehicles_and_approaches() {
    let with = |others: &[(f64, f64, f64)]| {
        let mut agents = vec![car("av", 0.0, 0.0, 0.0, 10.0)];
        for (i, &(x, y, speed)) in others.iter().enumerate() {
            agents.push(car(&format!("c{i}"), x, y, 0.0, speed));
        }
        on_road("step one", agents)
    };
    let failed_rule = |s: &Scenario| CurationSettings::default().preselection.failed_rule(s);
    let two = with(&[(-20.0, 0.0, 15.0), (20.0, 3.5, 10.0)]);
    assert_eq!(failed_rule(&two), Some(reactsim::curation::FEW_VEHICLES));
    let calm = with(&[(-20.0, 0.0, 10.0), (20.0, 3.5, 10.0), (30.0, 0.0, 10.0)]);
    assert_eq!(failed_rule(&calm), Some(reactsim::curation::NO_APPROACH));
    let close = with(&[(-30.0, 0.0, 13.0), (20.0, 3.5, 10.0), (30.0, 0.0, 10.0)]);
    assert_eq!(failed_rule(&close), None);
}

/// Checks the purpose of the set: every chosen candidate puts an agent under pressure, obeys the limits and
/// has a certificate.
#[test]
fn what_is_chosen_on_real_logs_holds_what_it_promises() {
    let scenarios = real(12);
    if scenarios.is_empty() {
        return;
    }
    let mut chooser = reactsim::curation::Chooser::default();
    let mut chosen = 0;
    for scenario in &scenarios {
        let CurationOutcome::Retained(mut record, _) =
            curate_scenario(scenario, SOURCES[0], &CurationSettings::default())
        else {
            continue;
        };
        chooser.choose(&mut record);
        assert!(record.candidates.iter().filter(|c| c.chosen).count() <= 1);
        let Some(best) = record.chosen() else {
            assert!(record.candidates.iter().all(|c| c.rejected_by.is_some()));
            continue;
        };
        chosen += 1;
        assert!(best.pressure.risky > 0 && best.offsets.ade >= 2.0 && best.certificate.is_some());
        assert!(best.figures.iter().all(|f| f.passed == Some(true)));
        drivable(scenario, &best.candidate.maneuver, best.candidate.future());
        let now = scenario.start.now(0);
        assert_eq!(best.candidate.track[0], now);
    }
    assert!(chosen > 0);
}
