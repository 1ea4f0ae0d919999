//! Hand-made records.

use reactsim::curation::{
    Candidate, CandidateRecord, Certificate, CurationProvenance, Decision, Figure, Funnel, InputFile,
    Offsets, Pressure, Response, ReviewMark, ScenarioRecord, Taxonomy,
};
use reactsim::geometry::Vec2;
use reactsim::scene::{AgentState, Deviation, Effort};

/// Returns 81 states on a line, with digits that a rounding would change.
pub(super) fn track(speed: f64) -> Vec<AgentState> {
    let state = |k: usize| {
        let x = speed * k as f64 / 30.0;
        AgentState { x, y: -0.0, heading: 1e-300, vx: if k == 3 { f64::NAN } else { speed / 3.0 }, vy: 0.1 }
    };
    (0..81).map(state).collect()
}

/// Returns a candidate; every third one is rejected.
pub(super) fn candidate(number: u32) -> CandidateRecord {
    let category = Deviation::ALL[number as usize % 3];
    let rejected = number % 3 == 2;
    let response = |agent: &str| Response {
        agent: agent.into(),
        leader: (agent == "c").then(|| "b".to_owned()),
        effort: Some(Effort { required_deceleration: 1.0 / 7.0, time_to_react: 0.9 }),
        reaction_step: 8,
        nudge: -0.25,
        peak_deceleration: 3.5,
        clearance: 1.0 / 3.0,
        track: track(2.0),
    };
    CandidateRecord {
        candidate: Candidate {
            source: "rules".into(),
            number,
            intent: number.is_multiple_of(2).then_some(Deviation::Lateral),
            maneuver: format!("stop: 3.1 m/s² after {number} s"),
            track: track(f64::from(number) + 0.1),
        },
        seed: u64::MAX,
        taxonomy: Taxonomy {
            category,
            heading_change: 0.1 + 0.2,
            other_branch: number == 2,
            lateral_offset: -0.0,
            longitudinal_offset: f64::MIN_POSITIVE,
            conflict_step: (number % 2 == 1).then_some(80),
        },
        figures: vec![
            Figure { filter: "ade".into(), value: Some(4.25), passed: Some(true) },
            Figure { filter: "pressure".into(), value: None, passed: rejected.then_some(false) },
            Figure { filter: "avoidable".into(), value: Some(0.0), passed: None },
        ],
        rejected_by: rejected.then(|| "pressure".into()),
        reason: if rejected { "nobody is pressed".into() } else { String::new() },
        score: if rejected { f64::NAN } else { f64::from(number) / 7.0 },
        chosen: number == 1,
        pressure: Pressure { at_fault: number % 2, overlaps: 1, risky: 2 },
        offsets: Offsets {
            endpoint_longitudinal: -12.5,
            endpoint_lateral: 0.75,
            ade: 4.25,
            mean_speed_difference: -1.5,
        },
        review: (number == 1).then(|| ReviewMark {
            reviewer: "ana".into(),
            at: "2026-01-01T12:00:00.123Z".into(),
            decision: Decision::Pick,
        }),
        certificate: match number % 3 {
            0 => None,
            1 => Some(Certificate { responses: vec![response("b"), response("c")] }),
            _ => Some(Certificate::default()),
        },
    }
}

/// Returns a scenario with this number of candidates.
pub(super) fn scenario(id: &str, candidates: u32) -> ScenarioRecord {
    ScenarioRecord {
        scenario_id: id.into(),
        scenario_digest: blake3::hash(id.as_bytes()).to_hex().to_string(),
        origin: Vec2::new(1234.5, -1.0 / 3.0),
        candidates: (0..candidates).map(candidate).collect(),
        scene: (id != "s1").then(|| format!("{{\"agents\": \"{id}\"}}")),
    }
}

pub(super) fn provenance() -> CurationProvenance {
    CurationProvenance {
        version: "0.1.0".into(),
        commit: "unknown".into(),
        settings: [("seed".to_owned(), "0".to_owned())].into(),
        inputs: vec![InputFile { name: "a.json".into(), digest: "00".into() }],
        funnel: Funnel { scenarios: 20, preselected: 19, candidates: 19 * 16, ..Funnel::default() },
        failures: vec!["a.json: record 3: is \"odd\" ü".into()],
        interrupted: false,
        applied: Vec::new(),
    }
}

pub(super) fn write(path: &std::path::Path, records: &[ScenarioRecord]) {
    let mut writer = reactsim::curation::store::Writer::create(path).unwrap();
    records.iter().for_each(|r| _ = writer.write(r).unwrap());
    writer.finish(&provenance()).unwrap();
}
