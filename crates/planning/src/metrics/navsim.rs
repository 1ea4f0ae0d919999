//! PDMS and EPDMS, the scores of NAVSIM v1 and v2, on the history of a closed loop.
//!
//! Source: autonomousvision/navsim, `PDMScorer` of commit 0a380a9 (v2) and of commit 0811876 (v1.1). NAVSIM
//! scores one plan that is tracked for 4 s while logged traffic goes by; here the scores are computed on the
//! driven history, whatever its length and traffic. The values are therefore not comparable with published
//! ones. Further differences:
//!
//! * Progress is relative to PDM-Closed, which has to drive the same scenario: its progress is an input.
//! * Extended comfort compares successive plans, which a history does not contain: it is always undefined,
//!   and the weights of the other metrics are scaled up, as in NAVSIM's score of a single plan.
//! * The second stage of v2 starts planners in recorded follow-ups of the scene. There is none here.
//! * The time to collision is judged up to 0.9 s before the end, in v1 as well, because objects are not known
//!   afterwards. The filter of comfort in v1 has a window as long as the history.
//! * An object is stopped by its speed at the contact. NAVSIM takes the speed at which it first appears.
//! * NAVSIM pads history comfort with 1.5 s of the log, without the last 0.1 s; here with all states given.

use std::collections::BTreeSet;

use reactsim_geometry::OrientedBox;

use crate::contact::{Side, in_contact, moved, side_of};
use crate::path::Path;
use crate::planner::{Light, LightState, Route};
use crate::shapes::box_touches_ring;
use crate::{EgoState, ObjectGroup, ObjectId, STEP};

use super::comfort::comfort;
use super::score::combined;
use super::{
    ContactClass, Corner, History, HistoryError, MetricRole, MetricValue, PlannerScores, SmoothedComfort,
    UndefinedReason,
};

/// Value of collisions with static objects that are the fault of ego, however many there are (navsim
/// 0a380a9).
const OBJECT_VALUE: f64 = 0.5;
/// Distance in metres in oncoming traffic, within one horizon, below which the value is 1 (navsim 0a380a9).
const DIRECTION_COMPLIANCE: f64 = 2.0;
/// Distance in metres in oncoming traffic, within one horizon, from which the value is 0 (navsim 0a380a9).
const DIRECTION_VIOLATION: f64 = 6.0;
/// Value between the two distances (navsim 0a380a9).
const DIRECTION_PARTIAL: f64 = 0.5;
/// Number of samples of the horizon of 1 s. Sums are over one increment more, 1.1 s (navsim 0a380a9).
const DIRECTION_SAMPLES: usize = 10;
/// Samples ahead at which ego is projected for the time to collision: 0, 0.3, 0.6 and 0.9 s (navsim 0a380a9).
const TTC_STEPS: [usize; 4] = [0, 3, 6, 9];
/// Speed in m/s below which ego has no time to collision (navsim 0a380a9, `stopped_speed_threshold`).
const TTC_SPEED: f64 = 5e-3;
/// Distance in metres from the centre line that counts as a deviation (navsim 0a380a9,
/// `lane_keeping_deviation_limit`).
const MAX_DEVIATION: f64 = 0.5;
/// Number of successive samples with a deviation that fail lane keeping: 2 s (navsim 0a380a9,
/// `lane_keeping_horizon_window`).
const DEVIATION_SAMPLES: usize = 20;
/// Progress in metres up to which progress is not compared (navsim 0a380a9 and 0811876,
/// `progress_distance_threshold`; 0.1 in v1.0).
const PROGRESS_THRESHOLD: f64 = 5.0;

/// A sub-metric of NAVSIM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum NavsimMetric {
    /// Collisions that are the fault of ego: 1, 0.5 or 0.
    Collisions,
    /// Corners of ego on drivable ground, without tolerance: 1 or 0.
    DrivableArea,
    /// Motion outside the lanes of the route: 1, 0.5 or 0.
    DrivingDirection,
    /// Connectors of the route entered while their light is red: 1 or 0.
    TrafficLights,
    /// Progress along the centre line, relative to PDM-Closed: 0 to 1.
    Progress,
    /// No projected contact within 0.9 s: 1 or 0.
    TimeToCollision,
    /// Distance from the centre line: 1 or 0.
    LaneKeeping,
    /// Comfort of v1, smoothed over the whole history: 1 or 0.
    Comfort,
    /// Comfort of v2, together with the states before the history: 1 or 0.
    HistoryComfort,
    /// Similarity of successive plans; undefined.
    ExtendedComfort,
}

