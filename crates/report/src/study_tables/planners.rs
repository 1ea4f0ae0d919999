//! The order of planners under each simulator, as rows of texts.

use reactsim_evaluation::{PlannerRanks, StudyResults};

/// A table of texts; the first row is its head.
pub(super) struct TextTable {
    pub(super) title: &'static str,
    /// Number of columns of texts, which come first; the others are numbers.
    pub(super) texts: usize,
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
    let with_head = |head: Vec<String>, rows: Vec<Vec<String>>| -> Vec<Vec<String>> {
        std::iter::once(head).chain(rows).collect()
    };
    let heads = |heads: &[&str]| heads.iter().map(|head| (*head).to_owned()).collect::<Vec<_>>();
    vec![
        TextTable {
            title: "Rank of the planners by their score, 1 is best",
            texts: 1,
            rows: with_head(texts("Method", &found.planners), ranks.collect()),
        },
        TextTable {
            title: "Kendall's tau of the order of planners between two simulators",
            texts: 2,
            rows: with_head(heads(&["Method", "Method", "Tau", "95 % interval"]), agreement.collect()),
        },
        TextTable {
            title: "Collisions that the AV causes, over all planners but the log, and what traffic has to do with them",
            texts: 1,
            rows: with_head(
                heads(&["Method", "At fault", "Agents ignored the AV", "None, as agents were frozen"]),
                reasons.collect(),
            ),
        },
    ]
}

/// Returns the title of a simulator.
pub(super) fn title(results: &StudyResults, id: &str) -> String {
    let mut order = results.summaries.iter().flat_map(|summary| summary.order());
    order.find(|(other, ..)| *other == id).map_or_else(|| id.to_owned(), |(_, title, _)| title.to_owned())
}

/// Returns the sentences below the tables.
pub(super) fn notes(found: &PlannerRanks) -> Vec<String> {
    let mut notes = vec![format!(
        "Ranks and tau are of `{}` on the {} scenarios that have it for every planner and simulator.",
        found.score, found.scenarios
    )];
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
