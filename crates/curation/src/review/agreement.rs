//! Agreement of several reviewers.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use super::{Decisions, Opinions, ReviewLine};
use crate::Decision;
use crate::store::ScenarioEntry;

/// Agreement of the reviewers of a file about the scenarios that at least two of them decided. Flags are no
/// decisions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Number of reviewers.
    pub reviewers: usize,
    /// Number of scenarios with at least two decisions.
    pub scenarios: usize,
    /// Share of the pairs of decisions about one scenario that are equal: the same decision about the same
    /// candidate. Mean over scenarios, 0 to 1.
    pub same: f64,
    /// Share of the pairs that both pick or both reject, whatever the candidate. Mean over scenarios, 0 to 1.
    pub same_decision: f64,
    /// Fleiss' kappa of picking and rejecting: 0 for agreement by chance, 1 for perfect agreement; `None` if
    /// all decisions are alike.
    ///
    /// Source: Fleiss, "Measuring nominal scale agreement among many raters", Psychological Bulletin 76,
    /// 1971; for different numbers of decisions per scenario, with the mean over scenarios.
    pub kappa: Option<f64>,
}

impl Agreement {
    /// Compares the decisions about the scenarios of a store, as they are now. `None` if none has two
    /// decisions.
    pub fn about(entries: &[ScenarioEntry], decisions: &Decisions) -> Option<Self> {
        Self::of(
            entries.iter().filter_map(|e| Some((decisions.get(&e.scenario_id)?, e.scenario_digest.as_str()))),
        )
    }

    /// Compares the decisions about scenarios, each with its digest. `None` if no scenario has two decisions.
    fn of<'a>(opinions: impl IntoIterator<Item = (&'a Opinions, &'a str)>) -> Option<Self> {
        let (mut reviewers, mut shares) = (BTreeSet::new(), BTreeMap::<Decision, f64>::new());
        let (mut scenarios, mut same, mut same_decision) = (0, 0.0, 0.0);
        for (opinions, digest) in opinions {
            let lines: Vec<&ReviewLine> = opinions.decided(digest).collect();
            if lines.len() < 2 {
                continue;
            }
            scenarios += 1;
            same += share_of_pairs(&lines, |line| (line.decision, line.candidate));
            same_decision += share_of_pairs(&lines, |line| line.decision);
            for line in &lines {
                reviewers.insert(line.reviewer.as_str());
                *shares.entry(line.decision).or_default() += 1.0 / lines.len() as f64;
            }
        }
        if scenarios == 0 {
            return None;
        }
        let n = scenarios as f64;
        let by_chance: f64 = shares.values().map(|share| (share / n) * (share / n)).sum();
        let kappa = (shares.len() > 1).then(|| (same_decision / n - by_chance) / (1.0 - by_chance));
        let (same, same_decision) = (same / n, same_decision / n);
        Some(Self { reviewers: reviewers.len(), scenarios, same, same_decision, kappa })
    }
}

/// Returns the share of all pairs of lines that are equal in a property.
fn share_of_pairs<K: PartialEq>(lines: &[&ReviewLine], property: impl Fn(&ReviewLine) -> K) -> f64 {
    let pairs = lines.iter().enumerate().flat_map(|(i, a)| lines[..i].iter().map(move |b| (a, b)));
    let equal = pairs.filter(|(a, b)| property(a) == property(b)).count();
    equal as f64 / (lines.len() * (lines.len() - 1) / 2) as f64
}

impl fmt::Display for Agreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reviewers, scenarios, same, same_decision, kappa } = self;
        let plural = if *scenarios == 1 { "" } else { "s" };
        write!(
            f,
            "{reviewers} reviewers, {scenarios} scenario{plural} decided by several: {:.1} % of their decisions \
             are equal, {:.1} % both pick or both reject",
            100.0 * same,
            100.0 * same_decision
        )?;
        kappa.map_or(Ok(()), |kappa| write!(f, " (kappa {kappa:.2})"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opinions(decisions: &[(&str, Decision, Option<u32>)]) -> Opinions {
        let line = |&(reviewer, decision, candidate): &(&str, Decision, Option<u32>)| {
            let line = ReviewLine {
                scenario_id: "a".into(),
                scenario_digest: "d".into(),
                candidate,
                candidate_digest: None,
                decision,
                reviewer: reviewer.into(),
                at: "2026-01-01T00:00:00Z".into(),
                note: None,
                undo: false,
            };
            (reviewer.to_owned(), line)
        };
        Opinions(decisions.iter().map(line).collect())
    }

    fn agreement(scenarios: &[Opinions]) -> Option<Agreement> {
        Agreement::of(scenarios.iter().map(|opinions| (opinions, "d")))
    }

    #[test]
    fn kappa_is_that_of_two_raters_by_hand() {
        let (yes, no) = (Decision::Pick, Decision::Reject);
        let both = |a, b| opinions(&[("anna", a, None), ("ben", b, None)]);
        // Of ten scenarios six picked by both, two rejected by both, two in dispute.
        let mut all = vec![both(yes, yes); 6];
        all.extend([both(no, no), both(no, no), both(yes, no), both(no, yes)]);
        let found = agreement(&all).unwrap();
        assert_eq!((found.reviewers, found.scenarios, found.same), (2, 10, 0.8));
        // Shares of all decisions: 0.7 and 0.3; by chance 0.58.
        assert!((found.kappa.unwrap() - (0.8 - 0.58) / (1.0 - 0.58)).abs() < 1e-12);
        let text = found.to_string();
        assert!(text.starts_with("2 reviewers, 10 scenarios decided by several: 80.0 % "), "{text}");
    }

    #[test]
    fn another_candidate_is_not_equal_but_picked_as_well() {
        let all = [opinions(&[
            ("anna", Decision::Pick, Some(1)),
            ("ben", Decision::Pick, Some(2)),
            ("cleo", Decision::Pick, Some(1)),
        ])];
        let found = agreement(&all).unwrap();
        assert_eq!((found.same, found.same_decision, found.kappa), (1.0 / 3.0, 1.0, None));
    }

    #[test]
    fn single_decisions_and_flags_say_nothing() {
        let alone = opinions(&[("anna", Decision::Pick, None), ("ben", Decision::Flag, None)]);
        assert_eq!(agreement(&[alone, Opinions::default()]), None);
    }
}
