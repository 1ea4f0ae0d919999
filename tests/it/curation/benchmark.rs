//! The recipe of a benchmark, with scenarios that are the hand-made ones under other names.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use reactsim::curation::benchmark::{BenchmarkError, Entry, Recipe};
use reactsim::curation::driver::CurationObserver;
use reactsim::curation::{CurationProvenance, CurationSettings, Preselection, SOURCES, in_proportion, store};
use reactsim::formats::{self, FormatError, native};
use reactsim::generation::GenerationError;
use reactsim::scene::{Deviation, Scenario};

struct Silent;

impl CurationObserver for Silent {}

/// Scenes that leave the AV a choice of directions.
const SCENES: [&str; 3] = ["crossing", "left-turn-across", "cut-in"];

fn groups() -> Vec<String> {
    SCENES.iter().map(|s| format!("generated/{s}")).collect()
}

/// The scenario of a number: the scenes in turn. Every seventh can not be made.
fn scenario(number: u64) -> Result<Scenario, GenerationError> {
    let id = format!("bench-0-{number:06}");
    if number % 7 == 6 {
        return Err(GenerationError::Fruitless { id, attempts: 40 });
    }
    let scene = SCENES[(number % 3) as usize];
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenarios/mini/{scene}.json"));
    let mut scenario = formats::open(&path).unwrap().next().unwrap().unwrap();
    (scenario.id, scenario.source) = (id, format!("generated/{scene}"));
    scenario.deviation = None;
    Ok(scenario)
}

fn settings() -> CurationSettings {
    let preselection = Preselection { min_vehicles: 1, max_ttc: 8.0, ..Preselection::default() };
    CurationSettings { scenes: false, preselection, ..CurationSettings::default() }
}

fn make(
    wanted: u64,
    groups: &[String],
    jobs: usize,
    stop_after: usize,
) -> (Vec<Entry>, Result<CurationProvenance, BenchmarkError>) {
    let settings = settings();
    let recipe = Recipe { wanted, groups, source: SOURCES[0], settings: &settings, jobs };
    let (mut entries, stop) = (Vec::new(), AtomicBool::new(false));
    let take = |entry| {
        entries.push(entry);
        stop.store(entries.len() >= stop_after, Ordering::Relaxed);
        Ok::<_, FormatError>(())
    };
    let done = recipe.run(scenario, CurationProvenance::default(), take, &Silent, &stop);
    (entries, done)
}

#[test]
fn it_holds_what_it_must_whatever_the_threads() {
    let (entries, provenance) = make(20, &groups(), 1, usize::MAX);
    let provenance = provenance.unwrap();
    for (category, wanted) in in_proportion(20) {
        let of = |e: &&Entry| e.scenario.deviation.as_ref().unwrap().category == Some(category);
        assert_eq!(entries.iter().filter(of).count() as u64, wanted, "{}", category.name());
    }
    for group in groups() {
        let n = entries.iter().filter(|e| e.scenario.source == group).count();
        assert!((1..=14).contains(&n), "{group}: {n}");
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
fn what_can_not_be_filled_is_named() {
    let groups = [groups(), vec!["generated/absent".to_owned()]].concat();
    let (entries, error) = make(4, &groups, 2, usize::MAX);
    let error = error.unwrap_err().to_string();
    assert!(entries.len() <= 3 && error.contains("any of `generated/absent`"), "{error}");
    assert!(error.contains(&format!("{} of 4 scenarios were found among ", entries.len())), "{error}");
    assert!(error.contains(Deviation::ALL[0].name()) || entries.len() == 3, "{error}");
    let error = make(3, &groups, 2, usize::MAX).1.unwrap_err().to_string();
    assert!(error.starts_with("3 scenarios can not hold all of 4 map types"), "{error}");
}

#[test]
fn stopped_it_has_what_comes_first() {
    let (whole, _) = make(8, &groups(), 2, usize::MAX);
    let (some, provenance) = make(8, &groups(), 2, 3);
    assert!(provenance.unwrap().interrupted);
    assert!((3..8).contains(&some.len()), "{}", some.len());
    assert!(some.iter().zip(&whole).all(|(a, b)| a.record == b.record));
}
