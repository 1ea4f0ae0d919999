//! What agents do that the network is not asked about: they follow their lane and whoever is ahead.

use reactsim::geometry::{Vec2, direction, heading_of, into_frame, left, math};
use reactsim::rollout::Observation;
use reactsim::scene::{AgentKind, AgentState, DT, Frame};

/// Slower agents stand, m/s.
const STANDS: f64 = 0.3;
/// A lane that is farther aside, or more across, is not followed, metres and cosine.
const ASIDE: f64 = 2.5;
const ALONG: f64 = 0.7;
/// Points of the way, metres apart.
const SPACING: f64 = 2.0;
/// How far ahead others are looked for, metres.
const SIGHT: f64 = 60.0;
/// Lanes that are followed, one after the other, at most.
const LANES: usize = 20;
/// The intelligent driver model (Treiber, Hennecke, Helbing, Phys. Rev. E 62, 2000): acceleration and comfortable braking, m/s², gap in
/// seconds and metres.
const ACCELERATES: f64 = 1.5;
const BRAKES: f64 = 2.0;
const GAP_TIME: f64 = 1.2;
const GAP: f64 = 2.0;
/// Nobody brakes harder, m/s².
const HARDEST: f64 = 5.5;
/// Between turns of a lane the heading changes over so many metres.
const SMOOTH: f64 = 3.0;

/// The states of an agent after 0.1 s, 0.2 s and so on. Vehicles and cyclists on a lane go along it at their speed, as far aside as they
/// are, and keep their distance from whoever is ahead if all go on as they do; everybody else goes straight on. Who stands stays.
pub(super) fn follow(seen: &Observation<'_>, slot: usize, now: AgentState, steps: usize) -> Vec<AgentState> {
    let velocity = moving(seen.track(slot), now);
    let speed = velocity.norm();
    if speed < STANDS {
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
    let length = SIGHT.max(speed * DT * steps as f64 + SMOOTH) + SPACING;
    let way = way(seen, now, length);
    let ahead = leader(seen, slot, &way);
    drive(now, speed, &way, ahead, steps)
}

/// How somebody moves, m/s: by the last two positions, as in rollouts.
fn moving(track: &[Frame], now: AgentState) -> Vec2 {
    match track {
        [.., Some(before), Some(_)] => (now.position() - before.position()) / DT,
        _ => now.velocity().unwrap_or_default(),
    }
}

/// Points of the way ahead, the first one where the agent is.
fn way(seen: &Observation<'_>, now: AgentState, length: f64) -> Vec<Vec2> {
    let (here, ahead) = (now.position(), direction(now.heading));
    let count = (length / SPACING).ceil() as usize + 1;
    let road = seen.start().road();
    let mut hits = Vec::new();
    road.lanes_near(here, ASIDE, &mut hits);
    let turned = |h: &reactsim::scene::LaneHit| {
        direction(road.lane(h.lane).baseline.heading_at(h.projection.s)).dot(&ahead)
    };
    let own = hits.iter().filter(|h| turned(h) > ALONG).min_by(|a, b| {
        let cost = |h: &reactsim::scene::LaneHit| h.projection.distance + 3.0 * (1.0 - turned(h));
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
        if s > line.length() && lanes < LANES {
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

/// Whoever is next on the way: the gap to him, metres, and his speed along it, m/s.
fn leader(seen: &Observation<'_>, slot: usize, way: &[Vec2]) -> Option<(f64, f64)> {
    let agents = &seen.start().agents;
    let me = &agents[slot];
    let mut nearest: Option<(f64, f64)> = None;
    for (other, agent) in agents.iter().enumerate() {
        let Some(state) = seen.state(other).filter(|_| other != slot) else { continue };
        let reach = 0.5 * (me.width + agent.width) + 0.3;
        let meets = way.windows(2).enumerate().find_map(|(k, pair)| {
            let ahead = (pair[1] - pair[0]).try_normalize(1e-9)?;
            let at = into_frame(ahead, state.position() - pair[0]);
            (at.x >= 0.0 && at.x < SPACING && at.y.abs() < reach)
                .then_some((k as f64 * SPACING + at.x, ahead))
        });
        if let Some((s, ahead)) = meets.filter(|(s, _)| *s <= SIGHT && *s > 0.5) {
            let gap = s - 0.5 * (me.length + agent.length);
            let speed = moving(seen.track(other), state).dot(&ahead);
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
    way: &[Vec2],
    ahead: Option<(f64, f64)>,
    steps: usize,
) -> Vec<AgentState> {
    let point = |s: f64| {
        let k = ((s / SPACING) as usize).min(way.len() - 2);
        way[k] + (way[k + 1] - way[k]) * (s / SPACING - k as f64)
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
        let mut acceleration = ACCELERATES * free;
        if let (Some(gap), Some((_, other))) = (gap, ahead) {
            let closing = v * (v - other) / (2.0 * (ACCELERATES * BRAKES).sqrt());
            let wanted = GAP + (GAP_TIME * v + closing).max(0.0);
            let ratio = wanted / gap.max(0.1);
            acceleration = ACCELERATES * (free - ratio * ratio);
        }
        v = (v + acceleration.clamp(-HARDEST, ACCELERATES) * DT).max(0.0);
        s += v * DT;
        if let (Some(gap), Some((_, other))) = (&mut gap, ahead) {
            *gap += (other - v) * DT;
        }
        let at = point(s);
        let before = last.position();
        let moved = (at - before) / DT;
        let mut heading = last.heading;
        if v > STANDS {
            // The way may bend sharply where lanes meet: a chord over some metres does not.
            let chord = point(s + SMOOTH) - at;
            let turn = reactsim::geometry::wrap(heading_of(chord) - heading);
            heading += turn * (v * DT / SMOOTH).min(1.0);
        }
        last = AgentState { x: at.x, y: at.y, heading, vx: moved.x, vy: moved.y };
        states.push(last);
    }
    debug_assert!(math::hypot(last.x, last.y).is_finite());
    states
}
