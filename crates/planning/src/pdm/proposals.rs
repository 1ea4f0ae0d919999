//! Proposals: an intelligent driver model with five speeds on three paths (tuplan_garage b51d5d0,
//! `PDMGenerator` and `BatchIDMPolicy`).

use reactsim_geometry::{direction, math};

use super::forecast::{Forecast, Obstacle};
use crate::idm_model::IdmModel;
use crate::path::{Corridor, Path};
use crate::trajectory::{Pose, STEP};
use crate::{EgoShape, EgoState};

/// Number of steps of a proposal: 4 s (tuplan_garage b51d5d0, `proposal_sampling`).
pub(super) const STEPS: usize = 40;
/// Number of steps of a trajectory: 8 s (tuplan_garage b51d5d0, `trajectory_sampling`).
pub(super) const TRAJECTORY_STEPS: usize = 80;
/// Shares of the speed limit at which proposals drive (tuplan_garage b51d5d0, `speed_limit_fraction`).
pub(super) const SPEED_FRACTIONS: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];
/// Limit in m/s where none is known (tuplan_garage b51d5d0, `fallback_target_velocity`).
const FALLBACK_LIMIT: f64 = 15.0;
/// Parameters of the model (tuplan_garage b51d5d0, `min_gap_to_lead_agent`, `headway_time`, `accel_max` and
/// `decel_max`).
const MODEL: IdmModel = IdmModel { min_gap: 1.0, headway: 1.5, acceleration: 1.5, deceleration: 3.0 };
/// Number of steps between searches for the leader (tuplan_garage b51d5d0, `leading_agent_update_rate`).
const LEADER_INTERVAL: usize = 2;

/// Returns the speeds in m/s that the proposals of one path aim at, by the limit of the current lane.
pub(super) fn target_speeds(limit: Option<f64>) -> [f64; 5] {
    let limit = limit.filter(|&limit| limit > 0.0).unwrap_or(FALLBACK_LIMIT);
    SPEED_FRACTIONS.map(|fraction| fraction * limit)
}

/// The rear end that a proposal follows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Leader {
    /// Position along the path, metres.
    pub progress: f64,
    /// Speed along the heading of ego, m/s.
    pub speed: f64,
    /// Length behind the position, metres.
    pub rear: f64,
}

/// One proposal, at steps of [`STEP`] from the present on.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// Number of the path: 0 the centre line, 1 its right parallel, 2 its left parallel.
    pub path: usize,
    /// Speed that the proposal aims at, m/s.
    pub target_speed: f64,
    /// Arc lengths of the rear axle on the path, metres. They may exceed the path.
    pub progress: Vec<f64>,
    /// Speeds, m/s.
    pub speeds: Vec<f64>,
    /// Leaders that led to the state of the same step. The one of step 0 is unused and zero.
    pub leaders: Vec<Leader>,
    /// Poses of the rear axle on the path.
    pub poses: Vec<Pose>,
}

impl Proposal {
    fn begin(path: usize, target_speed: f64, progress: f64, speed: f64, pose: Pose) -> Self {
        Self {
            path,
            target_speed,
            progress: vec![progress],
            speeds: vec![speed],
            leaders: vec![Leader::default()],
            poses: vec![pose],
        }
    }

    /// Adds the next state. Leaders are searched for at even steps among `traffic`, the obstacles in the
    /// corridor with their progress on the path; odd steps copy them. Step 1 therefore follows the zero
    /// leader of step 0.
    fn advance(&mut self, path: &Path, shape: &EgoShape, traffic: &[(f64, &Obstacle)]) {
        let before = self.progress.len() - 1;
        let (progress, speed) = (self.progress[before], self.speeds[before]);
        let leader = if is_leader_step(before + 1) {
            find_leader(self.poses[before], progress, path, shape, traffic, before + 1)
        } else {
            self.leaders[before]
        };
        let acceleration = acceleration(progress, speed, self.target_speed, leader);
        self.leaders.push(leader);
        self.progress.push(progress + STEP * speed);
        self.speeds.push(speed + STEP * acceleration);
        self.poses.push(path.at(progress + STEP * speed));
    }
}

/// Returns whether leaders are searched for at a step.
fn is_leader_step(step: usize) -> bool {
    step.is_multiple_of(LEADER_INTERVAL)
}

/// Returns the acceleration of the intelligent driver model, m/s². There is no floor at standstill:
/// speeds may become negative.
fn acceleration(progress: f64, speed: f64, target: f64, leader: Leader) -> f64 {
    let gap = leader.progress - progress - leader.rear;
    MODEL.acceleration_by(tenth_power(speed / target), speed, gap, leader.speed)
}

