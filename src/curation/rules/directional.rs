//! Another way over the lane graph, at a speed that its bends allow.

use rand::RngExt;

use super::survey::{LATERAL, Survey};
use super::{Draft, between};
use crate::dynamics::{AxlePath, Departure, Pose, speeds};
use crate::rollout::Stream;
use crate::scene::{DT, FUTURE};

pub(super) fn draw(survey: &Survey<'_>, stream: &mut Stream) -> Result<Draft, String> {
    if survey.branches.is_empty() {
        return Err("no other way over the lane graph".into());
    }
    let branch = &survey.branches[stream.random_range(0..survey.branches.len())];
    let (now, speed) = (survey.now(), survey.speed());
    // Cruise somewhere between walking and the limit, rather near the speed now.
    let cruise = (speed.max(4.0) * between(stream, 0.5, 1.5)).clamp(3.0, survey.limit.clamp(4.0, 16.0));
    let gain = between(stream, 1.2, 2.5);
    let wait = if speed < 1.0 {
        between(stream, 0.0, 3.0)
    } else if stream.random_bool(0.3) {
        between(stream, 0.5, 2.5)
    } else {
        0.0
    };
    let log = survey.drive.speeds();
    let mut desired: Vec<f64> = (1..=FUTURE)
        .map(|k| if (k as f64) * DT < wait { log[k].min(speed.max(0.0)) } else { cruise })
        .collect();
    speeds::bound(speed, &mut desired, gain, 3.0);
    speeds::soften(speed, &mut desired);
    let travel = desired.iter().sum::<f64>() * DT;
    let from = Departure {
        pose: Pose { position: now.position(), heading: now.heading },
        rear: survey.rear(),
        reverse: false,
        curvature: Some(survey.curvature),
    };
    let mut path = AxlePath::trace(&branch.guide, &from, travel + 10.0, |_| 0.5 * (speed + cruise));
    path.limit_lateral(LATERAL);
    if travel > branch.length {
        path.stop_at(branch.length);
    }
    let waits = if wait > 0.0 { format!(" after {wait:.1} s") } else { String::new() };
    let maneuver = format!("{} at {cruise:.0} m/s{waits}", branch.name());
    Ok(Draft { maneuver, future: survey.follow(&path, &desired) })
}
