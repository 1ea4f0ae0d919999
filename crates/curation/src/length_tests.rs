//! Curation of scenarios of other lengths than the benchmark.

use reactsim_formats::deviations;
use reactsim_generation::{GenerationSettings, Generator};
use reactsim_scene::{Length, Scenario};

use crate::rules::Rules;
use crate::{
    AvoidanceSettings, CurationOutcome, CurationProvenance, CurationSettings, Preselection, ScenarioRecord,
    Unavoidable, certify, curate_scenario, store,
};

/// Generates some scenarios of a length.
fn scenarios(history: usize, future: usize) -> Vec<Scenario> {
    let length = Length { history, future };
    let generator = Generator::new(GenerationSettings { length, ..GenerationSettings::default() }).unwrap();
    (0..4).map(|number| generator.scenario(number).unwrap()).collect()
}

/// Curates a scenario with any vehicle near the AV.
fn curated(scenario: &Scenario) -> Option<ScenarioRecord> {
    let preselection = Preselection { min_vehicles: 1, max_ttc: 100.0, ..Preselection::default() };
    let settings = CurationSettings { preselection, ..CurationSettings::default() };
    match curate_scenario(scenario, &Rules, &settings) {
        CurationOutcome::Retained(record, _) => Some(*record),
        CurationOutcome::Rejected { .. } => None,
    }
}

#[test]
fn candidates_and_certificates_have_the_steps_of_the_scenario() {
    let (mut certified, mut late) = (0, 0);
    for (history, future) in [(2, 60), (11, 150), (21, 200)] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.parquet");
        let mut writer = store::Writer::create(&path).unwrap();
        let mut records = Vec::new();
        for scenario in scenarios(history, future) {
            let Some(mut record) = curated(&scenario) else { continue };
            assert!(!record.candidates.is_empty());
            for one in &record.candidates {
                assert_eq!(one.candidate.track.len(), future + 1);
                assert_eq!(one.candidate.track[0], scenario.start.now(0));
                for response in one.certificate.iter().flat_map(|c| &c.responses) {
                    assert_eq!(response.track.len(), future + 1);
                    assert!(response.reaction_step <= future);
                    certified += 1;
                }
                late += usize::from(one.taxonomy.conflict_step.is_some_and(|step| step > 80));
            }
            record.candidates[0].chosen = true;
            writer.write(&record).unwrap();
            records.push(record);
        }
        assert!(!records.is_empty());
        writer.finish(&CurationProvenance::default()).unwrap();
        let back: Vec<_> = store::read(&path).unwrap().map(Result::unwrap).collect();
        for (back, record) in back.iter().zip(&records) {
            assert_eq!(back.scenario_id, record.scenario_id);
            let tracks = |of: &ScenarioRecord| -> Vec<_> {
                of.candidates.iter().map(|one| (one.candidate.clone(), one.certificate.clone())).collect()
            };
            assert_eq!(tracks(back), tracks(record));
        }
        // Runs take the chosen ones, without the state at the current frame.
        let chosen = deviations::read(&path).unwrap();
        assert_eq!(chosen.len(), records.len());
        for record in &records {
            let found = &chosen[&record.scenario_id];
            assert_eq!((found.track.len(), found.now.is_some()), (future, true));
        }
    }
    assert!(certified > 0 && late > 0, "{certified} responses, {late} conflicts after 8 s");
}

#[test]
fn candidates_of_another_length_are_refused() {
    let scenario = scenarios(11, 60).remove(0);
    let track = vec![scenario.start.now(0); 81];
    let refused = certify(&scenario, &track, &AvoidanceSettings::default()).unwrap_err();
    assert_eq!(refused, Unavoidable::Malformed { found: 81, expected: 61 });
    assert!(crate::taxonomy_of(&scenario, &track[1..]).is_err());
}