/// Returns x¹⁰; 10 is the acceleration exponent (tuplan_garage b51d5d0, `acceleration_exponent`).
fn tenth_power(x: f64) -> f64 {
    let square = x * x;
    let fourth = square * square;
    fourth * fourth * square
}

/// Returns the leader of a rear axle at `pose` and `progress`: the obstacle nearest to the box of ego
/// among those whose centroid is ahead, or the end of the path.
fn find_leader(
    pose: Pose,
    progress: f64,
    path: &Path,
    shape: &EgoShape,
    traffic: &[(f64, &Obstacle)],
    step: usize,
) -> Leader {
    let center = pose.position + direction(pose.heading) * shape.rear_axle_to_center;
    let footprint = shape.footprint_at(center, pose.heading);
    let (mut least, mut nearest) = (f64::INFINITY, None);
    for (_, obstacle) in traffic.iter().filter(|(at, _)| *at > progress) {
        if let Some(distance) = obstacle.distance_below(step, &footprint, least) {
            (least, nearest) = (distance, Some(obstacle));
        }
    }
    match nearest {
        Some(obstacle) => Leader {
            progress: progress + least,
            speed: obstacle.speed * math::cos(obstacle.heading - pose.heading),
            rear: 0.0,
        },
        None => Leader { progress: path.length(), speed: 0.0, rear: 0.5 * shape.length },
    }
}

/// The proposals of one iteration, with what is needed to continue one of them.
#[derive(Debug)]
pub(super) struct Proposals<'a> {
    paths: &'a [Path],
    shape: &'a EgoShape,
    forecast: &'a Forecast,
    corridors: Vec<Corridor>,
    pub(super) list: Vec<Proposal>,
}

impl<'a> Proposals<'a> {
    /// Unrolls the proposals of all paths, those of one path after each other by increasing speed.
    pub(super) fn unroll(
        ego: &EgoState,
        shape: &'a EgoShape,
        paths: &'a [Path],
        targets: [f64; 5],
        forecast: &'a Forecast,
    ) -> Self {
        let fastest = targets.into_iter().fold(0.0, f64::max);
        let reach = fastest * TRAJECTORY_STEPS as f64 * STEP;
        let (mut list, mut corridors) = (Vec::new(), Vec::new());
        for (number, path) in paths.iter().enumerate() {
            let progress = path.project(ego.rear_axle());
            let corridor = path.corridor(progress, progress + reach, 0.5 * shape.width);
            let pose = path.at(progress);
            let begin = |target| Proposal::begin(number, target, progress, ego.vx, pose);
            let mut proposals: Vec<Proposal> = targets.into_iter().map(begin).collect();
            let traffic = forecast.along(path, &corridor);
            for step in 1..=STEPS {
                let obstacles = if is_leader_step(step) { traffic.at(step) } else { Vec::new() };
                proposals.iter_mut().for_each(|proposal| proposal.advance(path, shape, &obstacles));
            }
            list.extend(proposals);
            corridors.push(corridor);
        }
        Self { paths, shape, forecast, corridors, list }
    }

    /// Continues a proposal to the length of a trajectory and returns its poses.
    pub(super) fn extend(&mut self, number: usize) -> &[Pose] {
        let proposal = &mut self.list[number];
        let path = &self.paths[proposal.path];
        let traffic = self.forecast.along(path, &self.corridors[proposal.path]);
        for step in proposal.poses.len()..=TRAJECTORY_STEPS {
            let obstacles = if is_leader_step(step) { traffic.at(step) } else { Vec::new() };
            proposal.advance(path, self.shape, &obstacles);
        }
        &proposal.poses
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_limits_have_a_fallback() {
        assert_eq!(target_speeds(None), target_speeds(Some(15.0)));
        assert_eq!(target_speeds(Some(0.0)), target_speeds(Some(15.0)));
        assert!((target_speeds(Some(10.0))[1] - 4.0).abs() < 1e-12);
    }

    #[test]
    fn accelerations_are_bounded_and_vanish_at_the_target() {
        let free = Leader { progress: 1e9, ..Leader::default() };
        assert!((acceleration(0.0, 10.0, 10.0, free)).abs() < 1e-9);
        assert!((acceleration(0.0, 0.0, 10.0, free) - 1.5).abs() < 1e-9);
        // The zero leader of step 0 brakes even on a free road.
        assert_eq!(acceleration(50.0, 10.0, 13.0, Leader::default()), -3.0);
        assert_eq!(tenth_power(2.0), 1024.0);
    }
}