/// The version of a score of NAVSIM.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum NavsimVersion {
    /// PDMS.
    V1,
    /// EPDMS.
    V2,
}

impl NavsimMetric {
    /// Returns the id used in files and tables.
    pub const fn id(self) -> &'static str {
        match self {
            Self::Collisions => "navsim-at-fault-collisions",
            Self::DrivableArea => "navsim-drivable-area",
            Self::DrivingDirection => "navsim-driving-direction",
            Self::TrafficLights => "navsim-traffic-lights",
            Self::Progress => "navsim-progress",
            Self::TimeToCollision => "navsim-time-to-collision",
            Self::LaneKeeping => "navsim-lane-keeping",
            Self::Comfort => "navsim-comfort",
            Self::HistoryComfort => "navsim-history-comfort",
            Self::ExtendedComfort => "navsim-extended-comfort",
        }
    }

    /// Returns whether EPDMS counts the metric as 1 if the human driver fails it. The human drive has no
    /// history comfort in NAVSIM, and its progress is relative to itself.
    const fn is_filtered(self) -> bool {
        !matches!(self, Self::Progress | Self::Comfort | Self::HistoryComfort | Self::ExtendedComfort)
    }
}

impl NavsimVersion {
    /// Returns the id of the score: `pdms` or `epdms`.
    pub const fn id(self) -> &'static str {
        match self {
            Self::V1 => "pdms",
            Self::V2 => "epdms",
        }
    }

    /// Returns the metrics with their roles: the multipliers, then the weighted metrics.
    pub const fn metrics(self) -> &'static [(NavsimMetric, MetricRole)] {
        use MetricRole::{Multiplier, Weighted};
        use NavsimMetric as M;
        match self {
            Self::V1 => &[
                (M::Collisions, Multiplier),
                (M::DrivableArea, Multiplier),
                (M::Progress, Weighted(5.0)),
                (M::TimeToCollision, Weighted(5.0)),
                (M::Comfort, Weighted(2.0)),
            ],
            Self::V2 => &[
                (M::Collisions, Multiplier),
                (M::DrivableArea, Multiplier),
                (M::DrivingDirection, Multiplier),
                (M::TrafficLights, Multiplier),
                (M::Progress, Weighted(5.0)),
                (M::TimeToCollision, Weighted(5.0)),
                (M::LaneKeeping, Weighted(2.0)),
                (M::HistoryComfort, Weighted(2.0)),
                (M::ExtendedComfort, Weighted(2.0)),
            ],
        }
    }
}

/// The input of the scores of NAVSIM.
#[derive(Clone, Copy, Debug)]
pub struct NavsimInput<'a> {
    /// The driven scenario. The expert is not used.
    pub history: &'a History<'a>,
    /// Its nuPlan metrics: [`judge`](super::judge) of `history`.
    pub scores: &'a PlannerScores,
    /// Route of ego; `None` if it is unknown.
    pub route: Option<&'a Route>,
    /// Centre line of the route: [`pdm::centerline`](crate::pdm::centerline) at sample 0.
    pub centerline: Option<&'a Path>,
    /// Traffic lights per sample; `None` if they are not recorded.
    pub lights: Option<&'a [Vec<Light>]>,
    /// States of ego before sample 0 at intervals of 0.1 s, oldest first; empty if they are not recorded.
    pub past: &'a [EgoState],
}

/// The sub-metrics of NAVSIM of one driven scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct NavsimScores {
    /// Values of the metrics that do not depend on other drives.
    values: Vec<(NavsimMetric, MetricValue)>,
    /// Progress of the centre of ego along the centre line, metres, at least 0; `None` without centre line.
    pub progress_distance: Option<f64>,
}

/// A score of NAVSIM.
#[derive(Clone, Debug, PartialEq)]
pub struct NavsimScore {
    /// The score, 0 to 1, by the defined metrics. The weights of the others are left out.
    pub value: f64,
    /// Values of the metrics, in the order of [`NavsimVersion::metrics`].
    pub values: Vec<(NavsimMetric, MetricValue)>,
    /// Metrics that count as 1 because the human driver fails them.
    pub filtered: Vec<NavsimMetric>,
}

impl NavsimScore {
    /// Returns the undefined metrics with reasons. Scores with different undefined metrics are not
    /// comparable.
    pub fn undefined(&self) -> impl Iterator<Item = (NavsimMetric, UndefinedReason)> + '_ {
        self.values.iter().filter_map(|&(metric, value)| match value {
            MetricValue::Undefined(reason) => Some((metric, reason)),
            MetricValue::Defined(_) => None,
        })
    }
}

