//! Scores of simulated proposals (tuplan_garage b51d5d0, `PDMScorer`).

use std::ops::Range;

use reactsim_geometry::{Bounds, OrientedBox, Vec2};

use super::areas::{DrivableLanes, GroundFlags};
use super::forecast::{Forecast, Obstacle, ObstacleKind};
use crate::contact::{STOPPED_SPEED, Side, classify, moved, side_of};
use crate::metrics::{ContactClass, SmoothedComfort};
use crate::path::Path;
use crate::trajectory::STEP;
use crate::{EgoShape, EgoState, PlanningMap};

/// Weight of the progress (tuplan_garage b51d5d0).
const PROGRESS_WEIGHT: f64 = 5.0;
/// Weight of the time to collision (tuplan_garage b51d5d0).
const TTC_WEIGHT: f64 = 5.0;
/// Weight of comfort (tuplan_garage b51d5d0).
const COMFORT_WEIGHT: f64 = 2.0;
/// Score of at-fault collisions with agents; with static objects it is [`OBJECT_SCORE`] (tuplan_garage
/// b51d5d0).
const AGENT_SCORE: f64 = 0.0;
/// Score of at-fault collisions with static objects, however many there are (tuplan_garage b51d5d0).
const OBJECT_SCORE: f64 = 0.5;
/// Speed in m/s below which ego has no time to collision (tuplan_garage b51d5d0,
/// `STOPPED_SPEED_THRESHOLD`).
const TTC_SPEED: f64 = 5e-3;
/// Steps ahead at which ego is projected for the time to collision: 0, 0.3, 0.6 and 0.9 s (tuplan_garage
/// b51d5d0).
const TTC_STEPS: [usize; 4] = [0, 3, 6, 9];
/// The last of [`TTC_STEPS`].
const LAST_TTC_STEP: usize = TTC_STEPS[TTC_STEPS.len() - 1];
/// Number of steps of a drive per bounding box.
const CHUNK: usize = 6;
/// Distance off the route, metres, that scores 1 below it (tuplan_garage b51d5d0).
const DIRECTION_COMPLIANCE: f64 = 2.0;
/// Distance off the route, metres, that scores 0.5 below it and 0 otherwise (tuplan_garage b51d5d0).
const DIRECTION_VIOLATION: f64 = 6.0;
/// Progress in metres up to which progress is not compared (tuplan_garage b51d5d0,
/// `PROGRESS_DISTANCE_THRESHOLD`).
const PROGRESS_THRESHOLD: f64 = 0.1;

/// The parts of the scores of all proposals, and the scores.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scores {
    /// At-fault collisions: 1 for none, 0.5 with static objects only, 0 with agents.
    pub no_collision: Vec<f64>,
    /// 1 if all corners are in lanes at all steps, otherwise 0.
    pub drivable_area: Vec<f64>,
    /// Compliance with the direction of the route: 1, 0.5 or 0.
    pub driving_direction: Vec<f64>,
    /// Progress of the centre along the centre line, metres.
    pub progress_distance: Vec<f64>,
    /// Progress relative to the best proposal, 0 to 1.
    pub progress: Vec<f64>,
    /// 1 if no contact is projected within 0.9 s, otherwise 0.
    pub ttc: Vec<f64>,
    /// 1 if all comfort bounds are met, otherwise 0.
    pub comfortable: Vec<f64>,
    /// Time to the first at-fault collision, seconds; infinite for none.
    pub collision_time: Vec<f64>,
    /// Scores, 0 to 1.
    pub total: Vec<f64>,
}

/// The inputs by which simulated proposals are judged.
#[derive(Debug)]
pub(super) struct Scorer<'a> {
    pub(super) shape: &'a EgoShape,
    pub(super) map: &'a PlanningMap,
    pub(super) lanes: &'a DrivableLanes<'a>,
    pub(super) forecast: &'a Forecast,
    pub(super) centerline: &'a Path,
    pub(super) comfort: &'a SmoothedComfort,
}

