//! Comparisons of two results as tables.

use std::io::{self, Write};

use reactsim_evaluation::{Comparison, ConditionDifference, PairedDifference, SettingsRecord};
use reactsim_metrics::Unit;

use super::markdown::{escape, write_aligned};
use super::table::{COLUMNS, Column, count};

/// Writes comparisons of two runs with these settings as Markdown, with the conditions in which the runs
/// differ. Metrics of the AV come first. Per metric, lists at most `most` scenarios that got better and at
/// most `most` that got worse.
///
/// # Errors
/// If `out` cannot be written.
pub fn write(
    comparisons: &[Comparison],
    settings: [&SettingsRecord; 2],
    differences: &[ConditionDifference],
    most: usize,
    out: &mut dyn Write,
) -> io::Result<()> {
    for (i, comparison) in comparisons.iter().enumerate() {
        let Comparison { first, second, scenarios, unpaired, .. } = comparison;
        let same = first == second;
        let title = if same { escape(first) } else { format!("{} and {}", escape(first), escape(second)) };
        let av = common_planner(settings).map(|av| format!(", AV driven by planner {}", escape(av)));
        let (gap, av) = (if i > 0 { "\n" } else { "" }, av.unwrap_or_default());
        writeln!(out, "{gap}{title}{av}: {}\n", count(*scenarios, "scenario"))?;
        let names = names(settings);
        write_differences(comparison, names.each_ref().map(String::as_str), out)?;
        let hidden = columns(comparison).filter(|(_, paired)| paired.may_hide_doubling(0.0));
        let hidden: Vec<&str> = hidden.map(|(column, _)| column.title()).collect();
        if !hidden.is_empty() {
            writeln!(out, "\nToo few scenarios to see a doubling: {}.", hidden.join(", "))?;
        }
        if *unpaired > 0 {
            writeln!(out, "\n{} in one run alone.", count(*unpaired, "scenario"))?;
        }
        for (column, paired) in columns(comparison) {
            for (name, changed) in [("Worse", &paired.worse), ("Better", &paired.better)] {
                let shown = changed.iter().take(most);
                let all: Vec<String> =
                    shown.map(|(id, d)| format!("{} ({})", escape(id), signed(&column, *d))).collect();
                if !all.is_empty() {
                    let more = changed.len() - all.len();
                    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                    writeln!(out, "\n{name}, {}: {}{more}", column.title(), all.join(", "))?;
                }
            }
        }
    }
    writeln!(out, "\n{LEGEND}")?;
    for ConditionDifference { condition, first, second } in differences {
        let (first, second) = (escape(first), escape(second));
        writeln!(out, "The runs differ in `{}`: {first} and {second}.", condition.name())?;
    }
    Ok(())
}

/// What the tables of differences show.
pub const LEGEND: &str = "\
    n: scenarios in which both have a value; all numbers are of them. Second minus first, scenario by \
    scenario: mean with its 95 % bootstrap interval; p by a permutation test of the signs; the verdict is for p \
    below 0.05, one column at a time. Seen from: so large a difference is found in four of five cases.";

/// Writes the table of a comparison, with heads of the values of the first and the second.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_differences(
    comparison: &Comparison,
    [first, second]: [&str; 2],
    out: &mut dyn Write,
) -> io::Result<()> {
    let head =
        ["Metric", "n", first, second, "Difference", "p", "Verdict", "Seen from", "Better in", "Worse in"];
    write_aligned(out, &head, columns(comparison).map(|(column, paired)| row(&column, paired)), 1)
}

/// Returns the change of a metric in words, such as `Progress 0.855 → 0.810 (p 0.0400)`.
pub fn change(paired: &PairedDifference) -> String {
    let column = Column::of_spec(paired.metric);
    let unit = column.unit().map(|unit| format!(" {unit}")).unwrap_or_default();
    let [first, second] = [paired.first, paired.second].map(|value| column.number(value));
    format!("{} {first} → {second}{unit} (p {})", column.title(), p_text(paired.p))
}

