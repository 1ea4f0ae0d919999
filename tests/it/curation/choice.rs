//! The automatic choice: survivors only, categories in balance, not always the same maneuver.

use reactsim::curation::{Chooser, ScenarioRecord};
use reactsim::scene::{Deviation, Effort};

use super::hand;

/// Returns a scenario whose candidates survive, with these categories, maneuvers and scores.
fn scenario(candidates: &[(Deviation, &str, f64)]) -> ScenarioRecord {
    let mut record = hand::scenario("s", candidates.len() as u32);
    for (candidate, &(category, maneuver, score)) in record.candidates.iter_mut().zip(candidates) {
        candidate.taxonomy.category = category;
        candidate.candidate.maneuver = maneuver.to_owned();
        candidate.score = score;
        (candidate.rejected_by, candidate.chosen, candidate.certificate) = (None, false, None);
    }
    record
}

fn chosen(chooser: &mut Chooser, mut record: ScenarioRecord) -> Option<u32> {
    record.candidates.iter_mut().for_each(|c| c.chosen = false);
    chooser.choose(&mut record);
    assert!(record.candidates.iter().filter(|c| c.chosen).count() <= 1);
    record.chosen().map(|c| c.candidate.number)
}

const LONG: Deviation = Deviation::Longitudinal;

#[test]
fn the_best_survivor_is_chosen_and_nobody_else() {
    let mut record = scenario(&[(LONG, "stop 1", 1.0), (LONG, "stop 2", 3.0), (LONG, "stop 3", 2.0)]);
    assert_eq!(chosen(&mut Chooser::default(), record.clone()), Some(1));
    record.candidates[1].rejected_by = Some("pressure".into());
    assert_eq!(chosen(&mut Chooser::default(), record.clone()), Some(2));
    record.candidates.iter_mut().for_each(|c| c.rejected_by = Some("pressure".into()));
    assert_eq!(chosen(&mut Chooser::default(), record), None);
}

#[test]
fn the_category_that_lacks_most_goes_before_a_better_score() {
    let mut chooser = Chooser::default();
    let both = || scenario(&[(LONG, "stop", 4.0), (Deviation::Directional, "turn left", 3.0)]);
    let sequence: Vec<_> = (0..6).map(|_| chosen(&mut chooser, both()).unwrap()).collect();
    assert_eq!(sequence, [0, 1, 0, 1, 0, 1]);
}

#[test]
fn the_same_maneuver_wears_off() {
    let mut chooser = Chooser::default();
    let both = || scenario(&[(LONG, "stop: 3.1 m/s²", 4.0), (LONG, "creep: 1.2 m/s", 2.5)]);
    let sequence: Vec<_> = (0..8).map(|_| chosen(&mut chooser, both()).unwrap()).collect();
    // In the long run the shares differ by as much as compensates for the scores: (4 - 2.5) / 4.
    assert_eq!(sequence, [0, 1, 0, 0, 1, 0, 0, 1]);
}

/// Gives a survivor this difficulty and mean-speed difference (m/s).
fn graded(record: &mut ScenarioRecord, i: usize, required: f64, speed: f64) {
    let candidate = &mut record.candidates[i];
    candidate.offsets.mean_speed_difference = speed;
    candidate.certificate = hand::candidate(1).certificate;
    for response in candidate.certificate.iter_mut().flat_map(|c| &mut c.responses) {
        response.nudge = 0.0;
        response.effort = Some(Effort { required_deceleration: required, time_to_react: 3.0 });
    }
}

#[test]
fn difficulties_take_turns() {
    let mut chooser = Chooser::default();
    let all = || {
        let mut record = scenario(&[(LONG, "a", 4.0), (LONG, "b", 3.0), (LONG, "c", 2.0)]);
        (0..3).for_each(|i| graded(&mut record, i, [1.0, 2.0, 4.0][i], -1.0));
        record
    };
    let sequence: Vec<_> = (0..6).map(|_| chosen(&mut chooser, all()).unwrap()).collect();
    assert_eq!(sequence, [0, 1, 2, 0, 1, 2]);
}

#[test]
fn avs_faster_than_their_log_are_wanted_as_much_as_slower_ones() {
    let mut chooser = Chooser::default();
    let both = || {
        let mut record = scenario(&[(LONG, "stop", 4.0), (LONG, "faster", 2.0)]);
        graded(&mut record, 0, 1.0, -3.0);
        graded(&mut record, 1, 1.0, 3.0);
        record
    };
    let faster = (0..20).filter(|_| chosen(&mut chooser, both()) == Some(1)).count();
    assert!((9..=10).contains(&faster), "{faster}");
}
