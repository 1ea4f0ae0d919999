//! Vehicles that brake for no reason during replay, and how they return to the speeds of their logs.

use rand::RngExt;
use reactsim_geometry::{Vec2, wrap};
use reactsim_nn::training::Stream;
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{DT, Frame};

use super::tokens::TOKEN_FRAMES;

/// Range of the deceleration, m/s²: from calm to hard braking.
const DECELERATION: [f64; 2] = [1.5, 5.0];
/// Range of the acceleration back to the speed of the log, m/s²: usual values of cars that set off.
const ACCELERATION: [f64; 2] = [1.5, 3.0];
/// Largest number of tokens during which a vehicle brakes: long enough that many come to stand.
const MAX_BRAKING_TOKENS: usize = 8;
/// Step from which a vehicle brakes at the latest.
const LAST_FIRST_STEP: usize = 10;
/// Length of a logged path in metres below which there is nothing to lose.
const MIN_LENGTH: f64 = 5.0;
/// Frames over which the speed of the log is measured where the vehicle is.
const SPEED_FRAMES: usize = 5;

/// A slowdown of one vehicle, and its logged path.
#[derive(Debug)]
pub(crate) struct Slowdown {
    /// First step, in tokens, at which the vehicle brakes.
    pub first: usize,
    tokens: usize,
    deceleration: f64,
    acceleration: f64,
    /// Frame of the first pose.
    frame: usize,
    poses: Vec<Pose>,
    /// Arc length of each pose, metres.
    arcs: Vec<f64>,
}

/// Poses of a token of a vehicle that is late.
pub(crate) struct Passage {
    /// Pose of the logged path where the vehicle is.
    pub here: Pose,
    /// Pose after the token if the vehicle returns to the speed of its log.
    pub recovers: Pose,
    /// Pose after the token if the vehicle brakes; `None` if it no longer does.
    pub brakes: Option<Pose>,
}

impl Slowdown {
    /// Draws a slowdown of a vehicle with this log, after frame `from`. `None` if the vehicle is absent at
    /// some frame or hardly moves. The number of draws does not depend on the log.
    pub(crate) fn draw(logged: &[Frame], from: usize, stream: &mut Stream) -> Option<Self> {
        let mut between = |range: [f64; 2]| range[0] + (range[1] - range[0]) * stream.random::<f64>();
        let (deceleration, acceleration) = (between(DECELERATION), between(ACCELERATION));
        let first = stream.random_range(0..=LAST_FIRST_STEP);
        let tokens = stream.random_range(1..=MAX_BRAKING_TOKENS);
        let poses: Option<Vec<Pose>> = logged[from..].iter().map(|f| f.map(Pose::from)).collect();
        let poses = poses?;
        let mut arcs = vec![0.0];
        for pair in poses.windows(2) {
            arcs.push(arcs[arcs.len() - 1] + (pair[1].position - pair[0].position).norm());
        }
        let enough = arcs[arcs.len() - 1] >= MIN_LENGTH;
        enough.then_some(Self { first, tokens, deceleration, acceleration, frame: from, poses, arcs })
    }

    /// Returns the poses of the token that ends at frame `next` for a vehicle at a position of the path.
    pub(crate) fn passage(&self, position: Vec2, speed: f64, next: usize, step: usize) -> Passage {
        let last_arc = self.arcs[next - self.frame];
        let arc = self.nearest(position, next);
        // The speed of the log where it left this place.
        let leaves = self.arcs.partition_point(|a| *a <= arc + 0.01).min(self.arcs.len() - 1);
        let until = (leaves + SPEED_FRAMES).min(self.arcs.len() - 1);
        let logged = (self.arcs[until] - self.arcs[leaves - 1]) / (DT * (until + 1 - leaves) as f64);
        let duration = DT * TOKEN_FRAMES as f64;
        let after = |end: f64| self.pose((arc + 0.5 * (speed + end) * duration).min(last_arc.max(arc)));
        let recovered = if speed < logged {
            (speed + self.acceleration * duration).min(logged)
        } else {
            logged.max(speed - self.deceleration * duration)
        };
        let brakes = step < self.first + self.tokens;
        Passage {
            here: self.pose(arc),
            recovers: after(recovered),
            brakes: brakes.then(|| after((speed - self.deceleration * duration).max(0.0))),
        }
    }

