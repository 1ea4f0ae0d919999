//! Measures of ego at one sample while it drives, by the rules of the metrics.

use std::collections::BTreeSet;
use std::slice;
use std::sync::OnceLock;

use reactsim_geometry::Vec2;

use crate::{EgoShape, EgoState, ObjectId, PlanningMap, TrackedObject};

use super::collisions::{FirstContact, collisions};
use super::comfort::{ComfortFilters, is_comfortable_now};
use super::context::Context;
use super::drivable_area::drivable_area;
use super::time_to_collision::{PROJECTION_HORIZON, time_to_collision};
use super::{History, MIN_SAMPLES, MetricValue, MissingInputs};

/// Number of samples of ego from which its comfort is judged: the longest filter of the metric.
const COMFORT_SAMPLES: usize = 15;

/// Measures of ego at one sample. They use the past only, where the metrics of a finished history also use
/// later samples: lanes are found for this sample only, and filters end at it.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleScores {
    /// First contacts with objects at this sample; `step` is 0.
    pub contacts: Vec<FirstContact>,
    /// Time to collision, seconds; infinite if there is none.
    pub ttc: f64,
    /// Whether a corner is too far off the road; `None` if the map has no drivable area.
    pub is_off_road: Option<bool>,
    /// Whether accelerations, jerks and yaw rates are within the bounds of comfort; `None` with fewer than
    /// four samples.
    pub is_comfortable: Option<bool>,
}

/// The ground that an object must touch to have a contact with ego now or within the horizon of the time to
/// collision. Most objects do not.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    center: Vec2,
    /// Distance from the centre, metres, up to which standing points are touched.
    radius: f64,
}

impl Reach {
    /// Returns the reach of ego.
    pub fn of(ego: &EgoState, shape: &EgoShape) -> Self {
        let footprint = ego.footprint(shape);
        Self { center: footprint.center, radius: footprint.radius() + PROJECTION_HORIZON * ego.speed() }
    }

    /// Returns whether a box with these sides, metres, and this velocity, m/s, may touch the ground.
    pub fn includes(&self, center: Vec2, length: f64, width: f64, velocity: Vec2) -> bool {
        let reach = self.radius + 0.5 * (length + width) + PROJECTION_HORIZON * velocity.norm();
        (center - self.center).norm() <= reach
    }
}

/// Judges the samples of one rollout in turn.
#[derive(Clone, Debug)]
pub struct SampleJudge {
    collided: BTreeSet<ObjectId>,
    /// The last samples of ego.
    ego: Vec<EgoState>,
}

/// Filters of comfort for each number of samples, made at first use.
static FILTERS: [OnceLock<ComfortFilters>; COMFORT_SAMPLES + 1] =
    [const { OnceLock::new() }; COMFORT_SAMPLES + 1];

impl SampleJudge {
    /// Creates a judge; `past` are the states of ego before the first sample, oldest first.
    pub fn new(mut past: Vec<EgoState>) -> Self {
        past.drain(..past.len().saturating_sub(COMFORT_SAMPLES));
        Self { collided: BTreeSet::new(), ego: past }
    }

    /// Judges the next sample. Objects that were hit before do not count, as in the metrics, and those beyond
    /// the [`Reach`] of ego may be left out.
    pub fn judge(
        &mut self,
        map: &PlanningMap,
        shape: EgoShape,
        ego: EgoState,
        mut objects: Vec<TrackedObject>,
    ) -> SampleScores {
        self.ego.push(ego);
        self.ego.drain(..self.ego.len().saturating_sub(COMFORT_SAMPLES));
        objects.retain(|object| !self.collided.contains(&object.id));
        let present = History {
            map,
            shape,
            ego: slice::from_ref(&ego),
            expert: None,
            objects: slice::from_ref(&objects),
            missing: MissingInputs::Undefined,
        };
        let context = Context::new(&present);
        let found = collisions(&context);
        let ttc = time_to_collision(&context, &found).ttc.first().copied().unwrap_or(f64::INFINITY);
        self.collided.extend(found.contacts.iter().map(|contact| contact.object.clone()));
        let is_off_road = match drivable_area(&context).value {
            MetricValue::Defined(value) => Some(value < 1.0),
            MetricValue::Undefined(_) => None,
        };
        SampleScores {
            contacts: found.contacts,
            ttc,
            is_off_road,
            is_comfortable: self.is_comfortable(&shape),
        }
    }

    fn is_comfortable(&self, shape: &EgoShape) -> Option<bool> {
        let samples = self.ego.len();
        let filters = || FILTERS[samples].get_or_init(|| ComfortFilters::new(samples));
        (samples >= MIN_SAMPLES).then(|| is_comfortable_now(&self.ego, shape, filters()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::STEP;
    use crate::fixtures::{car, straight_road};
    use crate::metrics::judge;

    #[test]
    fn samples_have_the_contacts_and_times_of_the_history() {
        let (map, shape) = (straight_road(None), EgoShape::PACIFICA);
        let at = |k: i32| {
            let (time, x) = (STEP * f64::from(k), 20.0 + 0.8 * f64::from(k));
            EgoState { time, vx: 8.0, ..EgoState::standing(Vec2::new(x, 1.75), 0.0) }
        };
        let ego: Vec<EgoState> = (0..40).map(at).collect();
        let all = vec![car("stopped", 40.0, 1.75, 0.0), car("far", 180.0, 1.75, 0.0)];
        let objects = vec![all; ego.len()];
        let history = History {
            map: &map,
            shape,
            ego: &ego,
            expert: None,
            objects: &objects,
            missing: MissingInputs::Undefined,
        };
        let whole = judge(&history).unwrap();
        let mut one_by_one = SampleJudge::new(Vec::new());
        let judged = |(ego, objects): (&EgoState, &Vec<TrackedObject>)| {
            let reach = Reach::of(ego, &shape);
            let is_near = |o: &&TrackedObject| reach.includes(o.center, o.length, o.width, o.velocity);
            let near: Vec<_> = objects.iter().filter(is_near).cloned().collect();
            assert!(near.len() < objects.len());
            one_by_one.judge(&map, shape, *ego, near)
        };
        let samples: Vec<SampleScores> = ego.iter().zip(&objects).map(judged).collect();
        let ttc: Vec<f64> = samples.iter().map(|sample| sample.ttc).collect();
        assert_eq!(ttc, whole.time_to_collision.ttc);
        let hits: Vec<usize> = (0..samples.len()).filter(|&k| !samples[k].contacts.is_empty()).collect();
        assert_eq!(hits, [whole.collisions.contacts[0].step]);
        assert_eq!(samples[hits[0]].contacts[0].at_fault, Some(true));
        assert_eq!(samples[MIN_SAMPLES - 2].is_comfortable, None);
        assert_eq!(samples[MIN_SAMPLES - 1].is_comfortable, Some(true));
        assert!(samples.iter().all(|sample| sample.is_off_road.is_none()));
    }
}
