//! Displacements from the log by what agents do in it, as rows of texts.

use reactsim_evaluation::{ErrorGroup, StudyResults};

use super::planners::{TextTable, title};

/// Titles of the tables, by what agents are grouped by.
const TITLES: [(&str, &str); 6] = [
    ("all", "Displacement from the log, m"),
    ("class", "Displacement from the log by class, m"),
    ("situation", "Displacement from the log by what agents do in it, m"),
    ("speed", "Displacement from the log by speed at the current frame, m"),
    ("distance", "Displacement from the log by distance from the AV at the current frame, m"),
    ("time", "Displacement from the log by time, m"),
];

/// Returns a table for everything that agents are grouped by, with a row per group and simulator.
pub(super) fn error_tables(results: &StudyResults) -> Vec<TextTable> {
    let Some(found) = &results.errors else { return Vec::new() };
    let heads = ["Method", "Agents", "Number", "Displacement", "Ahead", "Aside", "Share"];
    let table = |(by, name): (&str, &'static str)| {
        let rows = found.simulators.iter().flat_map(|simulator| {
            let groups = simulator.groups.iter().filter(move |group| group.by == by);
            groups.map(|group| row(&title(results, &simulator.id), group))
        });
        TextTable { title: name, texts: 2, head: heads.map(str::to_owned).to_vec(), rows: rows.collect() }
    };
    TITLES.into_iter().map(table).filter(|table| !table.rows.is_empty()).collect()
}

fn row(title: &str, group: &ErrorGroup) -> Vec<String> {
    let displacement = match (group.low, group.high) {
        (Some(low), Some(high)) => format!("{:.2} ({low:.2} to {high:.2})", group.displacement),
        _ => format!("{:.2}", group.displacement),
    };
    vec![
        title.to_owned(),
        group.group.clone(),
        group.agents.to_string(),
        displacement,
        format!("{:+.2}", group.ahead),
        format!("{:.2}", group.aside),
        group.share.map_or_else(|| "–".to_owned(), |share| format!("{:.0} %", 100.0 * share)),
    ]
}

/// Sentence below the tables.
pub(super) const NOTE: &str = "Displacements are means over agents, with 95 % intervals over scenarios. Ahead is the \
    mean offset along the logged heading, aside the mean distance across it, and the share is that of all \
    displacements. An agent belongs to the first of these situations that applies: stands, sets off, turns, halts, \
    follows, crosses, drives freely.";