/// A simulated proposal with its boxes and the ground under them.
#[derive(Debug)]
struct Drive<'a> {
    states: &'a [EgoState],
    footprints: Vec<OrientedBox>,
    ground: Vec<GroundFlags>,
    /// Radius of the circumscribed circle of the boxes, metres.
    radius: f64,
    /// Bounds of the boxes and their projections of each [`CHUNK`] steps.
    chunks: Vec<Bounds>,
}

/// An obstacle that a drive or its projections may meet.
#[derive(Debug)]
struct NearObstacle<'a> {
    obstacle: &'a Obstacle,
    /// The steps at which they may.
    steps: Range<usize>,
}

impl Scorer<'_> {
    /// Scores simulated proposals.
    pub(super) fn score(&self, simulated: &[Vec<EgoState>]) -> Scores {
        let mut scores = Scores::default();
        for states in simulated {
            let drive = self.drive(states);
            let obstacles = self.obstacles_near(&drive);
            let collisions = self.collisions(&drive, &obstacles);
            scores.no_collision.push(collisions.score);
            scores.collision_time.push(collisions.first.map_or(f64::INFINITY, |step| step as f64 * STEP));
            scores.drivable_area.push(f64::from(drive.ground.iter().all(|ground| !ground.is_off_road)));
            scores.driving_direction.push(driving_direction(&drive));
            scores.progress_distance.push(self.progress(&drive));
            scores.ttc.push(f64::from(!self.has_short_ttc(&drive, &obstacles)));
            scores.comfortable.push(f64::from(self.comfort.is_comfortable(states)));
        }
        scores.aggregate();
        scores
    }

    fn drive<'a>(&self, states: &'a [EgoState]) -> Drive<'a> {
        let footprints: Vec<OrientedBox> = states.iter().map(|state| state.footprint(self.shape)).collect();
        let ground = self.lanes.under(&footprints);
        let radius = footprints[0].radius();
        let furthest = STEP * LAST_TTC_STEP as f64;
        let reached = |(state, footprint): (&EgoState, &OrientedBox)| {
            [footprint.center, moved(footprint, state.speed() * furthest).center]
        };
        let bounds = |(states, footprints): (&[EgoState], &[OrientedBox])| {
            Bounds::of(states.iter().zip(footprints).flat_map(reached)).inflated(radius)
        };
        let chunks = states.chunks(CHUNK).zip(footprints.chunks(CHUNK)).map(bounds).collect();
        Drive { states, radius, footprints, ground, chunks }
    }

    /// Returns the obstacles that a drive and its projections may meet; red connectors are not judged.
    fn obstacles_near<'a>(&'a self, drive: &Drive<'_>) -> Vec<NearObstacle<'a>> {
        let near = |obstacle: &'a Obstacle| {
            let is_near = |chunk: &usize| {
                let first = chunk * CHUNK;
                obstacle.swept(first, first + CHUNK - 1 + LAST_TTC_STEP).intersects(&drive.chunks[*chunk])
            };
            let first = (0..drive.chunks.len()).find(is_near)?;
            let last = (first..drive.chunks.len()).rfind(is_near)?;
            let steps = first * CHUNK..((last + 1) * CHUNK).min(drive.states.len());
            Some(NearObstacle { obstacle, steps })
        };
        let is_judged =
            |obstacle: &&Obstacle| !obstacle.ignored && obstacle.kind != ObstacleKind::RedConnector;
        self.forecast.obstacles.iter().filter(is_judged).filter_map(near).collect()
    }

    /// Judges the first contact with each obstacle. Later contacts do not change the result: obstacles
    /// are ignored after a contact that is not at fault, and of contacts at fault the first one counts.
    fn collisions(&self, drive: &Drive<'_>, obstacles: &[NearObstacle<'_>]) -> Collisions {
        let mut collisions = Collisions { score: 1.0, first: None };
        for NearObstacle { obstacle, steps } in obstacles {
            let reach = drive.radius + obstacle.radius;
            let contact = steps.clone().find_map(|step| {
                let other = obstacle.box_at(step)?;
                in_contact(&drive.footprints[step], &other, reach).then_some((step, other))
            });
            let Some((step, other)) = contact else { continue };
            if is_at_fault(drive, step, obstacle, &other) {
                let score = if obstacle.kind == ObstacleKind::Agent { AGENT_SCORE } else { OBJECT_SCORE };
                collisions.score = collisions.score.min(score);
                collisions.first = Some(collisions.first.map_or(step, |first| first.min(step)));
            }
        }
        collisions
    }

    /// Returns whether ego, projected at constant speed, meets an obstacle within 0.9 s that it has to
    /// observe. An obstacle that it meets first without having to observe it is ignored afterwards.
    fn has_short_ttc(&self, drive: &Drive<'_>, obstacles: &[NearObstacle<'_>]) -> bool {
        obstacles.iter().any(|NearObstacle { obstacle, steps }| {
            let contact = |step| projected_contact(drive, step, obstacle).map(|center| (step, center));
            steps
                .clone()
                .find_map(contact)
                .is_some_and(|(step, center)| self.has_to_observe(drive, step, center))
        })
    }

    /// Returns whether ego has to observe an object at `center`: ahead, or not behind where ego is not
    /// within one lane or in an intersection.
    fn has_to_observe(&self, drive: &Drive<'_>, step: usize, center: Vec2) -> bool {
        let state = &drive.states[step];
        match side_of(state, center) {
            Side::Ahead => true,
            Side::Behind => false,
            Side::Lateral => {
                let ground = drive.ground[step];
                let in_intersection = || self.map.in_intersection(state.rear_axle()).unwrap_or(false);
                ground.in_multiple_lanes || ground.is_off_road || in_intersection()
            }
        }
    }

    /// Returns the progress of the centre along the centre line, metres, at least 0.
    fn progress(&self, drive: &Drive<'_>) -> f64 {
        let project = |footprint: &OrientedBox| self.centerline.project(footprint.center);
        let (first, last) = (&drive.footprints[0], &drive.footprints[drive.footprints.len() - 1]);
        (project(last) - project(first)).max(0.0)
    }
}

