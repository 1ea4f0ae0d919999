//! Statistics of sets with known values.

use std::sync::atomic::AtomicBool;

use reactsim::curation::driver::{Curation, CurationObserver, Input};
use reactsim::curation::stats::{Collector, Statistics};
use reactsim::curation::{
    CandidateSource, CurationProvenance, CurationSettings, FEW_VEHICLES, Funnel, InputFile, NO_APPROACH,
    NoProposal, Offsets, Preselection, Pressure, Proposal, ScenarioRecord, store,
};
use reactsim::formats::decoded;
use reactsim::report::curation_tables;
use reactsim::rollout::Stream;
use reactsim::scene::{Deviation, Scenario};

use super::hand::{provenance, scenario};
use super::road::on_road;
use crate::scenes::{car, later};

/// Returns a scenario with one chosen candidate of this category and ADE.
fn chosen(id: usize, category: Deviation, ade: f64) -> ScenarioRecord {
    let mut record = scenario(&format!("s{id}"), 3);
    let one = &mut record.candidates[1];
    one.taxonomy.category = category;
    one.candidate.intent = Some(Deviation::Lateral);
    one.pressure = Pressure { at_fault: u32::from(ade > 4.0), overlaps: u32::from(ade > 2.0), risky: 1 };
    one.offsets = Offsets {
        endpoint_longitudinal: -ade,
        endpoint_lateral: if ade > 4.0 { f64::NAN } else { 0.5 },
        ade,
        mean_speed_difference: -ade / 8.0,
    };
    record
}

fn known() -> Statistics {
    let mut collector = Collector::default();
    let lateral = Deviation::Lateral;
    for (i, (category, ade)) in
        [(lateral, 1.0), (lateral, 3.0), (Deviation::Longitudinal, 2.0), (lateral, 5.0), (lateral, 4.0)]
            .into_iter()
            .enumerate()
    {
        collector.add(&chosen(i, category, ade));
    }
    // Two scenarios without a choice, one of them without a survivor.
    let mut none = scenario("none", 3);
    none.candidates[1].chosen = false;
    collector.add(&none);
    none.candidates.drain(..2);
    collector.add(&none);
    let funnel = Funnel {
        scenarios: 9,
        preselection: [("too few vehicles".to_owned(), 2)].into(),
        preselected: 7,
        candidates: 19,
        unproposed: [("no lane to change to".to_owned(), 2)].into(),
        rejected: [("pressure".to_owned(), 7)].into(),
        survivors: 12,
        chosen: 5,
    };
    collector.finish(&CurationProvenance { funnel, ..provenance() })
}

#[test]
fn figures_are_those_of_a_calculation_by_hand() {
    let s = known();
    assert_eq!((s.scenarios, s.with_survivor, s.chosen, s.failures), (7, 6, 5, 1));
    let (all, lateral) = (&s.overall, &s.categories["lateral"]);
    let directional = &s.categories["directional"];
    assert_eq!((all.count, lateral.count, directional.count), (5, 4, 0));
    assert_eq!((all.share, lateral.share, directional.share), (Some(1.0), Some(0.8), Some(0.0)));
    assert_eq!((all.ade.mean, all.ade.median), (Some(3.0), Some(3.0)));
    assert_eq!((all.ade.lower_quartile, all.ade.upper_quartile), (Some(2.0), Some(4.0)));
    assert_eq!((lateral.ade.mean, lateral.ade.median), (Some(3.25), Some(3.5)));
    assert_eq!((directional.ade.n, directional.ade.mean), (0, None));
    assert_eq!(all.mean_speed_difference.mean, Some(-0.375));
    // Unknown values are left out, not zero.
    assert_eq!((all.endpoint_lateral.n, all.endpoint_lateral.mean), (4, Some(0.5)));
    assert_eq!(all.pressure.at_fault, Some(0.2));
    assert_eq!((all.pressure.overlap, all.pressure.risky), (Some(0.6), Some(1.0)));
    assert_eq!(directional.pressure.risky, None);
    assert_eq!(
        (s.agreement.chosen.share, s.agreement.chosen.counts["lateral"]["longitudinal"]),
        (Some(0.8), 1)
    );
    let certificates = &s.certificates;
    assert_eq!((certificates.certified, certificates.responses, certificates.nudged), (5, 10, 10));
    assert_eq!(certificates.peak_deceleration.mean, Some(3.5));
    assert_eq!(s.reviewed["pick"], 5);
    assert_eq!(s.filters, ["ade", "pressure", "avoidable"]);
}