impl NavsimScores {
    /// Returns the value of a metric. Progress has no value before it is compared.
    pub fn value(&self, metric: NavsimMetric) -> MetricValue {
        let found = self.values.iter().find(|(other, _)| *other == metric);
        found.map_or(MetricValue::Undefined(UndefinedReason::NoReferenceProgress), |(_, value)| *value)
    }

    /// Returns the progress, metres, multiplied by the multipliers of a version. The result of PDM-Closed is
    /// the reference of other planners. `None` if a factor is undefined.
    pub fn masked_progress(&self, version: NavsimVersion) -> Option<f64> {
        Some(self.progress_distance? * self.product(version)?)
    }

    /// Returns PDMS. `reference_progress`: [`Self::masked_progress`] of PDM-Closed in the same scenario,
    /// metres.
    pub fn pdms(&self, reference_progress: Option<f64>) -> NavsimScore {
        self.score(NavsimVersion::V1, reference_progress, None)
    }

    /// Returns EPDMS of one stage. `reference_progress`: as for [`Self::pdms`]. `human`: the logged drive
    /// among logged objects; without it no metric is filtered.
    pub fn epdms(&self, reference_progress: Option<f64>, human: Option<&Self>) -> NavsimScore {
        self.score(NavsimVersion::V2, reference_progress, human)
    }

    fn score(
        &self,
        version: NavsimVersion,
        reference_progress: Option<f64>,
        human: Option<&Self>,
    ) -> NavsimScore {
        let fails = |metric| human.is_some_and(|human| human.value(metric) == MetricValue::Defined(0.0));
        let (mut values, mut filtered) = (Vec::new(), Vec::new());
        for &(metric, _) in version.metrics() {
            let value = match metric {
                NavsimMetric::Progress => self.progress(version, reference_progress),
                metric if metric.is_filtered() && fails(metric) => {
                    filtered.push(metric);
                    MetricValue::Defined(1.0)
                }
                metric => self.value(metric),
            };
            values.push((metric, value));
        }
        let roles = version.metrics().iter().map(|(_, role)| *role);
        let value = combined(values.iter().map(|(_, value)| *value).zip(roles));
        NavsimScore { value, values, filtered }
    }

    /// Returns the product of the multipliers; `None` if one is undefined.
    fn product(&self, version: NavsimVersion) -> Option<f64> {
        let multipliers = version.metrics().iter().filter(|(_, role)| *role == MetricRole::Multiplier);
        multipliers.map(|&(metric, _)| self.value(metric).value()).product()
    }

    /// Returns the progress relative to the larger one of ego and PDM-Closed. v1 compares progress multiplied
    /// by the multipliers, v2 the progress itself.
    fn progress(&self, version: NavsimVersion, reference_progress: Option<f64>) -> MetricValue {
        let Some(distance) = self.progress_distance else {
            return MetricValue::Undefined(UndefinedReason::NoCenterline);
        };
        let Some(reference) = reference_progress else {
            return MetricValue::Undefined(UndefinedReason::NoReferenceProgress);
        };
        let Some(product) = self.product(version) else {
            return MetricValue::Undefined(UndefinedReason::UndefinedMultiplier);
        };
        let masked = distance * product;
        let largest = masked.max(reference);
        let is_compared = largest > PROGRESS_THRESHOLD;
        MetricValue::Defined(match version {
            NavsimVersion::V1 if is_compared => masked / largest,
            NavsimVersion::V2 if is_compared => (distance / largest).min(1.0),
            NavsimVersion::V1 if product == 0.0 => 0.0,
            NavsimVersion::V1 | NavsimVersion::V2 => 1.0,
        })
    }
}

