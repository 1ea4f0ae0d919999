//! nuPlan's comfort bounds, a stricter option.

use crate::curation::filter::{CandidateFilter, FilterSettings, Trial, Verdict};
use crate::geometry::{Vec2, direction, left, wrap};
use crate::scene::{AgentState, DT};

/// Obeys nuPlan's comfort bounds (nuPlan devkit, `ego_is_comfortable`): by differences over 0.3 s on either side, which stand for its
/// smoothing.
pub(super) struct Comfort;

/// The id of the filter.
pub(in crate::curation) const ID: &str = "comfort";
/// Steps on either side of a difference.
const REACH: usize = 3;
/// Longitudinal acceleration, m/s².
const LONGITUDINAL: (f64, f64) = (-4.05, 2.40);
/// Magnitudes: lateral acceleration (m/s²), jerk, longitudinal jerk (m/s³), yaw rate (rad/s), yaw acceleration (rad/s²).
const BOUNDS: [(&str, f64); 5] = [
    ("lateral acceleration", 4.89),
    ("jerk", 8.37),
    ("longitudinal jerk", 4.13),
    ("yaw rate", 0.95),
    ("yaw acceleration", 1.93),
];

impl CandidateFilter for Comfort {
    fn id(&self) -> &'static str {
        ID
    }

    fn rule(&self, settings: &FilterSettings) -> String {
        if settings.comfort {
            "nuPlan's comfort bounds hold (by differences over 0.6 s, history included, but for the last 0.9 s)".to_owned()
        } else {
            "off: nuPlan's comfort bounds, told as the largest share of a bound that is used".to_owned()
        }
    }

    fn judge(&self, trial: &Trial<'_>) -> Verdict {
        let history = trial.bench.scenario.start.history[0].iter().rev().skip(1).map_while(|f| *f);
        let mut track: Vec<AgentState> = history.collect();
        track.reverse();
        track.extend(&trial.candidate.track);
        let (share, name) = largest_share(&track);
        Verdict::new(Some(share), !trial.settings.comfort || share <= 1.0, || {
            format!("{name}: {share:.2} of the bound")
        })
    }
}

/// The largest share of a bound that is used, and which.
fn largest_share(track: &[AgentState]) -> (f64, &'static str) {
    let span = 2.0 * REACH as f64 * DT;
    let difference = |values: &[Vec2]| -> Vec<Vec2> {
        values.windows(2 * REACH + 1).map(|w| (w[2 * REACH] - w[0]) / span).collect()
    };
    let positions: Vec<Vec2> = track.iter().map(AgentState::position).collect();
    let velocities = difference(&positions);
    let accelerations = difference(&velocities);
    let jerks = difference(&accelerations);
    let yaw_rates: Vec<f64> =
        track.windows(2 * REACH + 1).map(|w| wrap(w[2 * REACH].heading - w[0].heading) / span).collect();
    let yaw_accelerations = yaw_rates.windows(2 * REACH + 1).map(|w| (w[2 * REACH] - w[0]) / span);
    let mut worst = (0.0, "");
    let mut take = |value: f64, bound: f64, name: &'static str| {
        let share = value / bound;
        if share > worst.0 {
            worst = (share, name);
        }
    };
    let axis = |k: usize| direction(track[k].heading);
    for (i, a) in accelerations.iter().enumerate() {
        let ahead = axis(i + 2 * REACH);
        let along = a.dot(&ahead);
        take(along.max(0.0), LONGITUDINAL.1, "acceleration");
        take((-along).max(0.0), -LONGITUDINAL.0, "braking");
        take(a.dot(&left(ahead)).abs(), BOUNDS[0].1, BOUNDS[0].0);
    }
    for (i, j) in jerks.iter().enumerate() {
        take(j.norm(), BOUNDS[1].1, BOUNDS[1].0);
        take(j.dot(&axis(i + 3 * REACH)).abs(), BOUNDS[2].1, BOUNDS[2].0);
    }
    yaw_rates.iter().for_each(|r| take(r.abs(), BOUNDS[3].1, BOUNDS[3].0));
    yaw_accelerations.for_each(|r| take(r.abs(), BOUNDS[4].1, BOUNDS[4].0));
    worst
}
