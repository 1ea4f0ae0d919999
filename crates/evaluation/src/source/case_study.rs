//! Representative scenarios of the shipped benchmark, one for each kind of deviation.

/// A scenario of the shipped benchmark that is a clear example of one kind of deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CaseStudy {
    /// Name on the command line.
    pub name: &'static str,
    /// Id of the scenario.
    pub scenario: &'static str,
    /// Behaviour of the AV.
    pub summary: &'static str,
}

/// One case study per category of deviation, and one of merging.
pub const CASE_STUDIES: [CaseStudy; 4] = [
    CaseStudy {
        name: "hard-stop",
        scenario: "bench-2-000045",
        summary: "longitudinal: the AV brakes with 4.5 m/s² after 2.7 s, with a vehicle close behind",
    },
    CaseStudy {
        name: "cut-in",
        scenario: "bench-2-000092",
        summary: "lateral: the AV changes to the left lane 1.6 m ahead of a vehicle after 4.8 s",
    },
    CaseStudy {
        name: "turn-across",
        scenario: "bench-2-000012",
        summary: "directional: the AV turns left across oncoming lanes instead of going straight on, \
                  and stops there",
    },
    CaseStudy {
        name: "merge",
        scenario: "bench-2-000326",
        summary: "merging: the AV merges 16 m later than in its log, into the gap of another vehicle",
    },
];

impl CaseStudy {
    /// Returns the case study with this name.
    pub fn from_name(name: &str) -> Option<&'static Self> {
        CASE_STUDIES.iter().find(|c| c.name == name)
    }
}
