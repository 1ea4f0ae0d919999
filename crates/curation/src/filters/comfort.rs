//! Filter of nuPlan's comfort bounds, a stricter option.

use reactsim_geometry::{Vec2, direction, left, wrap};
use reactsim_scene::{AgentState, DT};

use crate::filter::{CandidateFilter, Verdict};

pub(crate) const ID: &str = "comfort";
/// Number of steps on either side of a difference.
const HALF_WINDOW: usize = 3;
/// Smallest longitudinal acceleration, m/s².
const MIN_LONGITUDINAL_ACCELERATION: f64 = -4.05;
/// Largest longitudinal acceleration, m/s².
const MAX_LONGITUDINAL_ACCELERATION: f64 = 2.40;
/// Largest magnitude of the lateral acceleration, m/s².
const MAX_LATERAL_ACCELERATION: f64 = 4.89;
/// Largest magnitude of the jerk, m/s³.
const MAX_JERK: f64 = 8.37;
/// Largest magnitude of the longitudinal jerk, m/s³.
const MAX_LONGITUDINAL_JERK: f64 = 4.13;
/// Largest magnitude of the yaw rate, rad/s.
const MAX_YAW_RATE: f64 = 0.95;
/// Largest magnitude of the yaw acceleration, rad/s².
const MAX_YAW_ACCELERATION: f64 = 1.93;

/// Requires nuPlan's comfort bounds (nuPlan devkit, `ego_is_comfortable`). Differences over 0.3 s on
/// either side replace its smoothing.
pub(super) const COMFORT: CandidateFilter = CandidateFilter {
    id: ID,
    rule: |settings| {
        if settings.comfort {
            "nuPlan's comfort bounds hold \
             (by differences over 0.6 s, history included, but for the last 0.9 s)"
                .to_owned()
        } else {
            "off: nuPlan's comfort bounds, told as the largest share of a bound that is used".to_owned()
        }
    },
    judge: |trial| {
        let history = trial.context.scenario.start.history[0].iter().rev().skip(1).map_while(|f| *f);
        let mut track: Vec<AgentState> = history.collect();
        track.reverse();
        track.extend(&trial.candidate.track);
        let (share, name) = largest_share(&track);
        Verdict::new(Some(share), !trial.settings.comfort || share <= 1.0, || {
            format!("{name}: {share:.2} of the bound")
        })
    },
};

/// Returns the largest share of a bound that is used, and the name of the bound.
fn largest_share(track: &[AgentState]) -> (f64, &'static str) {
    let span = 2.0 * HALF_WINDOW as f64 * DT;
    let difference = |values: &[Vec2]| -> Vec<Vec2> {
        values.windows(2 * HALF_WINDOW + 1).map(|w| (w[2 * HALF_WINDOW] - w[0]) / span).collect()
    };
    let positions: Vec<Vec2> = track.iter().map(AgentState::position).collect();
    let velocities = difference(&positions);
    let accelerations = difference(&velocities);
    let jerks = difference(&accelerations);
    let yaw_rates: Vec<f64> = track
        .windows(2 * HALF_WINDOW + 1)
        .map(|w| wrap(w[2 * HALF_WINDOW].heading - w[0].heading) / span)
        .collect();
    let yaw_accelerations =
        yaw_rates.windows(2 * HALF_WINDOW + 1).map(|w| (w[2 * HALF_WINDOW] - w[0]) / span);
    let mut worst = (0.0, "");
    let mut take = |value: f64, bound: f64, name: &'static str| {
        let share = value / bound;
        if share > worst.0 {
            worst = (share, name);
        }
    };
    let axis = |k: usize| direction(track[k].heading);
    for (i, a) in accelerations.iter().enumerate() {
        let ahead = axis(i + 2 * HALF_WINDOW);
        let along = a.dot(&ahead);
        take(along.max(0.0), MAX_LONGITUDINAL_ACCELERATION, "acceleration");
        take((-along).max(0.0), -MIN_LONGITUDINAL_ACCELERATION, "braking");
        take(a.dot(&left(ahead)).abs(), MAX_LATERAL_ACCELERATION, "lateral acceleration");
    }
    for (i, j) in jerks.iter().enumerate() {
        take(j.norm(), MAX_JERK, "jerk");
        take(j.dot(&axis(i + 3 * HALF_WINDOW)).abs(), MAX_LONGITUDINAL_JERK, "longitudinal jerk");
    }
    yaw_rates.iter().for_each(|r| take(r.abs(), MAX_YAW_RATE, "yaw rate"));
    yaw_accelerations.for_each(|r| take(r.abs(), MAX_YAW_ACCELERATION, "yaw acceleration"));
    worst
}