/// Computes the sub-metrics of NAVSIM.
///
/// # Errors
/// [`HistoryError`] if the history or the past cannot be judged, or the lights are not given per sample.
///
/// # Panics
/// May panic if the nuPlan metrics of the input belong to another history.
pub fn judge_navsim(input: &NavsimInput<'_>) -> Result<NavsimScores, HistoryError> {
    input.history.check()?;
    let samples = input.history.ego.len();
    if let Some(lights) = input.lights.filter(|lights| lights.len() != samples) {
        return Err(HistoryError::Lights { ego: samples, lights: lights.len() });
    }
    if let Some(sample) = input.past.iter().position(|state| !state.is_finite()) {
        return Err(HistoryError::NotFinite { who: "ego before the history", sample });
    }
    let drive = Drive::new(input);
    let values = vec![
        (NavsimMetric::Collisions, drive.collisions()),
        (NavsimMetric::DrivableArea, drive.drivable_area()),
        (NavsimMetric::DrivingDirection, drive.driving_direction()),
        (NavsimMetric::TrafficLights, drive.traffic_lights()),
        (NavsimMetric::TimeToCollision, MetricValue::pass(!drive.has_short_ttc())),
        (NavsimMetric::LaneKeeping, drive.lane_keeping()),
        (
            NavsimMetric::Comfort,
            MetricValue::pass(SmoothedComfort::new(samples).is_comfortable(input.history.ego)),
        ),
        (NavsimMetric::HistoryComfort, history_comfort(input)),
        (NavsimMetric::ExtendedComfort, MetricValue::Undefined(UndefinedReason::SuccessivePlans)),
    ];
    let progress_distance = input.centerline.map(|centerline| {
        let [first, last] = [0, samples - 1].map(|k| centerline.project(drive.footprints[k].center));
        (last - first).max(0.0)
    });
    Ok(NavsimScores { values, progress_distance })
}

/// Judges the comfort of the past and the history by nuPlan's bounds and filters.
fn history_comfort(input: &NavsimInput<'_>) -> MetricValue {
    if input.past.is_empty() {
        return MetricValue::Undefined(UndefinedReason::NoPast);
    }
    let states: Vec<EgoState> = input.past.iter().chain(input.history.ego).copied().collect();
    comfort(&states, &input.history.shape).value
}

/// A drive with its boxes.
struct Drive<'a> {
    input: &'a NavsimInput<'a>,
    footprints: Vec<OrientedBox>,
    /// Lanes of the route, if it is known.
    on_route: Option<BTreeSet<usize>>,
}

impl<'a> Drive<'a> {
    fn new(input: &'a NavsimInput<'a>) -> Self {
        let history = input.history;
        let footprints = (0..history.ego.len()).map(|k| history.footprint(k)).collect();
        let on_route = input.route.map(|route| route.lanes(history.map).into_iter().collect());
        Self { input, footprints, on_route }
    }

    /// Judges the first contact with each object.
    fn collisions(&self) -> MetricValue {
        let mut score = 1.0_f64;
        for contact in &self.input.scores.collisions.contacts {
            let is_at_fault = match contact.class {
                ContactClass::StoppedEgo | ContactClass::ActiveRear => false,
                ContactClass::StoppedTrack | ContactClass::ActiveFront => true,
                ContactClass::ActiveLateral => match self.is_across_lanes_or_off_road(contact.step) {
                    Ok(is_across) => is_across,
                    Err(reason) => return MetricValue::Undefined(reason),
                },
            };
            if is_at_fault {
                let is_object = contact.kind.group() == ObjectGroup::Object;
                score = score.min(if is_object { OBJECT_VALUE } else { 0.0 });
            }
        }
        MetricValue::Defined(score)
    }

    fn drivable_area(&self) -> MetricValue {
        let inside = &self.input.scores.drivable_area.corners_inside;
        if inside.is_empty() {
            return MetricValue::Undefined(UndefinedReason::NoDrivableArea);
        }
        MetricValue::pass(inside.iter().all(|&inside| inside))
    }

    /// Returns whether corners of ego are in several lanes of which none contains all, or one is off the
    /// road.
    fn is_across_lanes_or_off_road(&self, step: usize) -> Result<bool, UndefinedReason> {
        let map = self.input.history.map;
        if map.lanes().is_empty() {
            return Err(UndefinedReason::LateralContactWithoutLanes);
        }
        let corners = Corner::ALL.map(|corner| map.lanes_at(corner.of(&self.footprints[step])));
        let touched: BTreeSet<usize> = corners.iter().flatten().copied().collect();
        let contains_all = |lane: &usize| corners.iter().all(|lanes| lanes.contains(lane));
        if touched.len() > 1 && !touched.iter().any(contains_all) {
            return Ok(true);
        }
        let inside = self.input.scores.drivable_area.corners_inside.get(step);
        inside.map(|inside| !inside).ok_or(UndefinedReason::NoDrivableArea)
    }