/// Returns in words how large a rise of a metric, of which less is better, a comparison could see in four of
/// five cases, and whether that is too large: more than a doubling and more than `least`.
pub fn power(paired: &PairedDifference, least: f64) -> String {
    let column = Column::of_spec(paired.metric);
    let unit = column.unit().map(|unit| format!(" {unit}")).unwrap_or_default();
    let number = |value| format!("{}{unit}", column.number(value));
    let seen = match (paired.visible, paired.may_hide_doubling(least)) {
        (Some(visible), true) => format!("cannot see a doubling, only a rise by {}", number(visible)),
        (None, true) if paired.metric.unit == Unit::Rate && paired.first == 0.0 && paired.second == 0.0 => {
            "0 in all scenarios, which does not tell how large a rise they would show".to_owned()
        }
        (None, true) => "cannot see a doubling: too few for any verdict".to_owned(),
        (Some(visible), false) if visible > paired.first => {
            format!("sees a rise by {}; a doubling is less than {}", number(visible), number(least))
        }
        (Some(visible), false) => format!("sees a rise by {}, less than a doubling", number(visible)),
        (None, false) => "equal in all scenarios".to_owned(),
    };
    format!("{} {}: {seen}", column.title(), number(paired.first))
}

/// Smallest p-value that is printed as a number.
const MIN_PRINTED_P: f64 = 0.0001;

/// Returns the planner that drives the AV of both runs.
fn common_planner(settings: [&SettingsRecord; 2]) -> Option<&str> {
    let [first, second] = settings.map(SettingsRecord::planner);
    first.filter(|_| first == second)
}

/// Returns the names of the two runs in column heads; runs with different AVs are named by them if one of
/// these is a planner.
fn names(settings: [&SettingsRecord; 2]) -> [String; 2] {
    let are_named = settings.iter().any(|of| of.planner().is_some()) && settings[0].av != settings[1].av;
    let name = |which: &str, of: &SettingsRecord| match are_named {
        true => format!("{which}: {}", escape(of.planner().unwrap_or(&of.av))),
        false => which.to_owned(),
    };
    [name("First", settings[0]), name("Second", settings[1])]
}

/// Returns the metrics of a comparison: those of the AV, those of the tables in their order, then those that
/// only the runs have.
fn columns(comparison: &Comparison) -> impl Iterator<Item = (Column, &PairedDifference)> {
    let paired = comparison.metrics.values();
    let own = paired.map(|p| Column::of_spec(p.metric)).filter(|c| Column::of(c.metric).is_none());
    let of_benchmark = Column::av_of_benchmark().chain(COLUMNS.iter().copied());
    of_benchmark.chain(own).filter_map(|c| Some((c, comparison.metrics.get(c.metric)?)))
}

fn row(column: &Column, paired: &PairedDifference) -> Vec<String> {
    let interval = match (paired.difference.low, paired.difference.high) {
        (Some(low), Some(high)) => format!(" [{}, {}]", signed(column, low), signed(column, high)),
        _ => String::new(),
    };
    vec![
        column.head(),
        paired.difference.scenarios.to_string(),
        column.number(paired.first),
        column.number(paired.second),
        format!("{}{interval}", signed(column, paired.second - paired.first)),
        p_text(paired.p),
        paired.verdict.words().to_owned(),
        paired.visible.map_or_else(|| "–".to_owned(), |visible| format!("±{}", column.number(visible))),
        paired.better.len().to_string(),
        paired.worse.len().to_string(),
    ]
}

/// Formats a p-value.
pub(super) fn p_text(p: f64) -> String {
    if p < MIN_PRINTED_P { format!("< {MIN_PRINTED_P}") } else { format!("{p:.4}") }
}

