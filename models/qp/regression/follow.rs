//! Motion of agents without a prediction: they follow their lane and their leader.

use reactsim_geometry::{Vec2, direction, heading_of, into_frame, left, math};
use reactsim_rollout::Observation;
use reactsim_scene::{AgentKind, AgentState, DT, Frame};

/// Speed in m/s below which an agent stands.
const STANDSTILL_SPEED: f64 = 0.3;
/// Largest lateral distance to a lane that an agent follows, metres.
const MAX_LANE_OFFSET: f64 = 2.5;
/// Smallest cosine of the angle to a lane that an agent follows.
const MIN_LANE_COSINE: f64 = 0.7;
/// Distance between points of the path ahead, metres.
const SPACING: f64 = 2.0;
/// Distance within which leaders are considered, metres.
const LEADER_RANGE: f64 = 60.0;
/// Largest number of consecutive lanes in a path.
const MAX_LANES: usize = 20;
/// Acceleration of the intelligent driver model (Treiber, Hennecke, Helbing, Phys. Rev. E 62, 2000),
/// m/s².
const ACCELERATION: f64 = 1.5;
/// Comfortable deceleration of the model, m/s².
const DECELERATION: f64 = 2.0;
/// Time gap of the model, seconds.
const TIME_GAP: f64 = 1.2;
/// Standstill gap of the model, metres.
const STANDSTILL_GAP: f64 = 2.0;
/// Largest deceleration, m/s².
const MAX_DECELERATION: f64 = 5.5;
/// Length of the chord, in metres, over which the heading follows the path.
const HEADING_CHORD: f64 = 3.0;

/// Returns the states of an agent after 0.1 s, 0.2 s and so on. Vehicles and cyclists on a lane follow
/// it at their speed and lateral offset, and keep their distance from the leader, which is assumed to
/// keep its speed. Other agents go straight on. A standing agent stays.
pub(super) fn follow(seen: &Observation<'_>, slot: usize, now: AgentState, steps: usize) -> Vec<AgentState> {
    let velocity = current_velocity(seen.track(slot), now);
    let speed = velocity.norm();
    if speed < STANDSTILL_SPEED {
        let stand = AgentState { vx: 0.0, vy: 0.0, ..now };
        return vec![stand; steps];
    }
    let kind = seen.start().agents[slot].kind;
    let drives = matches!(kind, AgentKind::Vehicle | AgentKind::Cyclist)
        && velocity.dot(&direction(now.heading)) > 0.0;
    if !drives {
        let at = |k: usize| {
            let p = now.position() + velocity * (DT * k as f64);
            AgentState { x: p.x, y: p.y, vx: velocity.x, vy: velocity.y, ..now }
        };
        return (1..=steps).map(at).collect();
    }
    let length = LEADER_RANGE.max(speed * DT * steps as f64 + HEADING_CHORD) + SPACING;
    let path = path_ahead(seen, now, length);
    let ahead = leader(seen, slot, &path);
    drive(now, speed, &path, ahead, steps)
}

/// Returns the velocity of an agent from its last two positions, as in rollouts, m/s.
fn current_velocity(track: &[Frame], now: AgentState) -> Vec2 {
    match track {
        [.., Some(before), Some(_)] => (now.position() - before.position()) / DT,
        _ => now.velocity().unwrap_or_default(),
    }
}

/// Returns the points of the path ahead, the first at the agent.
fn path_ahead(seen: &Observation<'_>, now: AgentState, length: f64) -> Vec<Vec2> {
    let (here, ahead) = (now.position(), direction(now.heading));
    let count = (length / SPACING).ceil() as usize + 1;
    let road = seen.start().road();
    let mut hits = Vec::new();
    road.lanes_near(here, MAX_LANE_OFFSET, &mut hits);
    let turned = |h: &reactsim_scene::LaneHit| {
        direction(road.lane(h.lane).baseline.heading_at(h.projection.s)).dot(&ahead)
    };
    let own = hits.iter().filter(|h| turned(h) > MIN_LANE_COSINE).min_by(|a, b| {
        let cost = |h: &reactsim_scene::LaneHit| h.projection.distance + 3.0 * (1.0 - turned(h));
        cost(a).total_cmp(&cost(b)).then(a.lane.cmp(&b.lane))
    });
    let Some(own) = own else {
        return (0..count).map(|k| here + ahead * (k as f64 * SPACING)).collect();
    };
    let (mut lane, mut s) = (own.lane, own.projection.s);
    let line = &road.lane(lane).baseline;
    let aside = into_frame(direction(line.heading_at(s)), here - line.at(s)).y;
    let mut points = vec![here];
    let mut lanes = 0;
    while points.len() < count {
        let line = &road.lane(lane).baseline;
        s += SPACING;
        if s > line.length() && lanes < MAX_LANES {
            let end = direction(line.heading_at(line.length()));
            let straight = |&next: &usize| {
                let next = &road.lane(next).baseline;
                direction(next.heading_at(next.length())).dot(&end)
            };
            let next = road.lane(lane).successors.iter().copied();
            if let Some(next) = next.reduce(|a, b| if straight(&b) > straight(&a) { b } else { a }) {
                s -= line.length();
                (lane, lanes) = (next, lanes + 1);
            }
        }
        let line = &road.lane(lane).baseline;
        points.push(line.at(s) + left(direction(line.heading_at(s.min(line.length())))) * aside);
    }
    points
}

