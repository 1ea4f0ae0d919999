//! Trajectories that planners return, their validation, and their interpolation.

use reactsim_geometry::{Vec2, direction, left, wrap};

use crate::{EgoShape, EgoState};

/// Interval of the simulation, seconds (nuPlan devkit 1.2.2: 10 Hz).
pub const STEP: f64 = reactsim_scene::DT;

/// Tolerance of comparisons of times, seconds: nuPlan counts whole microseconds.
const TIME_TOLERANCE: f64 = 1e-6;
/// Largest speed in m/s that two successive states may imply. Controllers of nuPlan refuse 50 m/s and more
/// (devkit 1.2.2, `PerfectTrackingController`).
pub const MAX_SPEED: f64 = 50.0;
/// Largest distance in metres between ego and the trajectory at the present time. Planners that follow a
/// centre line begin their trajectories on it, up to a few metres away from ego.
pub const MAX_START_DISTANCE: f64 = 10.0;

/// Position and heading of a rear axle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Centre of the rear axle, metres, frame of the map.
    pub position: Vec2,
    /// Heading, radians.
    pub heading: f64,
}

impl From<&EgoState> for Pose {
    fn from(state: &EgoState) -> Self {
        Self { position: state.rear_axle(), heading: state.heading }
    }
}

/// The reason why states are not a trajectory that ego can follow.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrajectoryError {
    /// Fewer than two states.
    #[error("trajectory has {0} states; at least 2 are necessary")]
    TooShort(usize),
    /// A number is NaN or infinite.
    #[error("state {index} of the trajectory is not finite: {state:?}; planners must return finite numbers")]
    NotFinite {
        /// Index of the state.
        index: usize,
        /// The state.
        state: Box<EgoState>,
    },
    /// A time is not after the one before it.
    #[error("state {index} of the trajectory is at {time} s, not after {before} s; times must increase")]
    TimesDoNotIncrease {
        /// Index of the later state.
        index: usize,
        /// Its time, seconds.
        time: f64,
        /// Time of the state before, seconds.
        before: f64,
    },
    /// The trajectory begins after the present time or ends before the next step.
    #[error("trajectory is from {start} s to {end} s; it must cover {now} s to {next} s")]
    TimeNotCovered {
        /// Time of the first state, seconds.
        start: f64,
        /// Time of the last state, seconds.
        end: f64,
        /// Present time, seconds.
        now: f64,
        /// Time of the next step, seconds.
        next: f64,
    },
    /// The trajectory is far from ego at the present time.
    #[error(
        "trajectory is {distance:.1} m from ego at {now} s; at most {MAX_START_DISTANCE} m are allowed: \
         positions are those of the rear axle in the frame of the map"
    )]
    FarFromEgo {
        /// Distance, metres.
        distance: f64,
        /// Present time, seconds.
        now: f64,
    },
    /// Two successive states imply an impossible speed.
    #[error(
        "state {index} of the trajectory is reached at {speed:.1} m/s; speeds must be below {MAX_SPEED} m/s"
    )]
    Teleport {
        /// Index of the later state.
        index: usize,
        /// Mean speed between the states, m/s.
        speed: f64,
    },
}

/// Checks that ego, in its present state `ego`, can follow `states`.
///
/// # Errors
/// [`TrajectoryError`], for the first requirement that is not met: at least two states; finite numbers;
/// increasing times; times that cover the present and the next step; a position near ego at present;
/// successive positions that imply less than [`MAX_SPEED`].
pub fn validate(states: &[EgoState], ego: &EgoState) -> Result<(), TrajectoryError> {
    let [first, .., last] = states else { return Err(TrajectoryError::TooShort(states.len())) };
    if let Some(index) = states.iter().position(|state| !state.is_finite()) {
        return Err(TrajectoryError::NotFinite { index, state: Box::new(states[index]) });
    }
    for (before, pair) in states.windows(2).enumerate() {
        validate_pair(before + 1, &pair[0], &pair[1])?;
    }
    let (now, next) = (ego.time, ego.time + STEP);
    if !(first.time <= now + TIME_TOLERANCE && next <= last.time + TIME_TOLERANCE) {
        return Err(TrajectoryError::TimeNotCovered { start: first.time, end: last.time, now, next });
    }
    let distance = (interpolate(states, now).rear_axle() - ego.rear_axle()).norm();
    if distance <= MAX_START_DISTANCE { Ok(()) } else { Err(TrajectoryError::FarFromEgo { distance, now }) }
}

/// Checks the times and positions of two successive states; `index` is that of the later one.
fn validate_pair(index: usize, before: &EgoState, state: &EgoState) -> Result<(), TrajectoryError> {
    let elapsed = state.time - before.time;
    if elapsed <= 0.0 {
        return Err(TrajectoryError::TimesDoNotIncrease { index, time: state.time, before: before.time });
    }
    let speed = (state.rear_axle() - before.rear_axle()).norm() / elapsed;
    if speed < MAX_SPEED { Ok(()) } else { Err(TrajectoryError::Teleport { index, speed }) }
}

