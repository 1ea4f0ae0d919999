//! The recipe of a benchmark, on synthetic roads.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::atomic::{AtomicBool, Ordering};

use reactsim::curation::benchmark::{ANY_GROUP, BenchmarkError, Entry, MISSING, Recipe};
use reactsim::curation::{CurationProvenance, CurationSettings, PROPORTIONS, SOURCES, in_proportion, store};
use reactsim::formats::{self, FormatError, native};
use reactsim::generation::GenerationError;
use reactsim::geometry::{Polygon, Vec2};
use reactsim::scene::{CURRENT, MapParts, Scenario};

use crate::scenes::{arc, car, join, lane, line, scene};

fn groups() -> Vec<String> {
    ["fork", "road"].map(|g| format!("generated/{g}")).to_vec()
}

/// Returns the scenario of a number: a road with traffic in both directions, every other time with a branch
/// to the left. Every seventh scenario cannot be made.
fn scenario(number: u64) -> Result<Scenario, GenerationError> {
    let id = format!("bench-0-{number:06}");
    if number % 7 == 6 {
        return Err(GenerationError(format!("{id}: no driver can be the AV")));
    }
    let mut lanes = vec![
        lane("right", line((-150.0, 0.0), (300.0, 0.0)), Some(13.4)),
        lane("left", line((-150.0, 3.5), (30.0, 3.5)), Some(13.4)),
        lane("on", line((30.0, 3.5), (300.0, 3.5)), Some(13.4)),
        lane("oncoming", line((300.0, 7.0), (-150.0, 7.0)), Some(13.4)),
    ];
    join(&mut lanes, "left", "on");
    if number.is_multiple_of(2) {
        lanes.push(lane("turn", arc((30.0, 3.5), 0.0, 12.0, FRAC_PI_2), Some(8.0)));
        lanes.push(lane("north", line((42.0, 15.5), (42.0, 150.0)), Some(13.4)));
        join(&mut lanes, "left", "turn");
        join(&mut lanes, "turn", "north");
    }
    let ring = [(-200.0, -60.0), (400.0, -60.0), (400.0, 160.0), (-200.0, 160.0)];
    let exterior = ring.iter().map(|&(x, y)| Vec2::new(x, y)).collect();
    let map = MapParts {
        lanes,
        drivable_area: Some(vec![Polygon { exterior, holes: Vec::new() }]),
        ..MapParts::default()
    };
    let some = (number % 5) as f64;
    // Slow at first, and gone when the AV gets there.
    let mut ahead = car("ahead", 24.0, 3.5, 0.0, 3.0);
    for (frame, state) in ahead.track.iter_mut().enumerate().skip(CURRENT) {
        let t = (frame - CURRENT) as f64 * 0.1;
        let speeding = t.min(3.0);
        let x = 24.0 + 3.0 * speeding + speeding * speeding + 9.0 * (t - speeding);
        *state = Some(crate::scenes::state(x, 3.5, 0.0, 3.0 + 2.0 * speeding));
    }
    let agents = vec![
        car("av", 0.0, 3.5, 0.0, 8.0),
        car("behind", -14.0 - some, 3.5, 0.0, 8.0),
        car("beside", -9.0 - some, 0.0, 0.0, 8.5),
        car("oncoming", 70.0 + 2.0 * some, 7.0, PI, 8.0),
        car("later", 96.0 + some, 7.0, PI, 8.0),
        ahead,
    ];
    let mut scenario = scene(&id, agents, map);
    scenario.source = groups()[(number % 2) as usize].clone();
    Ok(scenario)
}

type Made = (Vec<Entry>, Result<CurationProvenance, BenchmarkError>);

fn make(wanted: u64, groups: &[String], jobs: usize, stop_after: usize) -> Made {
    make_of(scenario, (wanted, groups), (100, jobs), stop_after)
}

fn make_of(
    scenario: impl Fn(u64) -> Result<Scenario, GenerationError> + Sync,
    (wanted, groups): (u64, &[String]),
    (patience, jobs): (u64, usize),
    stop_after: usize,
) -> Made {
    let settings = CurationSettings { scenes: false, ..CurationSettings::default() };
    let recipe = Recipe { wanted, groups, source: SOURCES[0], settings: &settings, patience, jobs };
    let (mut entries, stop) = (Vec::new(), AtomicBool::new(false));
    let take = |entry| {
        entries.push(entry);
        stop.store(entries.len() >= stop_after, Ordering::Relaxed);
        Ok::<_, FormatError>(())
    };
    let tried = (0, std::iter::empty());
    let done = recipe.run(tried, scenario, CurationProvenance::default(), take, &(), &stop);
    (entries, done)
}

