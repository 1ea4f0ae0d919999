//! Shares of rollouts are differences of scores, to the last bit.

use reactsim_scene::{FUTURE, HISTORY, wosac::ScenarioRollouts};

use super::super::{Config, Feature, RolloutShare, Scorer};
use super::fixture;

/// Returns the shares of the rollouts by scoring the others of each, by configuration and rollout.
fn brute_force(scorer: &Scorer, rollouts: &ScenarioRollouts) -> Vec<Vec<RolloutShare>> {
    let all = scorer.score(rollouts, &Config::ALL).unwrap();
    let mut shares = vec![Vec::new(); Config::ALL.len()];
    for rollout in 0..rollouts.joint_scenes.len() {
        let mut others = rollouts.clone();
        others.joint_scenes.remove(rollout);
        let others = scorer.score(&others, &Config::ALL).unwrap();
        for (shares, (all, others)) in shares.iter_mut().zip(all.iter().zip(&others)) {
            let likelihood = |feature| Some(all.likelihood(feature)? - others.likelihood(feature)?);
            shares.push(RolloutShare {
                metametric: all.metametric - others.metametric,
                likelihoods: Feature::ALL.map(likelihood),
            });
        }
    }
    shares
}

#[test]
fn shares_are_those_of_brute_force_in_every_configuration() {
    let mut differs = [false; Feature::COUNT];
    for (seed, objects, count, center) in
        [(1, 12, 5, [0.0, 0.0]), (2, 7, 2, [-3000.0, 7000.0]), (3, 24, 8, [40_000.0, -33_000.0])]
    {
        let (mut log, rollouts) = fixture::scenario(seed, objects, count, center);
        // Frames of an evaluated vehicle that no feature of the log is judged at.
        log.tracks[0].valid[HISTORY + 20..HISTORY + 40].fill(false);
        log.tracks_to_predict.push(2);
        let scorer = Scorer::new(&log).unwrap();
        let found = scorer.score_with_shares(&rollouts, &Config::ALL).unwrap();
        let (metrics, shares): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        assert_eq!(metrics, scorer.score(&rollouts, &Config::ALL).unwrap());
        assert_eq!(shares, brute_force(&scorer, &rollouts), "{seed}");
        for share in shares.iter().flatten() {
            for feature in Feature::ALL {
                differs[feature as usize] |= share.likelihoods[feature as usize].is_some_and(|s| s != 0.0);
            }
        }
        let last = Config::ALL.len() - 1;
        assert_eq!(Config::ALL[last].id, "2024_challenge_code");
        let lights = Feature::TrafficLightViolation as usize;
        assert!(shares[last].iter().all(|share| share.likelihoods[lights].is_none()));
    }
    assert_eq!(differs, [true; Feature::COUNT]);
}

#[test]
fn a_rollout_unlike_the_log_has_a_negative_share() {
    let (log, mut rollouts) = fixture::scenario(5, 6, 4, [0.0, 0.0]);
    fixture::follow_log(&log, &mut rollouts);
    for (trajectory, track) in rollouts.joint_scenes[2].trajectories.iter_mut().zip(&log.tracks) {
        trajectory.y = (0..FUTURE).map(|k| track.y[HISTORY] + 4.0 * k as f32).collect();
    }
    let scored = Scorer::new(&log).unwrap().score_with_shares(&rollouts, &[Config::CHALLENGE_2025]).unwrap();
    let [(_, shares)] = scored.as_slice() else { panic!("one configuration") };
    for (r, share) in shares.iter().enumerate() {
        assert_eq!(share.metametric < 0.0, r == 2, "{shares:?}");
        let speed = share.likelihoods[Feature::LinearSpeed as usize].unwrap();
        assert_eq!(speed < 0.0, r == 2, "{shares:?}");
    }
}

#[test]
fn a_single_rollout_has_no_share() {
    let (log, rollouts) = fixture::scenario(6, 5, 1, [0.0, 0.0]);
    let scorer = Scorer::new(&log).unwrap();
    let scored = scorer.score_with_shares(&rollouts, &Config::ALL).unwrap();
    let metrics = scorer.score(&rollouts, &Config::ALL).unwrap();
    let expected: Vec<_> = metrics.into_iter().map(|metrics| (metrics, Vec::new())).collect();
    assert_eq!(scored, expected);
}

#[test]
fn objects_divide_the_share_of_their_rollout() {
    let config = Config::CHALLENGE_2025;
    for (seed, objects) in [(7, 1), (8, 6)] {
        let (mut log, rollouts) = fixture::scenario(seed, objects, 8, [0.0, 0.0]);
        if objects == 1 {
            log.tracks_to_predict.clear();
        }
        let scorer = Scorer::new(&log).unwrap();
        let (metrics, shares) = scorer.score_with_object_shares(&rollouts, &config).unwrap();
        let whole = scorer.score_with_shares(&rollouts, &[config]).unwrap().remove(0);
        assert_eq!(metrics, whole.0);
        assert_eq!(shares.len(), 8);
        for (parts, whole) in shares.iter().zip(&whole.1) {
            assert_eq!(parts.len(), scorer.evaluated().len());
            if let [alone] = parts[..] {
                assert!((alone.metametric - whole.metametric).abs() < 1e-12);
            }
            for feature in Feature::ALL {
                // Likelihoods are products over objects: so are the factors by which those without a rollout
                // differ.
                let all = metrics.likelihood(feature).unwrap();
                let factor =
                    |share: &RolloutShare| (all - share.likelihoods[feature as usize].unwrap()) / all;
                let product: f64 = parts.iter().map(factor).product();
                assert!((product / factor(whole) - 1.0).abs() < 1e-9, "{feature:?}");
            }
        }
    }
    let (log, rollouts) = fixture::scenario(9, 3, 1, [0.0, 0.0]);
    let scored = Scorer::new(&log).unwrap().score_with_object_shares(&rollouts, &config).unwrap();
    assert!(scored.1.is_empty(), "there is no score without rollouts");
}
