//! Statistics of a set of deviations as readable tables.

use std::io::{self, Write};

use reactsim_curation::{
    AV_ABSENT, FEW_VEHICLES, NO_APPROACH,
    stats::{Confusion, Distribution, Part, Statistics},
};
use reactsim_scene::{Deviation, Difficulty};

use super::markdown::{capital, escape, write_aligned};

/// Writes the numbers of scenarios and candidates left after each step, and the counts by category.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_overview(out: &mut dyn Write, statistics: &Statistics) -> io::Result<()> {
    write_aligned(out, &["Step", "Scenarios", "Candidates"], funnel(statistics), 1)?;
    writeln!(out)?;
    let categories = parts(statistics);
    let categories =
        categories.into_iter().map(|(name, p)| vec![name, p.count.to_string(), percent(p.share)]);
    write_aligned(out, &["Category", "Chosen", "Share (%)"], categories, 1)?;
    let difficulties = Difficulty::ALL.iter().filter_map(|d| statistics.difficulties.get_key_value(d.name()));
    let difficulties =
        difficulties.map(|(name, p)| vec![capital(name), p.count.to_string(), percent(p.share)]);
    writeln!(out)?;
    write_aligned(out, &["Difficulty", "Chosen", "Share (%)"], difficulties, 1)
}

/// Writes all tables of the paper's analysis.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_statistics(out: &mut dyn Write, statistics: &Statistics) -> io::Result<()> {
    if statistics.interrupted {
        writeln!(out, "The curation was interrupted: this is what was finished until then.\n")?;
    }
    write_overview(out, statistics)?;
    writeln!(out, "\nUnder log replay, scenarios with at least one:\n")?;
    let head = ["Category", "Collision, agent at fault (%)", "Any overlap (%)", "TTC below 0.5 s (%)"];
    let pressure = parts(statistics).into_iter().map(|(name, Part { pressure: found, .. })| {
        let shares = [found.at_fault, found.overlap, found.risky].map(percent);
        std::iter::once(name).chain(shares).collect()
    });
    write_aligned(out, &head, pressure, 1)?;
    writeln!(
        out,
        "\nChosen candidates against their logs; offsets of the last position in the AV's frame at step 0:\n"
    )?;
    let head = ["Quantity", "Category", "n", "Mean", "Min", "25 %", "Median", "75 %", "Max"];
    write_aligned(out, &head, distributions(statistics), 2)?;
    for (title, confusion) in [
        ("all candidates", &statistics.agreement.candidates),
        ("chosen candidates", &statistics.agreement.chosen),
    ] {
        let share = percent(confusion.share);
        writeln!(
            out,
            "\nWhat the source meant (rows) and the category found, {title}; the same in {share} %:\n"
        )?;
        let head = ["Meant".to_owned()].into_iter().chain(Deviation::ALL.map(|c| capital(c.name())));
        write_aligned(out, &head.collect::<Vec<_>>(), agreement(confusion), 1)?;
    }
    let c = &statistics.certificates;
    writeln!(
        out,
        "\nCertificates: {} of {} chosen candidates, {} responses, {} of them with a sideways shift.",
        c.certified, statistics.chosen, c.responses, c.nudged
    )?;
    if statistics.chosen_without_certificate > 0 {
        writeln!(out, "Chosen without a certificate: {}.", statistics.chosen_without_certificate)?;
    }
    for (filter, n) in &statistics.chosen_although_rejected {
        writeln!(out, "Chosen although rejected by {}: {n}.", escape(filter))?;
    }
    if !statistics.reviewed.is_empty() {
        let each: Vec<String> =
            statistics.reviewed.iter().map(|(what, n)| format!("{} {n}", escape(what))).collect();
        writeln!(out, "Decided by hand among the chosen: {}.", each.join(", "))?;
    }
    Ok(())
}

/// Returns the categories in order, then their total.
fn parts(statistics: &Statistics) -> Vec<(String, &Part)> {
    let of = |c: Deviation| Some((capital(c.name()), statistics.categories.get(c.name())?));
    let mut parts: Vec<_> = Deviation::ALL.into_iter().filter_map(of).collect();
    parts.push(("All".to_owned(), &statistics.overall));
    parts
}