#[test]
fn it_holds_what_it_must_whatever_the_threads() {
    let (entries, provenance) = make(20, &groups(), 1, usize::MAX);
    let provenance = provenance.unwrap();
    for (category, wanted) in in_proportion(20, &PROPORTIONS) {
        let of = |e: &&Entry| e.scenario.deviation.as_ref().unwrap().category == Some(category);
        assert_eq!(entries.iter().filter(of).count() as u64, wanted, "{}", category.name());
    }
    for group in groups() {
        let n = entries.iter().filter(|e| e.scenario.source == group).count();
        assert!((1..=20).contains(&n), "{group}: {n}");
    }
    assert!(entries.windows(2).all(|w| w[0].scenario.id < w[1].scenario.id));
    for Entry { scenario, record } in &entries {
        let deviation = scenario.deviation.as_ref().unwrap();
        let [chosen] = record.candidates.as_slice() else { panic!("one candidate") };
        assert!(chosen.chosen && chosen.rejected_by.is_none() && chosen.certificate.is_some());
        assert_eq!(deviation.category, Some(chosen.taxonomy.category));
        assert_eq!(deviation.track, chosen.candidate.track[1..]);
        assert_eq!((&record.scenario_id, &record.scenario_digest), (&scenario.id, &scenario.digest()));
    }
    assert_eq!(provenance.funnel.chosen, 20);
    assert!(!provenance.failures.is_empty() && provenance.failures[0].contains("bench-0-000006"));
    let (again, other) = make(20, &groups(), 5, usize::MAX);
    assert_eq!(other.unwrap(), provenance);
    let records = |entries: Vec<Entry>| entries.into_iter().map(|e| e.record).collect::<Vec<_>>();
    assert_eq!(records(again), records(entries));
}

#[test]
fn its_files_are_read_back() {
    let home = tempfile::tempdir().unwrap();
    let (file, beside) = (home.path().join("bench.parquet"), home.path().join("bench.deviations.parquet"));
    let (entries, provenance) = make(6, &groups(), 2, usize::MAX);
    let (mut scenarios, mut deviations) =
        (native::Writer::create(&file).unwrap(), store::Writer::create(&beside).unwrap());
    for entry in &entries {
        scenarios.write(&entry.scenario).unwrap();
        assert!(deviations.write(&entry.record).unwrap());
    }
    scenarios.finish().unwrap();
    deviations.finish(&provenance.unwrap()).unwrap();
    let tracks = formats::deviations::read(&beside).unwrap();
    assert_eq!(tracks.len(), 6);
    for (scenario, entry) in formats::open(&file).unwrap().zip(&entries) {
        let scenario = scenario.unwrap();
        assert_eq!(scenario.digest(), entry.scenario.digest());
        let track = &tracks[&scenario.id];
        assert_eq!(track.scenario_digest.as_deref(), Some(scenario.digest().as_str()));
        assert_eq!(track.track_in(scenario.origin), scenario.deviation.unwrap().track);
    }
}

#[test]
fn quotas_that_cannot_be_filled_are_relaxed_whatever_the_threads() {
    let groups = [groups(), vec!["generated/absent".to_owned()]].concat();
    let made = |jobs| {
        let (entries, provenance) = make(4, &groups, jobs, usize::MAX);
        (entries.into_iter().map(|e| e.record).collect::<Vec<_>>(), provenance.unwrap())
    };
    let (records, provenance) = made(1);
    assert_eq!((records.len(), provenance.settings[ANY_GROUP].as_str()), (4, "1"));
    assert_eq!(made(4), (records, provenance));
}

#[test]
fn fewer_scenarios_than_groups_are_of_some_groups() {
    let groups = [groups(), vec!["generated/absent".to_owned()]].concat();
    let (entries, provenance) = make(2, &groups, 2, usize::MAX);
    assert_eq!(entries.len(), 2);
    assert!(!provenance.unwrap().settings.contains_key(ANY_GROUP));
}

#[test]
fn a_benchmark_ends_with_what_can_be_had() {
    let none = |number: u64| Err(GenerationError(format!("{number}: no driver can be the AV")));
    let (taken, error) = make_of(none, (4, &groups()), (30, 2), usize::MAX);
    assert!(taken.is_empty());
    assert!(error.unwrap_err().to_string().starts_with("no suitable scenario was found among "));
    // Roads without branches: half of the places are reserved for the other group, until any group is
    // accepted.
    let roads = |number: u64| scenario(2 * number + 1);
    let (taken, provenance) = make_of(roads, (4, &groups()), (30, 2), usize::MAX);
    let settings = provenance.unwrap().settings;
    assert!(!taken.is_empty(), "{settings:?}");
    assert_eq!(settings.contains_key(MISSING), taken.len() < 4, "{settings:?}");
}

#[test]
fn stopped_it_has_what_comes_first() {
    let (whole, _) = make(20, &groups(), 2, usize::MAX);
    let (some, provenance) = make(20, &groups(), 1, 3);
    assert!(provenance.unwrap().interrupted);
    assert!((3..20).contains(&some.len()), "{}", some.len());
    assert!(some.iter().zip(&whole).all(|(a, b)| a.record == b.record));
}
