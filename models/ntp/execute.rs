//! Execution of tokens: from a token to the motion of an agent.

use reactsim_geometry::Vec2;
use reactsim_nn::perception::Class;
use reactsim_scene::dynamics::{MotionLimits, Pose, REAR_AXLE, Tracker, VehicleMotion};
use reactsim_scene::{Agent, AgentState, DT, Frame};

use super::clearance::Traffic;
use super::tokens::{ORIGIN, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, moved};

/// Part of the speed change within a token that continues beyond the token's mean speed, from 0 to 1:
/// with 0 a token ends at its mean speed, with 1 its acceleration is constant. In between, speeds
/// converge when the same token is repeated.
const SPEED_CHANGE_CARRYOVER: f64 = 0.4;

/// Minimum clearance to other agents for a token to count as clear, metres.
const MIN_CLEARANCE: f64 = 0.1;
/// Number of tokens tried for clearance.
const MAX_TRIED_TOKENS: usize = 8;
/// Token of half a second at standstill.
const STANDSTILL_TOKEN: TokenPoses = [ORIGIN; TOKEN_POSES];

/// Executes tokens, either exactly or as a vehicle can drive them.
#[derive(Clone, Debug)]
pub(crate) struct Executor {
    tracker: Option<Tracker>,
    targets: Vec<Pose>,
    driven: Vec<VehicleMotion>,
}

impl Executor {
    /// With `projection`, vehicles drive tokens within the limits of the benchmark. Without it, and for
    /// pedestrians and cyclists, poses are exactly those of the token.
    pub(crate) fn new(projection: bool) -> Self {
        Self {
            tracker: projection.then(|| Tracker::new(MotionLimits::of_vehicle(0.0))),
            targets: Vec::new(),
            driven: Vec::new(),
        }
    }

    /// Appends the states of the next half second. Executes the first of `tokens` (likeliest first; only
    /// the first few are tried) that keeps clear of the agents in `traffic`, or standstill if only that
    /// does. If nothing keeps clear, executes the candidate with the largest clearance. Without
    /// `traffic`, executes the first token.
    pub(crate) fn execute_clear<'t>(
        &mut self,
        agent: &Agent,
        slot: usize,
        class: Class,
        tokens: impl Iterator<Item = &'t TokenPoses>,
        traffic: Option<&Traffic>,
        track: &mut Vec<Frame>,
    ) {
        let from = track.len();
        let mut best: Option<(f64, Vec<Frame>)> = None;
        for token in tokens.take(MAX_TRIED_TOKENS).chain([&STANDSTILL_TOKEN]) {
            self.execute(agent, class, token, track);
            let Some(traffic) = traffic else { return };
            let clearance = traffic.clearance(slot, agent, &track[from..]);
            if clearance >= MIN_CLEARANCE {
                return;
            }
            let planned = track.split_off(from);
            if best.as_ref().is_none_or(|(most, _)| clearance > *most) {
                best = Some((clearance, planned));
            }
        }
        track.extend(best.into_iter().flat_map(|(_, planned)| planned));
    }

    /// Appends the states of the next half second to the track of an agent that is present at its last
    /// frame. Velocities are position differences.
    pub(crate) fn execute(
        &mut self,
        agent: &Agent,
        class: Class,
        token: &TokenPoses,
        track: &mut Vec<Frame>,
    ) {
        let Some(Some(state)) = track.last().copied() else { return };
        let from = Pose::from(state);
        let tracker = self.tracker.as_mut().filter(|_| class == Class::Vehicle);
        let (Some(tracker), Some(now)) = (tracker, VehicleMotion::after(track)) else {
            let mut before = from.position;
            for pose in token.iter().skip(1) {
                let to = moved(from, *pose);
                track.push(Some(state_at(before, to)));
                before = to.position;
            }
            return;
        };
        self.targets.clear();
        self.targets.extend(smoothed(token, now.speed).map(|pose| moved(from, pose)));
        tracker.set_limits(MotionLimits::of_vehicle(REAR_AXLE * agent.length));
        tracker.track(now, &self.targets, &mut self.driven);
        let mut before = from.position;
        for moving in &self.driven {
            track.push(Some(moving.state(before)));
            before = moving.pose.position;
        }
    }
}

fn state_at(before: Vec2, pose: Pose) -> AgentState {
    let v = (pose.position - before) / DT;
    AgentState { x: pose.position.x, y: pose.position.y, heading: pose.heading, vx: v.x, vy: v.y }
}

/// Returns the poses of a token after 0.1 to 0.5 s, with its path driven from the present speed without
/// a jump: the arc length is a cubic in time that ends where the token ends. `speed` is in m/s, negative
/// in reverse.
fn smoothed(token: &TokenPoses, speed: f64) -> [Pose; TOKEN_FRAMES] {
    let end = token[TOKEN_FRAMES].position;
    let mut arc = [0.0; TOKEN_FRAMES + 1];
    for k in 0..TOKEN_FRAMES {
        arc[k + 1] = arc[k] + (token[k + 1].position - token[k].position).norm();
    }
    let length = arc[TOKEN_FRAMES];
    let sign = if end.x < 0.0 { -1.0 } else { 1.0 };
    let total = TOKEN_FRAMES as f64 * DT;
    let mut poses = [token[TOKEN_FRAMES]; TOKEN_FRAMES];
    let start = sign * speed;
    let mean = length / total;
    let finish = (mean + SPEED_CHANGE_CARRYOVER * (mean - start)).max(0.0);
    // A token at standstill or in the opposite direction is followed unchanged: the tracker brakes.
    if length < 0.02 || start < 0.0 {
        poses.copy_from_slice(&token[1..]);
        return poses;
    }
    for (k, pose) in poses.iter_mut().enumerate() {
        let u = (k + 1) as f64 / TOKEN_FRAMES as f64;
        let (u2, u3) = (u * u, u * u * u);
        let s =
            (u3 - 2.0 * u2 + u) * total * start + (3.0 * u2 - 2.0 * u3) * length + (u3 - u2) * total * finish;
        *pose = pose_at(token, &arc, s.clamp(0.0, length));
    }
    poses
}

/// Returns the pose of a token after `s` metres; `arc` holds the arc lengths of its poses.
fn pose_at(token: &TokenPoses, arc: &[f64; TOKEN_FRAMES + 1], s: f64) -> Pose {
    let k = (1..TOKEN_FRAMES).find(|&k| s <= arc[k]).unwrap_or(TOKEN_FRAMES);
    let piece = arc[k] - arc[k - 1];
    let t = if piece > 0.0 { (s - arc[k - 1]) / piece } else { 1.0 };
    let (a, b) = (token[k - 1], token[k]);
    Pose {
        position: a.position + (b.position - a.position) * t,
        heading: a.heading + reactsim_geometry::wrap(b.heading - a.heading) * t,
    }
}
