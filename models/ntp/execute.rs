//! From a token to what an agent does with it.

use reactsim::dynamics::{Ability, Moving, Pose, REAR_AXLE, Tracker};
use reactsim::geometry::Vec2;
use reactsim::scene::{Agent, AgentState, DT, Frame};

use super::clearance::Traffic;
use super::tokens::{Class, ORIGIN, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, moved};

/// How much of a change of speed goes on beyond the mean of a token: 0 ends a token at its mean speed, 1 keeps the acceleration
/// constant. Between, speeds settle where the same token follows itself.
const CARRY: f64 = 0.4;

/// Who comes nearer than this to another does not keep clear, metres.
const CLEAR: f64 = 0.1;
/// So many tokens are tried.
const TRIES: usize = 8;
/// Half a second of standing.
const STILL: TokenPoses = [ORIGIN; TOKEN_POSES];

/// Executes tokens: as they are, or as a vehicle can drive them.
#[derive(Clone, Debug)]
pub(crate) struct Executor {
    tracker: Option<Tracker>,
    aims: Vec<Pose>,
    driven: Vec<Moving>,
}

impl Executor {
    /// With `projection`, vehicles drive tokens within the limits of the benchmark; without it, and for people on foot and on bicycles,
    /// poses are those of the token.
    pub(crate) fn new(projection: bool) -> Self {
        Self {
            tracker: projection.then(|| Tracker::new(Ability::of_vehicle(0.0))),
            aims: Vec::new(),
            driven: Vec::new(),
        }
    }

    /// Appends the states of the next half second by the first of `tokens` (the likeliest few) that keeps clear of the others in `traffic`, or by standing still
    /// if only that does; where nothing does, by what stays farthest away. Without `traffic`, by the first one.
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
        for token in tokens.take(TRIES).chain([&STILL]) {
            self.execute(agent, class, token, track);
            let Some(traffic) = traffic else { return };
            let room = traffic.room(slot, agent, &track[from..]);
            if room >= CLEAR {
                return;
            }
            let planned = track.split_off(from);
            if best.as_ref().is_none_or(|(most, _)| room > *most) {
                best = Some((room, planned));
            }
        }
        track.extend(best.into_iter().flat_map(|(_, planned)| planned));
    }

    /// Appends the states of the next half second to the track of an agent that is present at its last frame. Velocities are position
    /// differences.
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
        let (Some(tracker), Some(now)) = (tracker, Moving::after(track)) else {
            let mut before = from.position;
            for pose in token.iter().skip(1) {
                let to = moved(from, *pose);
                track.push(Some(state_at(before, to)));
                before = to.position;
            }
            return;
        };
        self.aims.clear();
        self.aims.extend(smoothed(token, now.speed).map(|pose| moved(from, pose)));
        tracker.set_ability(Ability::of_vehicle(REAR_AXLE * agent.length));
        tracker.track(now, &self.aims, &mut self.driven);
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

/// The poses of a token after 0.1 to 0.5 s, with its way driven from the present speed on without a jump: a cubic in time that ends where
/// the token ends. `speed` is in m/s, negative backwards.
fn smoothed(token: &TokenPoses, speed: f64) -> [Pose; TOKEN_FRAMES] {
    let end = token[TOKEN_FRAMES].position;
    let mut way = [0.0; TOKEN_FRAMES + 1];
    for k in 0..TOKEN_FRAMES {
        way[k + 1] = way[k] + (token[k + 1].position - token[k].position).norm();
    }
    let length = way[TOKEN_FRAMES];
    let sign = if end.x < 0.0 { -1.0 } else { 1.0 };
    let total = TOKEN_FRAMES as f64 * DT;
    let mut poses = [token[TOKEN_FRAMES]; TOKEN_FRAMES];
    let start = sign * speed;
    let mean = length / total;
    let finish = (mean + CARRY * (mean - start)).max(0.0);
    // A token that stands, or one of the other direction, is followed as it is: the tracker brakes.
    if length < 0.02 || start < 0.0 {
        poses.copy_from_slice(&token[1..]);
        return poses;
    }
    for (k, pose) in poses.iter_mut().enumerate() {
        let u = (k + 1) as f64 / TOKEN_FRAMES as f64;
        let (u2, u3) = (u * u, u * u * u);
        let s =
            (u3 - 2.0 * u2 + u) * total * start + (3.0 * u2 - 2.0 * u3) * length + (u3 - u2) * total * finish;
        *pose = along(token, &way, s.clamp(0.0, length));
    }
    poses
}

/// The pose of a token after `s` metres of its way.
fn along(token: &TokenPoses, way: &[f64; TOKEN_FRAMES + 1], s: f64) -> Pose {
    let k = (1..TOKEN_FRAMES).find(|&k| s <= way[k]).unwrap_or(TOKEN_FRAMES);
    let piece = way[k] - way[k - 1];
    let t = if piece > 0.0 { (s - way[k - 1]) / piece } else { 1.0 };
    let (a, b) = (token[k - 1], token[k]);
    Pose {
        position: a.position + (b.position - a.position) * t,
        heading: a.heading + reactsim::geometry::wrap(b.heading - a.heading) * t,
    }
}