impl Scores {
    /// Computes relative progress and scores from the other parts.
    fn aggregate(&mut self) {
        let products: Vec<f64> = (0..self.no_collision.len())
            .map(|i| self.no_collision[i] * self.driving_direction[i] * self.drivable_area[i])
            .collect();
        let progress: Vec<f64> = self
            .progress_distance
            .iter()
            .zip(&products)
            .map(|(distance, product)| distance * product)
            .collect();
        let largest = progress.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.progress = if largest > PROGRESS_THRESHOLD {
            progress.iter().map(|progress| progress / largest).collect()
        } else {
            products.iter().map(|&product| f64::from(product != 0.0)).collect()
        };
        let weights = PROGRESS_WEIGHT + TTC_WEIGHT + COMFORT_WEIGHT;
        let score = |i: usize| {
            let weighted = PROGRESS_WEIGHT * self.progress[i]
                + TTC_WEIGHT * self.ttc[i]
                + COMFORT_WEIGHT * self.comfortable[i];
            products[i] * (weighted / weights)
        };
        self.total = (0..products.len()).map(score).collect();
    }

    /// Returns the proposal with the largest score, the first one on ties.
    pub(super) fn best(&self) -> usize {
        let mut best = 0;
        for (i, score) in self.total.iter().enumerate() {
            if *score > self.total[best] {
                best = i;
            }
        }
        best
    }
}

/// The judgement of the contacts of one proposal.
#[derive(Clone, Copy, Debug)]
struct Collisions {
    score: f64,
    /// Step of the first contact at fault.
    first: Option<usize>,
}

