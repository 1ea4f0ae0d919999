//! The order of planners under each simulator, as rows of texts.

use reactsim_evaluation::{Estimate, PlannerPair, PlannerRanks, StudyResults};

use crate::comparison::{p_text, signed};
use crate::table::Column;

/// A table of texts.
pub(super) struct TextTable {
    pub(super) title: &'static str,
    /// Number of columns of texts, which come first; the others are numbers.
    pub(super) texts: usize,
    pub(super) head: Vec<String>,
    pub(super) rows: Vec<Vec<String>>,
}

/// Returns the tables of ranks, agreement and reasons of a study of planners.
pub(super) fn rank_tables(results: &StudyResults) -> Vec<TextTable> {
    let Some(found) = &results.planners else { return Vec::new() };
    let title = |id: &str| title(results, id);
    let texts = |first: &str, rest: &[String]| -> Vec<String> {
        std::iter::once(first.to_owned()).chain(rest.iter().cloned()).collect()
    };
    let ranks = found.simulators.iter().map(|simulator| {
        let ranks: Vec<String> = simulator.ranks.iter().map(f64::to_string).collect();
        texts(&title(&simulator.id), &ranks)
    });
    let agreement = found.agreement.iter().map(|pair| {
        let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |v| format!("{v:.2}"));
        let interval = match (pair.low, pair.high) {
            (Some(low), Some(high)) => format!("{low:.2} to {high:.2}"),
            _ => "–".to_owned(),
        };
        vec![title(&pair.first), title(&pair.second), number(pair.tau), interval]
    });
    let count = |count: Option<usize>| count.map_or_else(|| "–".to_owned(), |n| n.to_string());
    let reasons = found.simulators.iter().map(|simulator| {
        let counts = [simulator.at_fault.to_string(), count(simulator.ignored), count(simulator.frozen)];
        texts(&title(&simulator.id), &counts)
    });
    let reason_head = ["Method", "At fault", "Agents ignored the AV", "None, as agents were frozen"];
    vec![
        TextTable {
            title: "Rank of the planners by their score, 1 is best",
            texts: 1,
            head: texts("Method", &found.planners),
            rows: ranks.collect(),
        },
        TextTable {
            title: "Kendall's tau of the order of planners between two simulators",
            texts: 2,
            head: ["Method", "Method", "Tau", "95 % interval"].map(str::to_owned).to_vec(),
            rows: agreement.collect(),
        },
        TextTable {
            title: "Collisions that the AV causes, over all planners but the log, and what traffic has to do with them",
            texts: 1,
            head: reason_head.map(str::to_owned).to_vec(),
            rows: reasons.collect(),
        },
    ]
}

/// Returns the table of every two planners: a row per traffic model, and one for how much the difference
/// depends on it. `None` with one planner, and in other studies.
pub(super) fn pair_table(results: &StudyResults) -> Option<TextTable> {
    let found = results.planners.as_ref()?;
    let column = Column::of(&found.score)?;
    let head = ["Planners", "Traffic", "Difference", "p"].map(str::to_owned).to_vec();
    let rows = results.planner_pairs.iter().flat_map(|pair| pair_rows(results, found, pair, &column));
    let rows: Vec<_> = rows.collect();
    let title = "Paired difference of the score between two planners, by traffic model";
    (!rows.is_empty()).then_some(TextTable { title, texts: 2, head, rows })
}

fn pair_rows(
    results: &StudyResults,
    found: &PlannerRanks,
    pair: &PlannerPair,
    column: &Column,
) -> Vec<Vec<String>> {
    let [first, second] = &pair.planners;
    let row = |traffic: String, numbers: Option<(&Estimate, f64)>| {
        let number = |value: f64| signed(column, value);
        let text = numbers.and_then(|(estimate, _)| {
            let mean = number(estimate.mean?);
            Some(match estimate.low.zip(estimate.high) {
                Some((low, high)) => format!("{mean} [{}, {}]", number(low), number(high)),
                None => mean,
            })
        });
        let p = numbers.map(|(_, p)| p_text(p));
        let dash = || "–".to_owned();
        vec![format!("{second} minus {first}"), traffic, text.unwrap_or_else(dash), p.unwrap_or_else(dash)]
    };
    let of_simulators = found.simulators.iter().zip(&pair.differences);
    let mut rows: Vec<Vec<String>> = of_simulators
        .map(|(simulator, of)| {
            row(title(results, &simulator.id), of.as_ref().map(|found| (&found.difference, found.p)))
        })
        .collect();
    rows.extend(pair.dependence.as_ref().map(|found| {
        let [s, t] = &found.simulators;
        let change = format!("change, {} to {}", title(results, s), title(results, t));
        row(change, Some((&found.change.difference, found.p)))
    }));
    rows
}

/// Returns the title of a simulator.
pub(super) fn title(results: &StudyResults, id: &str) -> String {
    let mut order = results.summaries.iter().flat_map(|summary| summary.order());
    order.find(|(other, ..)| *other == id).map_or_else(|| id.to_owned(), |(_, title, _)| title.to_owned())
}

/// What the table of every two planners shows.
pub(super) const PAIRS: &str = "Differences are paired, scenario by scenario, with 95 % bootstrap intervals; p by a \
    permutation test of the signs. The change is the largest between two traffic models, its p-value times the number of \
    their pairs.";

/// Returns the sentences below the tables.
pub(super) fn notes(found: &PlannerRanks) -> Vec<String> {
    let mut notes = vec![format!(
        "Ranks and tau are of `{}` on the {} scenarios that have it for every planner and simulator.",
        found.score, found.scenarios
    )];
    if found.planners.len() > 1 {
        notes.push(PAIRS.to_owned());
    }
    if let Some(change) = &found.change {
        let [p, q] = &change.planners;
        let [s, t] = &change.simulators;
        let [a, b] = change.differences;
        let how = if change.is_reversed { "is reversed" } else { "keeps its sign" };
        notes.push(format!(
            "The difference of `{p}` and `{q}` depends most on the simulator and {how}: {a:+.3} under `{s}`, {b:+.3} under \
             `{t}`. It changes most in scenario `{}`.",
            change.scenario
        ));
    }
    notes.push(
        "Agents ignored the AV: every hit agent was within 0.5 m of where it is with the logged AV, up to the contact. \
         None, as agents were frozen: the AV causes a collision under another simulator and none under this one, whose \
         over-reaction to the deviated AV of the scenario is at least 5 m."
            .to_owned(),
    );
    notes
}
