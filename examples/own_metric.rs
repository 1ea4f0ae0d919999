//! Defines a metric and runs it next to those of the benchmark: the table and the page show it like them.
//!
//! ```sh
//! cargo run --release --example own_metric
//! ```

// Examples print; the library does not.
#![allow(clippy::print_stdout)]

use std::{env, fs, process};

use reactsim::Benchmark;
use reactsim::metrics::{Case, Event, Metric, MetricSpec, Scope, Score, Unit};
use reactsim::report::page::Gallery;

/// Mean over vehicles of the smallest distance between their centre and that of the AV, metres.
struct Closest;

impl Metric for Closest {
    fn spec(&self) -> &'static MetricSpec {
        &MetricSpec {
            id: "mean-closest-distance",
            title: "Closest",
            unit: Unit::Metres,
            scope: Scope::Rollout,
            lower_is_better: false,
            source: "examples/own_metric.rs",
        }
    }

    // A metric that counts occurrences also pushes an event for each of them.
    fn score(&self, case: &Case<'_>, _events: &mut Vec<Event>) -> Option<Score> {
        let motion = case.motion();
        let closest = |i: usize| {
            let distances =
                case.future().map(|f| (motion.position(i, f) - motion.position(case.av, f)).norm());
            // Absent frames are NaN, which `min` ignores.
            distances.fold(f64::INFINITY, f64::min)
        };
        let found: Vec<f64> = case.vehicles().map(closest).filter(|distance| distance.is_finite()).collect();
        Some(Score::Mean { sum: found.iter().sum(), n: found.len() as u64 })
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = env::temp_dir().join(format!("own-metric-{}", process::id()));
    let run = Benchmark::shipped().limit(20).baselines(["log-replay", "idm"]).metric(Box::new(Closest));
    print!("{}", run.keep_rollouts().folder(&folder).run()?.table());
    let page = folder.join("page.html");
    Gallery::of_folders(&[folder], &[])?.write(&[], 12, false, &mut fs::File::create(&page)?)?;
    println!("\nThe page with the scenes is {}", page.display());
    Ok(())
}
