//! Statistics of a set of deviations (ReactSim-Bench, section 3.2.4): categories, distances from the
//! logs, pressure on the agents, and the losses at each stage.

mod distribution;

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::{CandidateRecord, CurationProvenance, Funnel, Offsets, ScenarioRecord, store};
use reactsim_formats::FormatError;
use reactsim_scene::{Deviation, Difficulty};

pub use distribution::Distribution;

/// Statistics of a set.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Numbers of scenarios and candidates at each stage, steps 1 to 4.
    pub funnel: Funnel,
    /// Ids of the filters of step 3, in the order of evaluation.
    pub filters: Vec<String>,
    /// Whether the curation was interrupted.
    pub interrupted: bool,
    /// Number of records that could not be read.
    pub failures: usize,
    /// Number of scenarios with candidates.
    pub scenarios: usize,
    /// Number of scenarios with a candidate that survived step 3.
    pub with_survivor: usize,
    /// Number of scenarios with a chosen candidate: the set.
    pub chosen: usize,
    /// Numbers of chosen candidates with a manual decision, by decision.
    pub reviewed: BTreeMap<&'static str, usize>,
    /// Numbers of chosen candidates that a filter had rejected, by filter: picked by hand nonetheless.
    pub chosen_although_rejected: BTreeMap<String, usize>,
    /// Number of chosen candidates without a certificate that the agents can avoid them.
    pub chosen_without_certificate: usize,
    /// Statistics of all chosen candidates.
    pub overall: Part,
    /// Statistics of chosen candidates by category; contains every category.
    pub categories: BTreeMap<&'static str, Part>,
    /// Statistics of chosen candidates by difficulty; contains every difficulty. Candidates of
    /// unmeasured difficulty are in none.
    pub difficulties: BTreeMap<&'static str, Part>,
    /// Agreement between the intended and the determined category.
    pub agreement: Agreement,
    /// Statistics of the chosen candidates' certificates.
    pub certificates: Certificates,
}

/// Statistics of the chosen candidates of one category, of one difficulty, or of all.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Part {
    /// Number of candidates.
    pub count: usize,
    /// Share of the set.
    pub share: Option<f64>,
    /// Mean distance to the log, metres.
    pub ade: Distribution,
    /// Mean speed minus the log's, m/s.
    pub mean_speed_difference: Distribution,
    /// Endpoint offset from the log along the AV's heading at step 0, ahead positive, metres.
    pub endpoint_longitudinal: Distribution,
    /// Endpoint offset from the log to the left of that heading, metres.
    pub endpoint_lateral: Distribution,
    /// Events under log replay.
    pub pressure: Shares,
}

/// Shares of scenarios in which an event occurs at least once under log replay (`None` without
/// scenarios).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Shares {
    /// An agent hits the AV and is at fault.
    pub at_fault: Option<f64>,
    /// An agent overlaps the AV, whatever the fault.
    pub overlap: Option<f64>,
    /// An agent comes closer to the AV than 0.5 s.
    pub risky: Option<f64>,
}

/// Agreement between the intended category, where a source has one, and the determined category.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Agreement {
    /// All candidates.
    pub candidates: Confusion,
    /// The chosen candidates.
    pub chosen: Confusion,
}

/// Candidates by intent and category.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Confusion {
    /// Counts by intent, then by category.
    pub counts: BTreeMap<&'static str, BTreeMap<&'static str, u64>>,
    /// Share on the diagonal.
    pub share: Option<f64>,
}

impl Confusion {
    fn add(&mut self, one: &CandidateRecord) {
        if let Some(intent) = one.candidate.intent {
            let line = self.counts.entry(intent.name()).or_default();
            *line.entry(one.taxonomy.category.name()).or_default() += 1;
        }
    }

    fn finish(mut self) -> Self {
        let all: u64 = self.counts.values().flat_map(BTreeMap::values).sum();
        let same: u64 = self.counts.iter().filter_map(|(intent, line)| line.get(intent)).sum();
        self.share = (all > 0).then(|| same as f64 / all as f64);
        self
    }
}

/// Statistics of the certificates of chosen candidates.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Certificates {
    /// Number of chosen candidates with a certificate.
    pub certified: usize,
    /// Number of responses in them.
    pub responses: usize,
    /// Number of responses that shift sideways.
    pub nudged: usize,
    /// Hardest braking of each certificate, m/s².
    pub peak_deceleration: Distribution,
    /// Smallest peak deceleration with which all agents can avoid each candidate, m/s².
    pub required_deceleration: Distribution,
    /// Time to react to each candidate, s.
    pub time_to_react: Distribution,
}

impl Statistics {
    /// Computes the statistics of a file.
    ///
    /// # Errors
    /// [`FormatError`] when the file cannot be read or was not written by a curation.
    pub fn of_file(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        let records = store::read(path)?;
        let provenance = records.provenance().clone();
        let mut collector = Collector::default();
        for record in records {
            collector.add(&record?);
        }
        Ok(collector.finish(&provenance))
    }
}