/// Returns whether two boxes touch or overlap; `reach` is the sum of the radii of their circumscribed
/// circles, metres.
fn in_contact(a: &OrientedBox, b: &OrientedBox, reach: f64) -> bool {
    (b.center - a.center).norm_squared() <= reach * reach && a.separation(b) <= 0.0
}

/// Returns the centre of an obstacle at its first contact with ego, projected from a step at constant
/// speed.
fn projected_contact(drive: &Drive<'_>, step: usize, obstacle: &Obstacle) -> Option<Vec2> {
    let (speed, footprint) = (drive.states[step].speed(), &drive.footprints[step]);
    if speed < TTC_SPEED {
        return None;
    }
    // The forecast may be up to one step behind at both ends.
    let horizon = STEP * (LAST_TTC_STEP + 2) as f64;
    let other = obstacle.box_at(step)?;
    let reach = drive.radius + obstacle.radius;
    let far = reach + (speed + obstacle.speed) * horizon;
    if (other.center - footprint.center).norm_squared() > far * far {
        return None;
    }
    TTC_STEPS.into_iter().find_map(|ahead| {
        let projected = moved(footprint, speed * STEP * ahead as f64);
        let other = obstacle.box_at(step + ahead)?;
        in_contact(&projected, &other, reach).then_some(other.center)
    })
}

/// Returns whether a contact is the fault of ego.
fn is_at_fault(drive: &Drive<'_>, step: usize, obstacle: &Obstacle, other: &OrientedBox) -> bool {
    let is_stopped = obstacle.kind != ObstacleKind::Agent || obstacle.speed <= STOPPED_SPEED;
    match classify(&drive.states[step], &drive.footprints[step], other, is_stopped) {
        ContactClass::StoppedEgo | ContactClass::ActiveRear => false,
        ContactClass::StoppedTrack | ContactClass::ActiveFront => true,
        ContactClass::ActiveLateral => drive.ground[step].in_multiple_lanes || drive.ground[step].is_off_road,
    }
}

/// Returns the score of the longest uninterrupted drive off the route.
fn driving_direction(drive: &Drive<'_>) -> f64 {
    let (mut longest, mut current) = (0.0_f64, 0.0);
    for step in 0..drive.footprints.len() {
        if !drive.ground[step].is_off_route {
            current = 0.0;
        } else if step > 0 {
            current += (drive.footprints[step].center - drive.footprints[step - 1].center).norm();
        }
        longest = longest.max(current);
    }
    match longest {
        longest if longest < DIRECTION_COMPLIANCE => 1.0,
        longest if longest < DIRECTION_VIOLATION => 0.5,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ties_are_won_by_the_first() {
        let scores = Scores { total: vec![0.2, 0.7, 0.7, 0.1], ..Scores::default() };
        assert_eq!(scores.best(), 1);
        assert_eq!(Scores { total: vec![0.0; 3], ..Scores::default() }.best(), 0);
    }

    #[test]
    fn progress_is_relative_to_the_best_proposal() {
        let mut scores = Scores {
            no_collision: vec![1.0, 0.0, 0.5],
            drivable_area: vec![1.0; 3],
            driving_direction: vec![1.0; 3],
            progress_distance: vec![8.0, 30.0, 20.0],
            ttc: vec![1.0, 1.0, 0.0],
            comfortable: vec![0.0, 1.0, 1.0],
            ..Scores::default()
        };
        scores.aggregate();
        assert_eq!(scores.progress, [0.8, 0.0, 1.0]);
        assert_eq!(scores.total, [9.0 / 12.0, 0.0, 0.5 * (7.0 / 12.0)]);
        scores.progress_distance = vec![0.1, 9.0, 0.0];
        scores.aggregate();
        assert_eq!(scores.progress, [1.0, 0.0, 1.0]);
    }
}