/// States of ego over time, of its rear axle, in the frame of the map.
///
/// There are at least two states; numbers are finite and times increase.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    states: Vec<EgoState>,
}

impl Trajectory {
    /// Creates a trajectory for ego, whose present state is `ego`.
    ///
    /// # Errors
    /// As for [`validate`].
    pub fn new(states: Vec<EgoState>, ego: &EgoState) -> Result<Self, TrajectoryError> {
        validate(&states, ego)?;
        Ok(Self { states })
    }

    /// Creates a trajectory from poses of the centre of the box at intervals of [`STEP`] after the present,
    /// such as networks plan: x and y (m, frame of the map) and heading (rad). It begins with the present
    /// state of ego. Velocities of the rear axle are differences over the interval before, and accelerations
    /// differences of these velocities; the first are in relation to `ego`.
    ///
    /// # Errors
    /// As for [`validate`].
    pub fn through_centers(
        poses: &[[f64; 3]],
        ego: &EgoState,
        shape: &EgoShape,
    ) -> Result<Self, TrajectoryError> {
        Self::through_centers_from(None, poses, ego, shape)
    }

    /// Creates a trajectory as [`Self::through_centers`] does, that begins at `present`: the pose of the
    /// centre of the box that is planned for the present time, such as the one on a path beside ego. It
    /// begins at ego if there is none. Controllers correct the difference between ego and the beginning.
    ///
    /// # Errors
    /// As for [`validate`].
    pub fn through_centers_from(
        present: Option<[f64; 3]>,
        poses: &[[f64; 3]],
        ego: &EgoState,
        shape: &EgoShape,
    ) -> Result<Self, TrajectoryError> {
        let rear_axle_of =
            |[x, y, heading]: [f64; 3]| Vec2::new(x, y) - direction(heading) * shape.rear_axle_to_center;
        let first = present.map_or(*ego, |pose| {
            let rear_axle = rear_axle_of(pose);
            EgoState { x: rear_axle.x, y: rear_axle.y, heading: pose[2], ..*ego }
        });
        let mut states = vec![first];
        for (i, &pose) in (1..).zip(poses) {
            let before = states[states.len() - 1];
            let heading = pose[2];
            let (rear_axle, ahead) = (rear_axle_of(pose), direction(heading));
            let velocity = (rear_axle - before.rear_axle()) / STEP;
            let (vx, vy) = (velocity.dot(&ahead), velocity.dot(&left(ahead)));
            states.push(EgoState {
                time: ego.time + STEP * f64::from(i),
                vx,
                vy,
                ax: (vx - before.vx) / STEP,
                ay: (vy - before.vy) / STEP,
                ..EgoState::standing(rear_axle, heading)
            });
        }
        Self::new(states, ego)
    }

    /// Returns the states, at least two, by increasing time.
    pub fn states(&self) -> &[EgoState] {
        &self.states
    }

    /// Returns the time of the first state, seconds.
    pub fn start(&self) -> f64 {
        self.states[0].time
    }

    /// Returns the time of the last state, seconds.
    pub fn end(&self) -> f64 {
        self.states[self.states.len() - 1].time
    }

    /// Returns the state at a time in seconds, which is clamped to the trajectory.
    ///
    /// Positions, velocities, accelerations and the steering angle are linear between states, and the
    /// heading is linear along the shorter turn. Yaw rate and yaw acceleration are 0, as in nuPlan
    /// (devkit 1.2.2).
    pub fn at(&self, time: f64) -> EgoState {
        interpolate(&self.states, time)
    }

    /// Returns the poses at intervals of [`STEP`], from the first state up to the last.
    pub fn resampled(&self) -> Vec<Pose> {
        let count = ((self.end() - self.start() + TIME_TOLERANCE) / STEP) as usize;
        (0..=count).map(|i| Pose::from(&self.at(self.start() + STEP * i as f64))).collect()
    }
}