/// Returns one row per step with the numbers left, preceded by the rejections of the step.
fn funnel(statistics: &Statistics) -> Vec<Vec<String>> {
    let funnel = &statistics.funnel;
    let fell = |n: u64| if n > 0 { format!("−{n}") } else { "0".to_owned() };
    let mut rows = vec![vec!["Read".into(), funnel.scenarios.to_string(), String::new()]];
    for (rule, n) in dropped(statistics) {
        rows.push(vec![format!("– {}", escape(rule)), fell(n), String::new()]);
    }
    let streams = funnel.candidates + funnel.unproposed.values().sum::<u64>();
    rows.push(vec!["1 Pre-selected".into(), funnel.preselected.to_string(), streams.to_string()]);
    for (reason, n) in &funnel.unproposed {
        rows.push(vec![format!("– {}", escape(reason)), String::new(), fell(*n)]);
    }
    rows.push(vec!["2 Proposed".into(), String::new(), funnel.candidates.to_string()]);
    for (filter, n) in rejections(statistics) {
        rows.push(vec![format!("– {}", escape(filter)), String::new(), fell(n)]);
    }
    let survived = statistics.with_survivor.to_string();
    rows.push(vec!["3 Survived".into(), survived, funnel.survivors.to_string()]);
    rows.push(vec!["4 Chosen".into(), statistics.chosen.to_string(), statistics.chosen.to_string()]);
    rows
}

/// Returns the numbers of scenarios rejected by each rule of step 1, in the order of the rules; rules
/// unknown to this program come last.
fn dropped(statistics: &Statistics) -> Vec<(&str, u64)> {
    const RULES: [&str; 3] = [FEW_VEHICLES, NO_APPROACH, AV_ABSENT];
    let place = |rule: &str| RULES.iter().position(|known| *known == rule).unwrap_or(RULES.len());
    let rules = &statistics.funnel.preselection;
    let mut dropped: Vec<(&str, u64)> = rules.iter().map(|(rule, n)| (rule.as_str(), *n)).collect();
    dropped.sort_by_key(|(rule, _)| place(rule));
    dropped
}

/// Returns the numbers of candidates that each filter was the first to reject, in the order of the
/// filters.
fn rejections(statistics: &Statistics) -> Vec<(&str, u64)> {
    let rejected = &statistics.funnel.rejected;
    let known = statistics.filters.iter().map(|f| (f.as_str(), rejected.get(f).copied().unwrap_or(0)));
    let others = rejected.iter().filter(|(f, _)| !statistics.filters.contains(f));
    known.chain(others.map(|(f, n)| (f.as_str(), *n))).collect()
}

fn distributions(statistics: &Statistics) -> Vec<Vec<String>> {
    type Of = fn(&Part) -> &Distribution;
    let quantities: [(&str, Of); 4] = [
        ("ADE (m)", |p| &p.ade),
        ("Mean-speed difference (m/s)", |p| &p.mean_speed_difference),
        ("Endpoint ahead (m)", |p| &p.endpoint_longitudinal),
        ("Endpoint to the left (m)", |p| &p.endpoint_lateral),
    ];
    let mut rows = Vec::new();
    for (quantity, of) in quantities {
        for (name, part) in parts(statistics) {
            rows.push(distribution(quantity, name, of(part)));
        }
    }
    let peak = &statistics.certificates.peak_deceleration;
    rows.push(distribution("Hardest braking of certificates (m/s²)", "All".into(), peak));
    let required = &statistics.certificates.required_deceleration;
    rows.push(distribution("Required deceleration (m/s²)", "All".into(), required));
    rows.push(distribution("Time to react (s)", "All".into(), &statistics.certificates.time_to_react));
    rows
}

fn distribution(quantity: &str, category: String, d: &Distribution) -> Vec<String> {
    let mut row = vec![quantity.to_owned(), category, d.n.to_string()];
    row.extend([d.mean, d.min, d.lower_quartile, d.median, d.upper_quartile, d.max].map(number));
    row
}

fn agreement(confusion: &Confusion) -> impl Iterator<Item = Vec<String>> {
    Deviation::ALL.into_iter().map(|intent| {
        let line = confusion.counts.get(intent.name());
        let count = |c: Deviation| line.and_then(|l| l.get(c.name())).copied().unwrap_or(0);
        let counts = Deviation::ALL.map(|c| count(c).to_string());
        std::iter::once(capital(intent.name())).chain(counts).collect()
    })
}

/// Formats a number with two digits, without a minus before zero; a dash for `None`.
fn number(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |v| {
        let text = format!("{v:.2}");
        if text == "-0.00" { "0.00".to_owned() } else { text.replace('-', "−") }
    })
}

fn percent(share: Option<f64>) -> String {
    share.map_or("–".to_owned(), |s| format!("{:.1}", 100.0 * s))
}
