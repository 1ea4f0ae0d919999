//! Studies as JSON.

use std::collections::BTreeMap;
use std::io::{self, Write};

use reactsim_evaluation::{
    Comparison, Dependence, Estimate, LogErrors, Member, PairedDifference, PlannerPair, PlannerRanks,
    SimulatorSummary, StudyKind, StudyResults, realism::RealismSummary,
};
use serde::Serialize;

use super::{columns, difference, members};
use crate::{Column, TableStyle};

/// The numbers of a study's tables.
#[derive(Serialize)]
struct Numbers<'a> {
    study: StudyKind,
    members: Vec<MemberNumbers<'a>>,
    /// Realism metrics of the Sim Agents challenge, by simulator.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    realism: &'a [RealismSummary],
    /// Order of the planners under each simulator.
    #[serde(skip_serializing_if = "Option::is_none")]
    planners: Option<&'a PlannerRanks>,
    /// Every two planners, compared scenario by scenario.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    planner_pairs: Vec<PairNumbers<'a>>,
    /// Displacements from the log of each simulator.
    #[serde(skip_serializing_if = "Option::is_none")]
    errors: Option<&'a LogErrors>,
}

#[derive(Serialize)]
struct MemberNumbers<'a> {
    #[serde(flatten)]
    member: &'a Member,
    /// Number of scenarios with a result.
    scenarios: usize,
    /// Number of failures.
    failures: usize,
    simulators: Vec<SimulatorNumbers<'a>>,
}

#[derive(Serialize)]
struct SimulatorNumbers<'a> {
    id: &'a str,
    title: &'a str,
    oracle: bool,
    scenarios: usize,
    failed: usize,
    /// Estimates by metric.
    metrics: BTreeMap<&'static str, Estimate>,
    /// By metric: this simulator minus the unchanged one, with the p-value of the difference.
    #[serde(skip_serializing_if = "Option::is_none")]
    difference: Option<BTreeMap<&'static str, PairedEstimate>>,
}

/// The score of the second planner minus that of the first.
#[derive(Serialize)]
struct PairNumbers<'a> {
    planners: &'a [String; 2],
    /// By simulator, in the order of the ranks.
    differences: Vec<Option<PairedEstimate>>,
    /// The largest change of the difference between two simulators.
    dependence: Option<DependenceNumbers<'a>>,
}

/// The difference under the second simulator minus that under the first.
#[derive(Serialize)]
struct DependenceNumbers<'a> {
    simulators: &'a [String; 2],
    #[serde(flatten)]
    change: PairedEstimate,
}

impl<'a> PairNumbers<'a> {
    fn of(pair: &'a PlannerPair) -> Self {
        let estimate = |found: &PairedDifference| PairedEstimate { estimate: found.difference, p: found.p };
        let of_dependence = |found: &'a Dependence| DependenceNumbers {
            simulators: &found.simulators,
            change: PairedEstimate { estimate: found.change.difference, p: found.p },
        };
        Self {
            planners: &pair.planners,
            differences: pair.differences.iter().map(|found| found.as_ref().map(estimate)).collect(),
            dependence: pair.dependence.as_ref().map(of_dependence),
        }
    }
}

#[derive(Serialize)]
struct PairedEstimate {
    #[serde(flatten)]
    estimate: Estimate,
    p: f64,
}

/// Writes the numbers of the tables as JSON, by member and simulator.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_json(results: &StudyResults, style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    let kind = results.study.kind;
    let members = members(results).enumerate().map(|(i, (member, summary))| {
        let columns = columns(results, member, style);
        let simulators = summary.order().map(|(id, title, simulator)| {
            let found = difference(results, i, id).and_then(|d| d.comparison.as_ref());
            SimulatorNumbers {
                id,
                title,
                oracle: simulator.oracle,
                scenarios: simulator.scenarios,
                failed: simulator.failed,
                metrics: metrics(&columns, simulator),
                difference: found.map(|comparison| differences(&columns, comparison)),
            }
        });
        MemberNumbers {
            member,
            scenarios: summary.provenance.scenarios,
            failures: summary.provenance.failures.len(),
            simulators: simulators.collect(),
        }
    });
    let numbers = Numbers {
        study: kind,
        members: members.collect(),
        realism: &results.realism,
        planners: results.planners.as_ref(),
        planner_pairs: results.planner_pairs.iter().map(PairNumbers::of).collect(),
        errors: results.errors.as_ref(),
    };
    serde_json::to_writer_pretty(&mut *out, &numbers)?;
    out.write_all(b"\n")
}

fn metrics(columns: &[Column], simulator: &SimulatorSummary) -> BTreeMap<&'static str, Estimate> {
    columns.iter().filter_map(|c| Some((c.metric, *simulator.metrics.get(c.metric)?))).collect()
}

fn differences(columns: &[Column], comparison: &Comparison) -> BTreeMap<&'static str, PairedEstimate> {
    let paired = columns.iter().filter_map(|c| Some((c.metric, comparison.metrics.get(c.metric)?)));
    paired
        .map(|(metric, found)| (metric, PairedEstimate { estimate: found.difference, p: found.p }))
        .collect()
}