/// Returns the state at `time` of at least two states; see [`Trajectory::at`].
fn interpolate(states: &[EgoState], time: f64) -> EgoState {
    let after = states.partition_point(|state| state.time <= time).clamp(1, states.len() - 1);
    let (a, b) = (&states[after - 1], &states[after]);
    let share = ((time - a.time) / (b.time - a.time)).clamp(0.0, 1.0);
    let between = |from: f64, to: f64| from + (to - from) * share;
    EgoState {
        time,
        x: between(a.x, b.x),
        y: between(a.y, b.y),
        heading: wrap(a.heading + share * wrap(b.heading - a.heading)),
        vx: between(a.vx, b.vx),
        vy: between(a.vy, b.vy),
        ax: between(a.ax, b.ax),
        ay: between(a.ay, b.ay),
        steering: between(a.steering, b.steering),
        yaw_rate: 0.0,
        yaw_acceleration: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// States along the x axis at 10 m/s, every 0.5 s.
    fn straight() -> Vec<EgoState> {
        (0..4).map(|i| state(0.5 * f64::from(i), 5.0 * f64::from(i))).collect()
    }

    fn state(time: f64, x: f64) -> EgoState {
        EgoState { time, vx: 10.0, ..EgoState::standing(Vec2::new(x, 0.0), 0.0) }
    }

    #[test]
    fn each_requirement_has_its_error() {
        let ego = state(0.0, 0.0);
        let changed = |change: fn(&mut Vec<EgoState>)| {
            let mut states = straight();
            change(&mut states);
            validate(&states, &ego)
        };
        assert_eq!(changed(|_| ()), Ok(()));
        assert_eq!(changed(|states| states.truncate(1)), Err(TrajectoryError::TooShort(1)));
        let not_finite = changed(|states| states[2].heading = f64::NAN);
        assert!(matches!(not_finite, Err(TrajectoryError::NotFinite { index: 2, .. })));
        let repeated = changed(|states| states[2].time = 0.5);
        assert!(matches!(repeated, Err(TrajectoryError::TimesDoNotIncrease { index: 2, .. })));
        let late = changed(|states| states.iter_mut().for_each(|state| state.time += 0.05));
        assert!(matches!(late, Err(TrajectoryError::TimeNotCovered { .. })));
        let early = changed(|states| states.iter_mut().for_each(|state| state.time -= 1.45));
        assert!(matches!(early, Err(TrajectoryError::TimeNotCovered { .. })));
        let aside = changed(|states| states.iter_mut().for_each(|state| state.y += 11.0));
        assert!(matches!(aside, Err(TrajectoryError::FarFromEgo { .. })));
        let jump = changed(|states| states[3].x = 40.0);
        assert_eq!(jump, Err(TrajectoryError::Teleport { index: 3, speed: 60.0 }));
    }

    #[test]
    fn messages_name_place_value_and_remedy() {
        let error = validate(&straight()[..1], &state(0.0, 0.0)).unwrap_err();
        assert_eq!(error.to_string(), "trajectory has 1 states; at least 2 are necessary");
        let error = validate(&straight(), &state(1.45, 14.5)).unwrap_err();
        assert_eq!(error.to_string(), "trajectory is from 0 s to 1.5 s; it must cover 1.45 s to 1.55 s");
    }

    #[test]
    fn headings_turn_the_shorter_way() {
        let ego = state(0.0, 0.0);
        let states = vec![
            EgoState { heading: PI - 0.1, ..state(0.0, 0.0) },
            EgoState { heading: -PI + 0.1, ..state(1.0, 1.0) },
        ];
        let trajectory = Trajectory::new(states, &ego).unwrap();
        assert!((trajectory.at(0.25).heading - (PI - 0.05)).abs() < 1e-12);
        assert!((trajectory.at(0.75).heading - (-PI + 0.05)).abs() < 1e-12);
    }

    #[test]
    fn centres_become_rear_axles_with_differences_as_velocities() {
        let (ego, shape) = (state(2.0, 0.0), EgoShape::PACIFICA);
        let centers = [1.0, 2.1].map(|x| [x + shape.rear_axle_to_center, 0.0, 0.0]);
        let trajectory = Trajectory::through_centers(&centers, &ego, &shape).unwrap();
        let [now, one, two] = trajectory.states() else { panic!("{trajectory:?}") };
        assert_eq!(*now, ego);
        for (state, [time, x, vx, ax]) in [(one, [2.1, 1.0, 10.0, 0.0]), (two, [2.2, 2.1, 11.0, 10.0])] {
            let found = [state.time, state.x, state.vx, state.ax];
            assert!(found.iter().zip([time, x, vx, ax]).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        }
        let far = Trajectory::through_centers(&[[9.0, 0.0, 0.0]], &ego, &shape);
        assert!(matches!(far, Err(TrajectoryError::Teleport { index: 1, .. })));
    }

    #[test]
    fn plans_may_begin_beside_ego() {
        let (ego, shape) = (state(2.0, 0.0), EgoShape::PACIFICA);
        let centers = [0.5, 1.5].map(|x| [x + shape.rear_axle_to_center, 1.0, 0.0]);
        let beside = Trajectory::through_centers_from(Some(centers[0]), &centers[1..], &ego, &shape).unwrap();
        let [now, one] = beside.states() else { panic!("{beside:?}") };
        assert!((now.x - 0.5).abs() < 1e-12 && (now.y - 1.0).abs() < 1e-12);
        assert_eq!((now.time, now.vx), (ego.time, ego.vx));
        assert!((one.vx - 10.0).abs() < 1e-9 && one.vy.abs() < 1e-9);
        let far = Some([shape.rear_axle_to_center, 10.1, 0.0]);
        let far = Trajectory::through_centers_from(far, &[[1.0, 10.1, 0.0]], &ego, &shape);
        assert!(matches!(far, Err(TrajectoryError::FarFromEgo { .. })));
    }

    #[test]
    fn samples_reach_the_last_state() {
        let trajectory = Trajectory::new(straight(), &state(0.0, 0.0)).unwrap();
        let poses = trajectory.resampled();
        assert_eq!(poses.len(), 16);
        assert!((poses[7].position.x - 7.0).abs() < 1e-12 && (poses[15].position.x - 15.0).abs() < 1e-12);
        assert_eq!(trajectory.at(9.0).x, 15.0);
    }
}