#[test]
fn what_a_person_picked_against_the_filters_is_counted() {
    let mut collector = Collector::default();
    for (i, number) in [1, 2, 2, 3].into_iter().enumerate() {
        let mut record = scenario(&format!("s{i}"), 6);
        record.candidates.iter_mut().for_each(|c| c.chosen = c.candidate.number == number);
        collector.add(&record);
    }
    let s = collector.finish(&provenance());
    assert_eq!(s.chosen_although_rejected, [("pressure".to_owned(), 2)].into());
    // Candidate 3 has no certificate.
    assert_eq!((s.chosen, s.chosen_without_certificate), (4, 1));
    let mut text = Vec::new();
    curation_tables::write_statistics(&mut text, &s).unwrap();
    let text = String::from_utf8(text).unwrap();
    assert!(
        text.contains("\nChosen without a certificate: 1.\nChosen although rejected by pressure: 2.\n"),
        "{text}"
    );
}

#[test]
fn tables_are_for_people() {
    let mut text = Vec::new();
    curation_tables::write_statistics(&mut text, &known()).unwrap();
    insta::assert_snapshot!(String::from_utf8(text).unwrap());
}

#[test]
fn an_empty_set_has_figures_too() {
    let statistics = Collector::default().finish(&CurationProvenance::default());
    assert_eq!((statistics.chosen, statistics.overall.ade.mean), (0, None));
    let mut text = Vec::new();
    curation_tables::write_statistics(&mut text, &statistics).unwrap();
    assert!(String::from_utf8(text).unwrap().contains("| All          |      0 |         – |"));
}

/// Proposes nothing for every other scenario.
struct Shy;

impl CandidateSource for Shy {
    fn id(&self) -> &'static str {
        "shy"
    }

    fn propose(&self, scenario: &Scenario, streams: &mut [Stream]) -> Vec<Result<Proposal, NoProposal>> {
        let propose = |_: &mut Stream| {
            if scenario.id.ends_with(['1', '3', '5']) {
                return Err(NoProposal("shy".to_owned()));
            }
            let future = (1..=80).map(|k| later(&scenario.start.now(0), 0.1 * f64::from(k))).collect();
            Ok(Proposal { intent: None, maneuver: "goes on".to_owned(), future })
        };
        streams.iter_mut().map(propose).collect()
    }
}

pub(super) struct Quiet;

impl CurationObserver for Quiet {}

#[test]
fn what_is_counted_is_what_the_file_holds() {
    let made = |i: usize| {
        on_road(&format!("s{i}"), vec![car("av", 0.0, 0.0, 0.0, 10.0), car("ahead", 40.0, 0.0, 0.0, 6.0)])
    };
    let inputs = [Input {
        file: InputFile { name: "made".into(), digest: String::new() },
        open: Box::new(move |first| Ok(Box::new((first..6).map(move |i| Ok(decoded(made(i))))))),
    }];
    let preselection = Preselection { min_vehicles: 1, radius: 50.0, max_ttc: 100.0 };
    let settings = CurationSettings { candidates: 2, preselection, ..CurationSettings::default() };
    let curation = Curation { inputs: &inputs, source: &Shy, settings: &settings, jobs: 1 };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.parquet");
    let mut writer = store::Writer::create(&path).unwrap();
    let stop = AtomicBool::new(false);
    let run = curation.run(CurationProvenance::default(), &mut writer, &Quiet, &stop).unwrap();
    let (provenance, told) = (run.provenance, run.statistics);
    writer.finish(&provenance).unwrap();
    assert_eq!((provenance.funnel.preselected, told.scenarios), (6, 3), "{:?}", provenance.funnel);
    assert_eq!(provenance.funnel.unproposed["shy"], 6);
    assert_eq!(Statistics::of_file(&path).unwrap(), told);
}

#[test]
fn rules_of_the_preselection_stand_in_the_order_in_which_they_are_asked() {
    let preselection = [(NO_APPROACH.to_owned(), 251), (FEW_VEHICLES.to_owned(), 612)].into();
    let funnel = Funnel { scenarios: 2636, preselection, ..Funnel::default() };
    let statistics = Collector::default().finish(&CurationProvenance { funnel, ..provenance() });
    let mut text = Vec::new();
    curation_tables::write_overview(&mut text, &statistics).unwrap();
    let text = String::from_utf8(text).unwrap();
    let place = |rule: &str| text.find(rule).unwrap_or_else(|| panic!("{rule} is not in\n{text}"));
    assert!(place(FEW_VEHICLES) < place(NO_APPROACH), "{text}");
}