/// Collects scenarios one by one, so that a file need not be in memory as a whole.
#[derive(Default)]
pub struct Collector {
    statistics: Statistics,
    chosen: Vec<ChosenCandidate>,
    peaks: Vec<f64>,
    required: Vec<f64>,
    times: Vec<f64>,
}

/// Data of a chosen candidate that the statistics need.
struct ChosenCandidate {
    category: Deviation,
    difficulty: Option<Difficulty>,
    offsets: Offsets,
    pressure: [bool; 3],
}

impl Collector {
    /// Adds a scenario of the file.
    pub fn add(&mut self, record: &ScenarioRecord) {
        let Self { statistics, .. } = self;
        statistics.scenarios += 1;
        statistics.with_survivor += usize::from(record.candidates.iter().any(|c| c.rejected_by.is_none()));
        for candidate in &record.candidates {
            statistics.agreement.candidates.add(candidate);
            for figure in &candidate.figures {
                if !statistics.filters.contains(&figure.filter) {
                    statistics.filters.push(figure.filter.clone());
                }
            }
        }
        let Some(chosen) = record.chosen() else { return };
        statistics.agreement.chosen.add(chosen);
        let CandidateRecord { taxonomy, offsets, pressure, review, certificate, .. } = chosen;
        self.chosen.push(ChosenCandidate {
            category: taxonomy.category,
            difficulty: chosen.difficulty(),
            offsets: *offsets,
            pressure: [pressure.at_fault > 0, pressure.overlaps > 0, pressure.risky > 0],
        });
        if let Some(review) = review {
            *statistics.reviewed.entry(review.decision.name()).or_default() += 1;
        }
        if let Some(filter) = &chosen.rejected_by {
            *statistics.chosen_although_rejected.entry(filter.clone()).or_default() += 1;
        }
        if let Some(certificate) = certificate {
            let certificates = &mut statistics.certificates;
            certificates.certified += 1;
            certificates.responses += certificate.responses.len();
            certificates.nudged += certificate.responses.iter().filter(|r| r.nudge != 0.0).count();
            self.peaks.push(certificate.peak_deceleration());
            self.required.extend(certificate.required_deceleration());
            self.times.extend(certificate.time_to_react());
        }
    }

    /// Computes the statistics of the scenarios added so far.
    pub fn finish(self, provenance: &CurationProvenance) -> Statistics {
        let part = |is_in: &dyn Fn(&ChosenCandidate) -> bool| {
            let members: Vec<&ChosenCandidate> = self.chosen.iter().filter(|k| is_in(k)).collect();
            Part::of(&members, self.chosen.len())
        };
        let of_category = |c: Deviation| (c.name(), part(&|k| k.category == c));
        let of_difficulty = |d: Difficulty| (d.name(), part(&|k| k.difficulty == Some(d)));
        let Statistics { agreement, certificates, .. } = self.statistics.clone();
        Statistics {
            funnel: provenance.funnel.clone(),
            interrupted: provenance.interrupted,
            failures: provenance.failures.len(),
            chosen: self.chosen.len(),
            chosen_without_certificate: self.chosen.len() - certificates.certified,
            overall: part(&|_| true),
            categories: Deviation::ALL.into_iter().map(of_category).collect(),
            difficulties: Difficulty::ALL.into_iter().map(of_difficulty).collect(),
            agreement: Agreement {
                candidates: agreement.candidates.finish(),
                chosen: agreement.chosen.finish(),
            },
            certificates: Certificates {
                peak_deceleration: Distribution::of(&self.peaks),
                required_deceleration: Distribution::of(&self.required),
                time_to_react: Distribution::of(&self.times),
                ..certificates
            },
            ..self.statistics
        }
    }
}

impl Part {
    fn of(members: &[&ChosenCandidate], set: usize) -> Self {
        let share = |n: usize, of: usize| (of > 0).then(|| n as f64 / of as f64);
        let pressed = |k: usize| share(members.iter().filter(|c| c.pressure[k]).count(), members.len());
        let spread = |of: fn(&Offsets) -> f64| {
            Distribution::of(&members.iter().map(|k| of(&k.offsets)).collect::<Vec<_>>())
        };
        Self {
            count: members.len(),
            share: share(members.len(), set),
            ade: spread(|o| o.ade),
            mean_speed_difference: spread(|o| o.mean_speed_difference),
            endpoint_longitudinal: spread(|o| o.endpoint_longitudinal),
            endpoint_lateral: spread(|o| o.endpoint_lateral),
            pressure: Shares { at_fault: pressed(0), overlap: pressed(1), risky: pressed(2) },
        }
    }
}
