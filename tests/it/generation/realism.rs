//! Distributions of generated logs are like those of recorded ones.

use std::fmt::Write;

use reactsim::formats::find_inputs;
use reactsim::generation::realism::{Measured, Quantity, Tally, divergence};
use reactsim::generation::{GenerationError, GenerationSettings, Generator, Preset};

/// Largest divergences of a judged statistic of the training presets from that of recordings (Jensen-Shannon,
/// base 2).
const APART: [(Preset, f64); 2] = [(Preset::Train, 0.15), (Preset::Sensed, 0.11)];
/// Number of scenarios that are measured.
const SCENARIOS: u64 = 120;
/// Statistics of recorded driving: per judged statistic the values in each bin of its histogram.
const RECORDED: &str = include_str!("recorded.txt");

fn judged() -> impl Iterator<Item = Quantity> {
    Quantity::ALL.into_iter().filter(|q| q.decides())
}

/// Returns the recorded bins of a statistic.
fn recorded(quantity: Quantity) -> Vec<u64> {
    let id = quantity.spec().id;
    let line = RECORDED.lines().find_map(|l| l.strip_prefix(id)?.strip_prefix(": "));
    let bins: Vec<u64> =
        line.unwrap_or_else(|| panic!("no figures of {id}")).split(' ').map(|n| n.parse().unwrap()).collect();
    assert_eq!(bins.len(), quantity.spec().bins.count, "{id} has other bins than its figures");
    bins
}

#[test]
fn generated_driving_is_spread_as_recorded_driving() {
    for (preset, most) in APART {
        is_spread_as_recorded_driving(preset, most);
    }
}

fn is_spread_as_recorded_driving(preset: Preset, most: f64) {
    let settings = GenerationSettings { preset, ..GenerationSettings::default() };
    let generator = Generator::new(settings).unwrap();
    let scenarios = (0..SCENARIOS).map(|n| {
        let generator = &generator;
        move || generator.scenario(n)
    });
    let measured = Measured::of(scenarios, 2, |e: GenerationError| panic!("{e}")).whole();
    let (mut table, mut failing) = (String::new(), Vec::new());
    for quantity in judged() {
        let (expected, found) = (recorded(quantity), measured.of(quantity).counts());
        let apart = divergence(&found, &expected);
        // A statistic without values fails.
        let fails = !apart.is_some_and(|d| d < most);
        let mark = if fails { " <-" } else { "" };
        let apart = apart.map_or("none".to_owned(), |d| format!("{d:.3}"));
        let shares = |bins: &[u64]| {
            let n = bins.iter().sum::<u64>().max(1) as f64;
            bins.iter().map(|b| format!("{:3.0}", 100.0 * *b as f64 / n)).collect::<Vec<_>>().join(" ")
        };
        let id = quantity.spec().id;
        writeln!(
            table,
            "{id:16} {apart}{mark}\n    generated % {}\n    recorded  % {}",
            shares(&found),
            shares(&expected)
        )
        .unwrap();
        failing.extend(fails.then_some(id));
    }
    assert!(failing.is_empty(), "{preset:?}: {most} or more apart: {}\n{table}", failing.join(", "));
}

/// The recorded statistics are those of the stated data.
#[test]
fn the_recorded_figures_are_those_of_the_recordings() {
    let Some(folder) = crate::shared("data/womd/train") else { return };
    let measured = tally(&folder);
    let expected: String = judged()
        .map(|q| {
            let bins = measured.of(q).counts().iter().map(u64::to_string).collect::<Vec<_>>().join(" ");
            format!("{}: {bins}\n", q.spec().id)
        })
        .collect();
    let said: String = RECORDED.lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect();
    assert!(said == expected, "the figures of {} scenarios are:\n{expected}", measured.scenarios);
}

fn tally(folder: &std::path::Path) -> Tally {
    let records = find_inputs(folder).unwrap().into_iter();
    let records = records.flat_map(|i| i.open_undecoded().unwrap());
    Measured::of(records.map(|r| move || r.and_then(|decode| decode())), 2, |e| panic!("{e}")).whole()
}
