//! Defines a metric, and computes it for a baseline on hand-written scenarios.
//!
//! ```sh
//! cargo run --release --example own_metric
//! ```

// Examples print; the library does not.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::path::Path;
use std::sync::Arc;

use reactsim::metrics::{Case, Event, Judgement, Metric, MetricSpec, Options, Scope, Score, Unit};
use reactsim::rollout::{DeviatedAv, Request, Settings, roll_out};
use reactsim::{formats, models};

/// Smallest distance between box centres of the AV and each object over the rollout, metres. Judgements
/// are computed once per case, whichever metrics use them.
struct ClosestDistances(Vec<f64>);

impl Judgement for ClosestDistances {
    fn compute(case: &Case<'_>) -> Self {
        let motion = case.motion();
        let distance = |i: usize| {
            let steps = case.future().map(|f| (motion.position(i, f) - motion.position(case.av, f)).norm());
            // Absent frames are NaN, which `min` ignores.
            steps.fold(f64::INFINITY, f64::min)
        };
        Self((0..case.objects.len()).map(distance).collect())
    }
}

/// Mean over vehicles of the smallest distance to the AV.
struct MeanClosestDistance;

impl Metric for MeanClosestDistance {
    fn spec(&self) -> &'static MetricSpec {
        &MetricSpec {
            id: "mean-closest-distance",
            title: "Closest",
            unit: Unit::Metres,
            scope: Scope::Rollout,
            lower_is_better: false,
            source: "this example",
        }
    }

    fn score(&self, case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
        let distances = &case.judgement::<ClosestDistances>().0;
        let vehicles: Vec<usize> = case.vehicles().filter(|&i| distances[i].is_finite()).collect();
        for &i in vehicles.iter().filter(|&&i| distances[i] < 5.0) {
            let steps = case.frames() - case.current - 1;
            events.push(Event {
                metric: self.spec().id,
                step: 1,
                last_step: steps,
                agent: case.id(i),
                partner: Some(case.id(case.av)),
                reason: None,
                counted: true,
                values: vec![("distance", distances[i])],
            });
        }
        let sum: f64 = vehicles.iter().map(|&i| distances[i]).sum();
        (!vehicles.is_empty()).then(|| Score::Value(sum / vehicles.len() as f64))
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let idm = models::find("idm").ok_or("no such baseline")?.simulator()?;
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
    for scenario in formats::open(Path::new(folder))? {
        let scenario = scenario?;
        let Some(deviation) = &scenario.deviation else { continue };
        let av = DeviatedAv::new(&scenario.start.now(0), deviation.track.clone())?;
        let request = Request { scenario: &scenario, av: Some(Arc::new(av)), rollout: 0 };
        for rollout in roll_out(vec![request], &idm, &Settings::default()) {
            let case = Case::of_rollout(&scenario, rollout?.tracks, Options::default());
            let mut events = Vec::new();
            let score = MeanClosestDistance.score(&case, &mut events);
            let value = score.and_then(|s| s.value()).map_or("–".to_owned(), |v| format!("{v:.1} m"));
            println!("{:24} {value}, {} vehicles within 5 m", scenario.id, events.len());
        }
    }
    Ok(())
}