    /// Judges the distance that the centre drives outside the lanes of the route and intersections, within
    /// the horizon that ends at each sample.
    fn driving_direction(&self) -> MetricValue {
        let map = self.input.history.map;
        if map.lanes().is_empty() {
            return MetricValue::Undefined(UndefinedReason::NoLanes);
        }
        let Some(on_route) = &self.on_route else { return MetricValue::Undefined(UndefinedReason::NoRoute) };
        let mut increments = vec![0.0];
        for pair in self.footprints.windows(2) {
            let center = pair[1].center;
            let Some(in_intersection) = map.in_intersection(center) else {
                return MetricValue::Undefined(UndefinedReason::UnknownIntersections);
            };
            let is_oncoming =
                !in_intersection && !map.lanes_at(center).iter().any(|lane| on_route.contains(lane));
            increments.push(if is_oncoming { (center - pair[0].center).norm() } else { 0.0 });
        }
        let horizon = |k: usize| &increments[k.saturating_sub(DIRECTION_SAMPLES)..=k];
        let largest = (0..increments.len()).map(|k| horizon(k).iter().sum()).fold(0.0, f64::max);
        MetricValue::Defined(match largest {
            largest if largest < DIRECTION_COMPLIANCE => 1.0,
            largest if largest < DIRECTION_VIOLATION => DIRECTION_PARTIAL,
            _ => 0.0,
        })
    }

    /// Judges whether ego touches a connector of the route while its light is red, even if it entered before.
    fn traffic_lights(&self) -> MetricValue {
        let Some(lights) = self.input.lights else {
            return MetricValue::Undefined(UndefinedReason::NoTrafficLights);
        };
        let Some(on_route) = &self.on_route else { return MetricValue::Undefined(UndefinedReason::NoRoute) };
        let map = self.input.history.map;
        let is_violated = |footprint: &OrientedBox, light: &Light| {
            light.state == LightState::Red
                && on_route.contains(&light.lane)
                && box_touches_ring(footprint, map.lane_area(light.lane).outline())
        };
        let mut samples = self.footprints.iter().zip(lights);
        let is_any_violated =
            samples.any(|(footprint, lights)| lights.iter().any(|light| is_violated(footprint, light)));
        MetricValue::pass(!is_any_violated)
    }

    /// Returns whether ego, projected at constant speed, meets an object where it will be, and has to observe
    /// it. An object that it meets first without having to observe it is ignored afterwards.
    fn has_short_ttc(&self) -> bool {
        let history = self.input.history;
        let mut ignored: BTreeSet<&ObjectId> = BTreeSet::new();
        let last = TTC_STEPS[TTC_STEPS.len() - 1];
        for step in 0..self.footprints.len().saturating_sub(last) {
            let speed = history.ego[step].speed();
            if speed < TTC_SPEED {
                continue;
            }
            for ahead in TTC_STEPS {
                let projected = moved(&self.footprints[step], speed * STEP * ahead as f64);
                for object in &history.objects[step + ahead] {
                    if !in_contact(&projected, &object.footprint()) || ignored.contains(&object.id) {
                        continue;
                    }
                    if self.has_to_observe(step, side_of(&history.ego[step], object.center)) {
                        return true;
                    }
                    ignored.insert(&object.id);
                }
            }
        }
        false
    }

    /// Returns whether ego has to observe an object: ahead, or not behind where ego is across lanes, off the
    /// road or in an intersection. Unknown ground does not count.
    fn has_to_observe(&self, step: usize, side: Side) -> bool {
        let rear_axle = self.input.history.ego[step].rear_axle();
        match side {
            Side::Ahead => true,
            Side::Behind => false,
            Side::Lateral => {
                self.is_across_lanes_or_off_road(step).unwrap_or(false)
                    || self.input.history.map.in_intersection(rear_axle).unwrap_or(false)
            }
        }
    }

    /// Judges the deviations of the centre from the centre line. Samples in intersections are left out: they
    /// neither count nor interrupt a sequence.
    fn lane_keeping(&self) -> MetricValue {
        let Some(centerline) = self.input.centerline else {
            return MetricValue::Undefined(UndefinedReason::NoCenterline);
        };
        let mut successive = 0;
        for footprint in &self.footprints {
            match self.input.history.map.in_intersection(footprint.center) {
                None => return MetricValue::Undefined(UndefinedReason::UnknownIntersections),
                Some(true) => continue,
                Some(false) => {}
            }
            let deviates = centerline.distance(footprint.center) > MAX_DEVIATION;
            successive = if deviates { successive + 1 } else { 0 };
            if successive >= DEVIATION_SAMPLES {
                return MetricValue::pass(false);
            }
        }
        MetricValue::pass(true)
    }
}
