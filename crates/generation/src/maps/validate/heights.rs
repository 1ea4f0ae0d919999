//! Checks of heights.

use super::survey::{Survey, TracedLane};
use super::{Flaws, Rule};

/// Maximum slope of lanes, metres per metre.
const MAX_SLOPE: f64 = 0.05;
/// Maximum difference of the heights of linked lanes at their joint, metres.
const JOIN_TOLERANCE: f64 = 0.001;

pub(super) fn check(survey: &Survey<'_>, flaws: &mut Flaws) {
    for lane in &survey.lanes {
        slope(lane, flaws);
        for next in lane.part.successors.iter().map(|id| survey.lane(id)) {
            let (Some(end), Some(start)) = (lane.heights.last(), next.heights.first()) else { continue };
            if !((end - start).abs() <= JOIN_TOLERANCE) {
                let found = format!("ends at {end:.3} m, `{}` begins at {start:.3} m", next.id());
                flaws.add(Rule::Height, lane.id(), lane.end(), found);
            }
        }
    }
}

fn slope(lane: &TracedLane<'_>, flaws: &mut Flaws) {
    let steps = lane.heights.windows(2).zip(lane.line.arc().windows(2));
    let slopes = steps.map(|(z, s)| (z[1] - z[0]) / (s[1] - s[0]));
    if let Some((i, slope)) = slopes.enumerate().find(|(_, slope)| !(slope.abs() <= MAX_SLOPE)) {
        let found = format!("rises by {:.1} %, expected at most 5 %", 100.0 * slope);
        flaws.add(Rule::Height, lane.id(), lane.line.points()[i], found);
    }
}