/// Formats a number with its sign; numbers that round to 0 have none.
pub(super) fn signed(column: &Column, value: f64) -> String {
    let text = column.number(value.abs());
    match value {
        _ if text.chars().all(|c| matches!(c, '0' | '.')) => text,
        v if v < 0.0 => format!("-{text}"),
        _ => format!("+{text}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(av: &str) -> SettingsRecord {
        SettingsRecord { av: av.to_owned(), ..SettingsRecord::recorded(1) }
    }

    /// No difference of a metric in this number of scenarios.
    fn found(metric: &str, first: f64, visible: Option<f64>, scenarios: usize) -> PairedDifference {
        PairedDifference {
            metric: reactsim_metrics::metric(metric).unwrap().spec(),
            first,
            second: first,
            groups: None,
            difference: reactsim_evaluation::Estimate { scenarios, ..Default::default() },
            p: 1.0,
            verdict: reactsim_evaluation::Verdict::NoDifferenceSeen,
            visible,
            better: Vec::new(),
            worse: Vec::new(),
        }
    }

    #[test]
    fn planners_are_named() {
        let [idm, pdm, log] = ["planner:idm", "planner:pdm-closed", "log"].map(settings);
        assert_eq!(common_planner([&idm, &idm]), Some("idm"));
        assert_eq!((common_planner([&idm, &pdm]), common_planner([&log, &log])), (None, None));
        assert_eq!(names([&idm, &pdm]), ["First: idm", "Second: pdm-closed"]);
        assert_eq!(names([&log, &pdm]), ["First: log", "Second: pdm-closed"]);
        assert_eq!(names([&idm, &idm]), ["First", "Second"]);
    }

    #[test]
    fn metrics_of_the_av_come_first() {
        let paired = |metric: &str| {
            let found = found(metric, 0.5, None, 0);
            (found.metric.id, PairedDifference { second: 0.75, ..found })
        };
        let comparison = Comparison {
            first: "idm".to_owned(),
            second: "idm".to_owned(),
            scenarios: 3,
            unpaired: 0,
            metrics: ["aav-collision", "av-comfort", "av-score"].map(paired).into(),
        };
        let shown: Vec<&str> = columns(&comparison).map(|(column, _)| column.metric).collect();
        assert_eq!(shown, ["av-score", "av-comfort", "aav-collision"]);
        let mut out = Vec::new();
        let idm = settings("planner:idm");
        write(&[comparison], [&idm, &idm], &[], 3, &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert!(text.starts_with("idm, AV driven by planner idm: 3 scenarios\n"), "{text}");
        assert!(text.contains("+0.250"), "{text}");
    }

    #[test]
    fn the_power_is_stated_in_the_unit_of_the_column() {
        let power = |metric: &str, first, visible, scenarios, least| {
            super::power(&found(metric, first, visible, scenarios), least)
        };
        let collision = |first, visible, scenarios| power("aav-collision", first, visible, scenarios, 0.05);
        assert_eq!(
            collision(0.016, Some(0.14), 60),
            "A-AV Coll. 0.016: cannot see a doubling, only a rise by 0.140"
        );
        assert_eq!(
            collision(0.016, Some(0.05), 60),
            "A-AV Coll. 0.016: sees a rise by 0.050; a doubling is less than 0.050"
        );
        assert_eq!(
            collision(0.2, Some(0.14), 60),
            "A-AV Coll. 0.200: sees a rise by 0.140, less than a doubling"
        );
        assert_eq!(
            collision(0.2, None, 5),
            "A-AV Coll. 0.200: cannot see a doubling: too few for any verdict"
        );
        assert_eq!(
            power("offroad", 0.002, Some(0.01), 60, 0.005),
            "Offroad 0.20 %: cannot see a doubling, only a rise by 1.00 %"
        );
        assert_eq!(
            power("offroad", 0.0, None, 60, 0.005),
            "Offroad 0.00 %: 0 in all scenarios, which does not tell how large a rise they would show"
        );
        assert_eq!(power("ade", 2.0, None, 60, 0.0), "ADE 2.00 m: equal in all scenarios");
    }
}
