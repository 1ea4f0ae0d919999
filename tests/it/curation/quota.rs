//! Quotas: the candidates that a benchmark takes.

use reactsim::curation::{DIFFICULTIES, PROPORTIONS, Quota, ScenarioRecord, Strictness, in_proportion};
use reactsim::scene::{Deviation, Difficulty, Effort};

use super::hand;

/// Returns a scenario with one survivor of each of these categories and every difficulty.
fn record(categories: &[Deviation]) -> ScenarioRecord {
    let mut record = hand::scenario("a", 0);
    for (category, required) in categories.iter().flat_map(|c| [(c, 1.0), (c, 2.0), (c, 4.0)]) {
        let mut candidate = hand::candidate(1);
        candidate.chosen = false;
        candidate.taxonomy.category = *category;
        for response in candidate.certificate.iter_mut().flat_map(|c| &mut c.responses) {
            response.nudge = 0.0;
            response.effort = Some(Effort { required_deceleration: required, time_to_react: 3.0 });
        }
        record.candidates.push(candidate);
    }
    record
}

fn names(groups: &[&str]) -> Vec<String> {
    groups.iter().map(|g| (*g).to_owned()).collect()
}

#[test]
fn proportions_are_the_papers() {
    let of = |n| in_proportion(n, &PROPORTIONS).into_values().collect::<Vec<_>>();
    // Longitudinal, lateral, directional.
    assert_eq!(of(2636), [937, 900, 799]);
    assert_eq!(of(150), [53, 51, 46]);
    assert_eq!(of(1), [1, 0, 0]);
    for n in 0..500 {
        let parts = of(n);
        assert_eq!(parts.iter().sum::<u64>(), n);
        for (part, share) in parts.iter().zip([937.0, 900.0, 799.0]) {
            assert!((*part as f64 - n as f64 * share / 2636.0).abs() < 1.0, "{n}: {parts:?}");
        }
    }
}

#[test]
fn at_least_a_third_is_hard() {
    for n in 0..100 {
        let parts = in_proportion(n, &DIFFICULTIES);
        let [easy, medium, hard] = Difficulty::ALL.map(|d| parts[&d]);
        assert_eq!(easy + medium + hard, n);
        assert!(3 * hard >= n && hard >= medium && medium >= easy && hard - easy <= 1, "{n}: {parts:?}");
    }
}

#[test]
fn a_benchmark_is_filled_exactly() {
    let mut quota = Quota::new(30, &names(&["x", "y", "z"]));
    let (mut categories, mut difficulties, mut groups) = ([0; 3], [0; 3], [0; 3]);
    for i in 0..1000 {
        if quota.left() == 0 {
            break;
        }
        // Directional candidates are rare, and most scenarios offer the others.
        let mut record = record(if i % 4 == 0 { &Deviation::ALL[..] } else { &Deviation::ALL[..2] });
        let taken = quota.take(["x", "y", "z"][i % 3], &mut record);
        assert_eq!(taken, record.chosen().is_some());
        if let Some(chosen) = record.chosen() {
            categories[chosen.taxonomy.category as usize] += 1;
            difficulties[chosen.difficulty().unwrap() as usize] += 1;
            groups[i % 3] += 1;
        }
    }
    assert_eq!((quota.missing(), categories), (String::new(), [11, 10, 9]));
    assert_eq!(difficulties, [10, 10, 10]);
    assert!(groups.iter().all(|n| (1..=20).contains(n)), "{groups:?}");
    assert!(!quota.take("x", &mut record(&Deviation::ALL)), "it is full");
}

#[test]
fn no_group_takes_more_than_twice_its_share() {
    let mut quota = Quota::new(30, &names(&["x", "y", "z"]));
    let taken = (0..100).filter(|_| quota.take("x", &mut record(&Deviation::ALL))).count();
    assert_eq!((taken, quota.left(), quota.refuses("x"), quota.refuses("y")), (20, 10, true, false));
}

#[test]
fn places_are_kept_for_groups_that_are_not_there_yet() {
    let mut quota = Quota::new(4, &names(&["x", "y", "z"]));
    let offer = |quota: &mut Quota, group| quota.take(group, &mut record(&Deviation::ALL));
    assert!(offer(&mut quota, "x") && offer(&mut quota, "x"));
    assert!(!offer(&mut quota, "x"));
    assert!(quota.missing().ends_with("any of `y`, any of `z`"), "{}", quota.missing());
    assert!(offer(&mut quota, "z") && !offer(&mut quota, "z") && offer(&mut quota, "y"));
    assert_eq!((quota.left(), quota.missing()), (0, String::new()));
}

#[test]
fn candidates_without_certificate_or_difficulty_and_rejected_ones_are_not_taken() {
    let mut quota = Quota::new(3, &names(&["x"]));
    let mut weak = record(&[Deviation::Lateral, Deviation::Lateral]);
    for (i, candidate) in weak.candidates.iter_mut().enumerate() {
        match i % 3 {
            0 => candidate.certificate = None,
            1 => candidate.rejected_by = Some("offroad".into()),
            _ => candidate.certificate.iter_mut().for_each(|c| c.responses[0].effort = None),
        }
    }
    assert!(!quota.take("x", &mut weak));
    assert_eq!(quota.left(), 3);
}

#[test]
fn what_is_not_found_is_given_up_difficulty_first() {
    let mut quota = Quota::new(3, &names(&["x"]));
    // One place of each category and each difficulty: the second and the third are not offered.
    let mut only = record(&[Deviation::Lateral]);
    only.candidates.truncate(1);
    let taken = |quota: &mut Quota| quota.take("x", &mut only.clone());
    assert!(taken(&mut quota) && !taken(&mut quota));
    let mut same_difficulty = record(&[Deviation::Longitudinal]);
    same_difficulty.candidates.truncate(1);
    assert!(!quota.take("x", &mut same_difficulty.clone()));
    assert_eq!(quota.relax(), Some(Strictness::Category));
    assert!(!taken(&mut quota) && quota.take("x", &mut same_difficulty));
    assert_eq!(quota.relax(), Some(Strictness::Any));
    assert!(taken(&mut quota) && !taken(&mut quota));
    assert_eq!(quota.left(), 0);
}

#[test]
fn groups_that_are_not_found_are_given_up_last() {
    let mut quota = Quota::new(3, &names(&["x", "y"]));
    let any = || record(&[Deviation::Lateral, Deviation::Longitudinal, Deviation::Directional]);
    assert!(quota.take("x", &mut any()) && quota.take("x", &mut any()));
    // The last place is for the other group.
    assert!(quota.refuses("x") && !quota.refuses("y"));
    assert_eq!(quota.relax(), Some(Strictness::Category));
    assert_eq!(quota.relax(), Some(Strictness::Any));
    assert!(!quota.take("x", &mut any()));
    assert_eq!(quota.relax(), Some(Strictness::AnyGroup));
    assert!(quota.take("x", &mut any()));
    assert_eq!((quota.left(), quota.relax()), (0, None));
    // With fewer places than groups there is nothing to give up.
    let mut few = Quota::new(1, &names(&["x", "y"]));
    assert!(!few.refuses("x") && !few.refuses("y"));
    assert_eq!(
        [few.relax(), few.relax(), few.relax()],
        [Some(Strictness::Category), Some(Strictness::Any), None]
    );
}