    /// Returns the arc length of the pose nearest to a position among those before frame `next`, refined
    /// along the path.
    fn nearest(&self, position: Vec2, next: usize) -> f64 {
        let distance = |k: &usize| (self.poses[*k].position - position).norm_squared();
        let most = next - self.frame;
        let Some(k) = (0..=most).min_by(|a, b| distance(a).total_cmp(&distance(b))) else { return 0.0 };
        let ahead = reactsim_geometry::direction(self.poses[k].heading);
        let along = (position - self.poses[k].position).dot(&ahead);
        (self.arcs[k] + along).clamp(0.0, self.arcs[most])
    }

    fn pose(&self, arc: f64) -> Pose {
        let k = self.arcs.partition_point(|a| *a < arc).clamp(1, self.arcs.len() - 1);
        let (a, b) = (self.poses[k - 1], self.poses[k]);
        let t = ((arc - self.arcs[k - 1]) / (self.arcs[k] - self.arcs[k - 1]).max(1e-9)).clamp(0.0, 1.0);
        Pose {
            position: a.position + (b.position - a.position) * t,
            heading: a.heading + wrap(b.heading - a.heading) * t,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use reactsim_scene::AgentState;

    use super::*;

    /// A vehicle that drives along x at 10 m/s, from frame 0 on.
    fn logged() -> Vec<Frame> {
        let at = |f: usize| AgentState { x: f as f64, y: 0.0, heading: 0.0, vx: 10.0, vy: 0.0 };
        (0..91).map(|f| Some(at(f))).collect()
    }

    fn slowdown() -> Slowdown {
        let poses: Vec<Pose> = logged().into_iter().flatten().map(Pose::from).collect();
        let arcs = poses.iter().map(|p| p.position.x).collect();
        Slowdown { first: 2, tokens: 2, deceleration: 4.0, acceleration: 2.0, frame: 0, poses, arcs }
    }

    #[test]
    fn a_late_vehicle_returns_to_the_speed_of_its_log() {
        let slowdown = slowdown();
        // At 10 m after 3 s, where the log has been at 30 m.
        let passage = slowdown.passage(Vec2::new(10.0, 0.3), 4.0, 35, 6);
        assert!(passage.brakes.is_none());
        assert!((passage.here.position - Vec2::new(10.0, 0.0)).norm() < 1e-9);
        // From 4 to 5 m/s in half a second.
        assert!((passage.recovers.position.x - 12.25).abs() < 1e-9, "{:?}", passage.recovers);
        // Never beyond the log, and not faster than the log.
        let passage = slowdown.passage(Vec2::new(34.5, 0.0), 9.8, 35, 6);
        assert!((passage.recovers.position.x - 35.0).abs() < 1e-9, "{:?}", passage.recovers);
        let passage = slowdown.passage(Vec2::new(10.0, 0.0), 9.9, 35, 6);
        assert!((passage.recovers.position.x - 14.975).abs() < 1e-9, "{:?}", passage.recovers);
    }

    #[test]
    fn a_vehicle_brakes_during_its_slowdown() {
        let passage = slowdown().passage(Vec2::new(10.0, 0.0), 10.0, 15, 3);
        // From 10 to 8 m/s, while the label leads on.
        assert!((passage.brakes.unwrap().position.x - 14.5).abs() < 1e-9);
        assert!((passage.recovers.position.x - 15.0).abs() < 1e-9);
    }

    #[test]
    fn the_number_of_draws_does_not_depend_on_the_log() {
        let after = |log: &[Frame]| {
            let mut stream = Stream::seed_from_u64(0);
            let drawn = Slowdown::draw(log, 10, &mut stream).is_some();
            (drawn, stream.random::<u64>())
        };
        let (moves, stands) = (after(&logged()), after(&vec![logged()[0]; 91]));
        assert!(moves.0 && !stands.0);
        assert_eq!(moves.1, stands.1);
    }
}
