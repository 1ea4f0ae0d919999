//! Red lights and stop signs are obeyed.

use reactsim::geometry::{Vec2, direction, left};
use reactsim::scene::{AgentState, FRAMES, Frame, LightState, LoggedAgent, RoadMap, Scenario, StopKind};

use super::sample::{obeyed, parked};

/// Tolerance in metres: if a step passes several lines, those at most this much farther aside than the
/// nearest one count.
const ASIDE: f64 = 0.4;
/// Distance over which an agent that passes a line is followed to find its lane, metres.
const FOLLOWED: f64 = 30.0;
/// Tolerance in metres: a lane that fits the motion of an agent worse than the best one by more than this is
/// not its lane.
const WORSE: f64 = 0.8;
/// Distance to the line within which a vehicle stops at a sign, metres, and speed below which it has stopped,
/// m/s.
const AT_LINE: f64 = 6.0;
const STOPPED: f64 = 0.5;

fn front(s: AgentState, a: &LoggedAgent) -> Vec2 {
    s.position() + direction(s.heading) * (0.5 * a.agent.length)
}

/// Returns the frames after which the front of an agent is over stop lines of a kind, and the lanes of these
/// lines.
fn passed(map: &RoadMap, kind: StopKind, a: &LoggedAgent) -> Vec<(usize, Vec<usize>)> {
    let lines: Vec<_> = map.stop_lines.iter().filter(|l| l.kind == kind).collect();
    let mut all = Vec::new();
    for f in 1..FRAMES {
        let (Some(from), Some(to)) = (a.track[f - 1], a.track[f]) else { continue };
        let (p, q) = (front(from, a), front(to, a));
        let mut hits: Vec<(f64, usize)> = Vec::new();
        for line in &lines {
            let (at, along) = {
                let baseline = &map.lanes[line.lane].baseline;
                (baseline.at(line.s), direction(baseline.heading_at(line.s)))
            };
            let (before, after) = ((p - at).dot(&along), (q - at).dot(&along));
            let (aside, same_way) =
                ((q - at).dot(&left(along)).abs(), direction(to.heading).dot(&along) > 0.7);
            if before < 0.0 && after >= 0.0 && aside < 1.75 && same_way {
                hits.push((aside, line.lane));
            }
        }
        let least = hits.iter().map(|h| h.0).fold(f64::INFINITY, f64::min);
        let lanes: Vec<usize> = hits.iter().filter(|h| h.0 <= least + ASIDE).map(|h| h.1).collect();
        if !lanes.is_empty() {
            all.push((f, lanes));
        }
    }
    all
}

/// Returns the lanes among these that an agent may have taken from a frame on, by its motion.
fn taken(map: &RoadMap, lanes: &[usize], track: &[Frame]) -> Vec<usize> {
    let states: Vec<AgentState> = track.iter().map_while(|s| *s).collect();
    let begin = states[0].position();
    let near = states.iter().take_while(|s| (s.position() - begin).norm() < FOLLOWED);
    let places: Vec<Vec2> = near.map(AgentState::position).collect();
    // Largest distance of the positions from a lane and its successors.
    let misfit = |lane: usize| {
        let ways: Vec<usize> =
            std::iter::once(lane).chain(map.lanes[lane].successors.iter().copied()).collect();
        let ahead = |p: &&Vec2| map.lanes[lane].baseline.project(**p).s > 0.0;
        let aside = |p: &Vec2| {
            ways.iter().map(|w| map.lanes[*w].baseline.project(*p).distance).fold(f64::INFINITY, f64::min)
        };
        places.iter().filter(ahead).map(aside).fold(0.0, f64::max)
    };
    let least = lanes.iter().map(|&l| misfit(l)).fold(f64::INFINITY, f64::min);
    lanes.iter().copied().filter(|&l| misfit(l) <= least + WORSE).collect()
}

fn shows(scenario: &Scenario, lane: usize, frame: usize) -> Option<LightState> {
    let light = scenario.start.lights.iter().position(|l| l.lane == lane)?;
    scenario.light_states(light)[frame]
}

#[test]
fn nobody_runs_a_red_light() {
    let judged = obeyed(|generated, breaches| {
        let (scenario, map) = (&generated.scenario, &generated.scenario.start.map);
        for a in generated.on_wheels().filter(|a| !parked(a)) {
            for (f, lanes) in passed(map, StopKind::Light, a) {
                breaches.judge();
                let lanes = taken(map, &lanes, &a.track[f..]);
                // The light before the line was passed counts.
                let red = |l: &&usize| shows(scenario, **l, f - 1).is_some_and(LightState::is_red);
                if lanes.iter().all(|l| red(&l)) {
                    let (lane, speed) = (&map.lanes[lanes[0]].id, a.track[f].map_or(0.0, |s| s.speed()));
                    breaches.note(
                        &a.agent.id,
                        f,
                        format_args!("drives into {lane} at {speed:.1} m/s on red"),
                    );
                }
            }
        }
    });
    assert!(judged > 100, "only {judged} passed a light");
}

#[test]
fn everybody_stops_at_stop_signs() {
    let judged = obeyed(|generated, breaches| {
        let map = &generated.scenario.start.map;
        for a in generated.on_wheels().filter(|a| !parked(a)) {
            for (f, lanes) in passed(map, StopKind::Sign, a) {
                let line = front(a.track[f].unwrap(), a);
                let states: Vec<AgentState> = a.track[..f].iter().flatten().copied().collect();
                let distance = |s: &AgentState| (front(*s, a) - line).norm();
                // A vehicle that was nearer at the first frame may have stopped before.
                let recorded = distance(&states[0]) >= AT_LINE;
                let stopped = states.iter().any(|s| distance(s) < AT_LINE && s.speed() < STOPPED);
                if recorded || stopped {
                    breaches.judge();
                }
                if recorded && !stopped {
                    let (lane, speed) = (&map.lanes[lanes[0]].id, a.track[f].map_or(0.0, |s| s.speed()));
                    breaches.note(&a.agent.id, f, format_args!("drives into {lane} at {speed:.1} m/s"));
                }
            }
        }
    });
    assert!(judged > 10, "only {judged} passed a sign");
}