/// Returns the leader on the path: its gap, metres, and its speed along the path, m/s.
fn leader(seen: &Observation<'_>, slot: usize, path: &[Vec2]) -> Option<(f64, f64)> {
    let agents = &seen.start().agents;
    let me = &agents[slot];
    let mut nearest: Option<(f64, f64)> = None;
    for (other, agent) in agents.iter().enumerate() {
        let Some(state) = seen.state(other).filter(|_| other != slot) else { continue };
        let reach = 0.5 * (me.width + agent.width) + 0.3;
        let meets = path.windows(2).enumerate().find_map(|(k, pair)| {
            let ahead = (pair[1] - pair[0]).try_normalize(1e-9)?;
            let at = into_frame(ahead, state.position() - pair[0]);
            (at.x >= 0.0 && at.x < SPACING && at.y.abs() < reach)
                .then_some((k as f64 * SPACING + at.x, ahead))
        });
        if let Some((s, ahead)) = meets.filter(|(s, _)| *s <= LEADER_RANGE && *s > 0.5) {
            let gap = s - 0.5 * (me.length + agent.length);
            let speed = current_velocity(seen.track(other), state).dot(&ahead);
            if nearest.is_none_or(|n| gap < n.0) {
                nearest = Some((gap, speed));
            }
        }
    }
    nearest
}

fn drive(
    now: AgentState,
    speed: f64,
    path: &[Vec2],
    ahead: Option<(f64, f64)>,
    steps: usize,
) -> Vec<AgentState> {
    let point = |s: f64| {
        let k = ((s / SPACING) as usize).min(path.len() - 2);
        path[k] + (path[k + 1] - path[k]) * (s / SPACING - k as f64)
    };
    let desired = speed;
    let (mut v, mut s, mut gap) = (speed, 0.0, ahead.map(|a| a.0));
    let mut last = now;
    let mut states = Vec::with_capacity(steps);
    for _ in 0..steps {
        let free = 1.0 - {
            let u = v / desired;
            u * u * u * u
        };
        let mut acceleration = ACCELERATION * free;
        if let (Some(gap), Some((_, other))) = (gap, ahead) {
            let closing = v * (v - other) / (2.0 * (ACCELERATION * DECELERATION).sqrt());
            let desired_gap = STANDSTILL_GAP + (TIME_GAP * v + closing).max(0.0);
            let ratio = desired_gap / gap.max(0.1);
            acceleration = ACCELERATION * (free - ratio * ratio);
        }
        v = (v + acceleration.clamp(-MAX_DECELERATION, ACCELERATION) * DT).max(0.0);
        s += v * DT;
        if let (Some(gap), Some((_, other))) = (&mut gap, ahead) {
            *gap += (other - v) * DT;
        }
        let at = point(s);
        let before = last.position();
        let moved = (at - before) / DT;
        let mut heading = last.heading;
        if v > STANDSTILL_SPEED {
            // The path may bend sharply where lanes meet; a chord over a few metres does not.
            let chord = point(s + HEADING_CHORD) - at;
            let turn = reactsim_geometry::wrap(heading_of(chord) - heading);
            heading += turn * (v * DT / HEADING_CHORD).min(1.0);
        }
        last = AgentState { x: at.x, y: at.y, heading, vx: moved.x, vy: moved.y };
        states.push(last);
    }
    debug_assert!(math::hypot(last.x, last.y).is_finite());
    states
}
