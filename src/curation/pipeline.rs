//! Steps 1 to 4 for one scenario.

use std::collections::BTreeMap;

use super::{
    Candidate, CandidateRecord, CandidateSource, Figure, NoProposal, Offsets, Pressure, Proposal,
    ScenarioRecord, Taxonomy,
};
use crate::rollout::{Purpose, Stream, stream};
use crate::scene::{AgentState, DT, Deviation, FUTURE, Scenario};

/// All sources of candidates.
pub const SOURCES: &[&dyn CandidateSource] = &[&Rules];

/// What decides a set of deviated AVs, besides scenarios and source.
#[derive(Clone, Debug, PartialEq)]
pub struct CurationSettings {
    /// Seed of all random streams.
    pub seed: u64,
    /// Candidates per scenario.
    pub candidates: u32,
    /// Whether the file holds what the review page draws.
    pub scenes: bool,
    /// Step 1.
    pub preselection: Preselection,
    /// Step 3.
    pub filters: FilterSettings,
}

impl Default for CurationSettings {
    fn default() -> Self {
        Self {
            seed: 0,
            candidates: 16,
            scenes: true,
            preselection: Preselection::default(),
            filters: FilterSettings::default(),
        }
    }
}

impl CurationSettings {
    /// All settings by name, as they stand in files.
    pub fn named(&self) -> BTreeMap<String, String> {
        [("seed", self.seed.to_string()), ("candidates", self.candidates.to_string())]
            .into_iter()
            .map(|(k, v)| (k.to_owned(), v))
            .collect()
    }
}

/// Step 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preselection {
    /// Vehicles.
    pub min_vehicles: u32,
    /// Metres.
    pub radius: f64,
    /// Seconds.
    pub max_ttc: f64,
}

impl Default for Preselection {
    fn default() -> Self {
        Self { min_vehicles: 3, radius: 40.0, max_ttc: 5.0 }
    }
}

/// Step 3.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterSettings {
    /// Metres.
    pub min_ade: f64,
    /// Metres.
    pub drivable_tolerance: f64,
    /// nuPlan's bounds.
    pub comfort: bool,
}

impl Default for FilterSettings {
    fn default() -> Self {
        Self { min_ade: 2.0, drivable_tolerance: 0.3, comfort: false }
    }
}

/// What became of a scenario.
#[derive(Clone, Debug, PartialEq)]
pub enum Curated {
    /// It fell in step 1.
    Dropped {
        /// At which rule.
        rule: String,
    },
    /// It has candidates; none is chosen yet.
    Kept(Box<ScenarioRecord>, BTreeMap<String, u64>),
}

struct Rules;

impl CandidateSource for Rules {
    fn id(&self) -> &'static str {
        "rules"
    }

    fn propose(&self, scenario: &Scenario, streams: &mut [Stream]) -> Vec<Result<Proposal, NoProposal>> {
        let now = scenario.start.now(0);
        let one = |n: usize| {
            if n % 5 == 4 {
                return Err(NoProposal("no lane to change to".into()));
            }
            let speed = now.speed() * (1.0 + n as f64 / 10.0);
            let state = |k: usize| AgentState { x: now.x + speed * DT * (k + 1) as f64, ..now };
            Ok(Proposal {
                intent: Some(Deviation::Longitudinal),
                maneuver: format!("faster {n}"),
                future: (0..FUTURE).map(state).collect(),
            })
        };
        (0..streams.len()).map(one).collect()
    }
}

/// Carries out the steps 1 to 3 for one scenario.
pub fn curate_scenario(
    scenario: &Scenario,
    source: &dyn CandidateSource,
    settings: &CurationSettings,
) -> Curated {
    if scenario.start.agents.len() <= settings.preselection.min_vehicles as usize {
        return Curated::Dropped { rule: "too few vehicles near the AV".into() };
    }
    let name = |number| stream(settings.seed, &scenario.id, number, Purpose::Candidate);
    let mut streams: Vec<Stream> = (0..settings.candidates).map(name).collect();
    let (mut candidates, mut unproposed) = (Vec::new(), BTreeMap::new());
    for (number, proposal) in (0_u32..).zip(source.propose(scenario, &mut streams)) {
        match proposal {
            Ok(proposal) => {
                let mut track = vec![scenario.start.now(0)];
                track.extend(proposal.future);
                candidates.push(CandidateRecord {
                    candidate: Candidate {
                        source: source.id().to_owned(),
                        number,
                        intent: proposal.intent,
                        maneuver: proposal.maneuver,
                        track,
                    },
                    seed: settings.seed,
                    taxonomy: Taxonomy {
                        category: Deviation::ALL[number as usize % 3],
                        heading_change: 0.0,
                        other_branch: false,
                        lateral_offset: 0.0,
                        longitudinal_offset: 0.0,
                        conflict_step: None,
                    },
                    pressure: Pressure::default(),
                    offsets: Offsets::default(),
                    figures: vec![Figure {
                        filter: "ade".into(),
                        value: Some(3.0),
                        passed: Some(number > 0),
                    }],
                    rejected_by: (number == 0).then(|| "ade".into()),
                    reason: String::new(),
                    score: if number == 0 { f64::NAN } else { 1.0 },
                    chosen: false,
                    review: None,
                    certificate: None,
                });
            }
            Err(reason) => *unproposed.entry(reason.0).or_default() += 1,
        }
    }
    let record = ScenarioRecord {
        scenario_id: scenario.id.clone(),
        scenario_digest: scenario.digest(),
        origin: scenario.origin,
        candidates,
        scene: None,
    };
    Curated::Kept(Box::new(record), unproposed)
}

/// Step 4.
#[derive(Default)]
pub struct Chooser {
    n: usize,
}

impl Chooser {
    /// Nothing chosen yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Marks one.
    pub fn choose(&mut self, record: &mut ScenarioRecord) {
        self.n += 1;
        let count = record.candidates.len();
        if count > 1 {
            record.candidates[1 + self.n % (count - 1)].chosen = true;
        }
    }
}
