//! A slow implementation of the definitions, sentence by sentence and without any index, compared on random
//! scenes.

use std::f64::consts::{PI, TAU};

use reactsim_geometry::Vec2;
use reactsim_metrics::{DirConnector, DirTracking, Options};
use reactsim_scene::{AgentKind, AgentState, CURRENT, FRAMES, Lane, LaneArea, LaneKind, RoadMap};

use super::scenes::{self, Scene};

fn wrap(a: f64) -> f64 {
    (a + PI).rem_euclid(TAU) - PI
}

fn speed(scene: &Scene, i: usize, f: usize) -> Option<f64> {
    let track = &scene.agents[i].track;
    let here = track[f]?;
    if here.vx.is_finite() && here.vy.is_finite() {
        return Some(here.vx.hypot(here.vy));
    }
    let before = if f > 0 { track[f - 1] } else { None };
    let after = track.get(f + 1).copied().flatten();
    let step = |a: AgentState, b: AgentState| (b.x - a.x).hypot(b.y - a.y) / 0.1;
    before.map(|b| step(b, here)).or(after.map(|a| step(here, a)))
}

fn segment_distance(p: Vec2, a: Vec2, b: Vec2) -> f64 {
    let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
    (p - (a + (b - a) * t)).norm()
}

fn rings_edges(ring: &[Vec2]) -> impl Iterator<Item = (Vec2, Vec2)> {
    (0..ring.len()).map(|i| (ring[i], ring[(i + 1) % ring.len()]))
}

fn inside(p: Vec2, ring: &[Vec2]) -> bool {
    // Winding by angles; random points are never on the boundary.
    let angle: f64 =
        rings_edges(ring).map(|(a, b)| (a - p).perp(&(b - p)).atan2((a - p).dot(&(b - p)))).sum();
    angle.abs() > PI
}

fn on_lane(lane: &Lane, p: Vec2) -> bool {
    matches!(&lane.area, LaneArea::Polygon(ring) if inside(p, ring))
}

fn lane_distance(lane: &Lane, p: Vec2) -> f64 {
    let LaneArea::Polygon(ring) = &lane.area else { return f64::INFINITY };
    if inside(p, ring) {
        return 0.0;
    }
    rings_edges(ring).map(|(a, b)| segment_distance(p, a, b)).fold(f64::INFINITY, f64::min)
}

fn project(lane: &Lane, p: Vec2) -> (f64, f64) {
    let points = lane.baseline.points();
    let (mut best, mut s0, mut found) = (f64::INFINITY, 0.0, (0.0, 0.0));
    for w in points.windows(2) {
        let d = w[1] - w[0];
        let t = ((p - w[0]).dot(&d) / d.norm_squared()).clamp(0.0, 1.0);
        let distance = segment_distance(p, w[0], w[1]);
        if distance < best - 1e-12 {
            best = distance;
            found = (s0 + t * d.norm(), d.y.atan2(d.x));
        }
        s0 += d.norm();
    }
    found
}

fn offroad(map: &RoadMap, p: Vec2) -> bool {
    if let Some(area) = &map.drivable_area {
        return !area.iter().any(|a| inside(p, &a.exterior) && !a.holes.iter().any(|h| inside(p, h)));
    }
    let mut best = (f64::INFINITY, 0, 0);
    for (e, edge) in map.road_edges.iter().enumerate() {
        for (i, w) in edge.points.windows(2).enumerate() {
            let d = segment_distance(p, w[0], w[1]);
            if d < best.0 - 1e-12 {
                best = (d, e, i);
            }
        }
    }
    let points = &map.road_edges[best.1].points;
    let (n, i) = (points.len() - 1, best.2);
    let seg = |i: usize| (points[i], points[i + 1]);
    let right = |i: usize| (seg(i).1 - seg(i).0).perp(&(p - seg(i).0)) < 0.0;
    let closed = (points[0] - points[n]).norm() < 1.0;
    let (a, b) = seg(i);
    let t = (p - a).dot(&(b - a)) / (b - a).norm_squared();
    let pair = if t < 0.0 {
        if i > 0 { Some((i - 1, i)) } else { closed.then_some((n - 1, 0)) }
    } else if t >= 1.0 {
        if i + 1 < n { Some((i, i + 1)) } else { closed.then_some((n - 1, 0)) }
    } else {
        None
    };
    let Some((before, after)) = pair else { return right(i) };
    let turn = (seg(before).1 - seg(before).0).perp(&(seg(after).1 - seg(after).0));
    if turn > 0.0 { right(before) || right(after) } else { right(before) && right(after) }
}

fn route(map: &RoadMap, poses: &[Vec2]) -> Vec<Vec<usize>> {
    let lanes = &map.lanes;
    let connector = |list: &Vec<usize>| list.first().is_some_and(|&l| lanes[l].kind == LaneKind::Connector);
    let mut stored: Vec<Vec<usize>> = Vec::new();
    let mut cur: Vec<usize> = Vec::new();
    for (q, &p) in poses.iter().enumerate() {
        if !cur.is_empty() {
            let kept: Vec<usize> = cur.iter().copied().filter(|&l| on_lane(&lanes[l], p)).collect();
            cur = if kept.is_empty() && cur.len() == 1 {
                lanes[cur[0]].successors.iter().copied().filter(|&l| on_lane(&lanes[l], p)).collect()
            } else {
                kept
            };
        }
        if cur.is_empty() {
            let all: Vec<usize> = (0..lanes.len()).filter(|&l| on_lane(&lanes[l], p)).collect();
            cur = match all.iter().find(|&&l| lanes[l].kind == LaneKind::Lane) {
                Some(&lane) => vec![lane],
                None => all,
            };
            if q > 1 && connector(&stored[q - 1]) {
                let crossing = map.intersections.iter().any(|r| inside(p, r));
                if connector(&cur) || (cur.is_empty() && crossing) {
                    let near = stored[q - 1].iter().copied();
                    let near: Vec<usize> = near.filter(|&l| lane_distance(&lanes[l], p) < 5.0).collect();
                    if !near.is_empty() {
                        cur = near;
                    }
                }
            }
        }
        stored.push(cur.clone());
    }
    for q in (0..stored.len().saturating_sub(1)).rev() {
        let next = stored[q + 1].clone();
        if stored[q].len() > 1 {
            if stored[q].len() > next.len() && next.iter().all(|l| stored[q].contains(l)) {
                stored[q] = next.clone();
            }
            if next.first().is_some_and(|&l| lanes[l].kind == LaneKind::Lane) {
                let incoming = &lanes[next[0]].predecessors;
                let some: Vec<usize> = stored[q].iter().copied().filter(|l| incoming.contains(l)).collect();
                if !some.is_empty() {
                    stored[q] = some;
                }
            }
        }
    }
    stored
}

/// Returns whether the agent is a candidate, and the first step of each violation.
fn direction(scene: &Scene, agent: usize, options: &Options) -> (bool, Vec<usize>) {
    let track = &scene.agents[agent].track;
    let lanes = &scene.map.lanes;
    let (mut candidate, mut violations) = (false, Vec::new());
    let mut f = CURRENT;
    while f < FRAMES {
        let run: Vec<usize> = (f..FRAMES).take_while(|&f| track[f].is_some()).collect();
        f += run.len() + 1;
        let states: Vec<AgentState> = run.iter().map(|&f| track[f].unwrap()).collect();
        let points: Vec<Vec2> = states.iter().map(AgentState::position).collect();
        let lists = match options.dir_tracking {
            DirTracking::Route => route(&scene.map, &points),
            _ => points
                .iter()
                .map(|&p| (0..lanes.len()).filter(|&l| on_lane(&lanes[l], p)).collect())
                .collect(),
        };
        let least =
            options.dir_tracking != DirTracking::Route || options.dir_connector == DirConnector::MinHeading;
        let chosen: Vec<Option<usize>> = (0..run.len())
            .map(|q| {
                let error = |l: usize| wrap(states[q].heading - project(&lanes[l], points[q]).1).abs();
                let first = lists[q].first().copied();
                if !least {
                    return first;
                }
                lists[q].iter().copied().fold(first, |b, l| match b {
                    Some(b) if error(l) < error(b) => Some(l),
                    b => b,
                })
            })
            .collect();
        let ds: Vec<f64> = (0..run.len())
            .map(|q| match q.checked_sub(1).map(|b| (chosen[b], chosen[q])) {
                Some((Some(a), Some(b))) if a == b => {
                    project(&lanes[b], points[q]).0 - project(&lanes[a], points[q - 1]).0
                }
                _ => 0.0,
            })
            .collect();
        let mut count = 0;
        for q in 0..run.len() {
            let step = run[q] - CURRENT;
            let Some(lane) = chosen[q].filter(|_| step > 0) else {
                count = 0;
                continue;
            };
            candidate = true;
            let progress: f64 = ds[q.saturating_sub(9)..=q].iter().sum();
            let error = wrap(states[q].heading - project(&lanes[lane], points[q]).1).abs();
            let fast = speed(scene, agent, run[q]).is_some_and(|v| v > 1.0);
            count = if fast && error > 75.0 / 180.0 * PI && progress < -2.0 { count + 1 } else { 0 };
            if count == 5 {
                violations.push(step - 4);
            }
        }
    }
    (candidate, violations)
}

fn min_ttc(scene: &Scene, agent: usize) -> f64 {
    let mut least: f64 = 5.0;
    for f in CURRENT + 1..FRAMES {
        let (Some(me), Some(av)) = (scene.agents[agent].track[f], scene.agents[scene.av].track[f]) else {
            continue;
        };
        let (mine, other) = (&scene.agents[agent].agent, &scene.agents[scene.av].agent);
        let boxes = (me.footprint(mine), av.footprint(other));
        if reactsim_geometry::rounded_distance(&boxes.0, &boxes.1, 0.7) < 0.0 {
            return 0.0;
        }
        let (sin, cos) = me.heading.sin_cos();
        let d = av.position() - me.position();
        let (dx, dy) = (cos * d.x + sin * d.y, -sin * d.x + cos * d.y);
        let turned = wrap(av.heading - me.heading).abs();
        let (c, s) = (turned.cos().abs(), turned.sin().abs());
        let gap = dx - mine.length / 2.0 - (other.length / 2.0 * c + other.width / 2.0 * s);
        let beside = dy.abs() - mine.width / 2.0 - (other.length / 2.0 * s + other.width / 2.0 * c);
        let degrees = turned / PI * 180.0;
        let front = gap > 0.0 && degrees <= 75.0 && beside < 0.0 && (beside < -0.5 || degrees <= 10.0);
        if let (true, Some(a), Some(b)) = (front, speed(scene, agent, f), speed(scene, scene.av, f))
            && a - b > 0.0
        {
            least = least.min(gap / (a - b));
        }
    }
    least
}

#[test]
fn the_slow_reading_agrees_on_random_scenes() {
    let (mut violations, mut candidates, mut closing, mut off) = (0, 0, 0, 0);
    for seed in 0..250 {
        let scene = scenes::random(seed);
        for (tracking, connector) in [
            (DirTracking::Route, DirConnector::First),
            (DirTracking::Route, DirConnector::MinHeading),
            (DirTracking::Pointwise, DirConnector::First),
        ] {
            let options = Options { dir_tracking: tracking, dir_connector: connector, ..Options::default() };
            let case = scene.case(options);
            for i in 1..scene.agents.len() {
                if scene.agents[i].agent.kind != AgentKind::Vehicle {
                    continue;
                }
                let scores = case.agent_scores(i);
                let spells: Vec<usize> = scores.direction.intervals.iter().map(|s| s.first).collect();
                let (candidate, expected) = direction(&scene, i, &options);
                let name = format!("seed {seed}, agent {i}, {tracking:?} {connector:?}");
                assert_eq!((scores.direction.candidate, &spells), (candidate, &expected), "{name}");
                violations += expected.len();
                candidates += usize::from(candidate);
                let ttc = min_ttc(&scene, i);
                let found = scores.approach.unwrap().min_ttc;
                assert!((ttc - found).abs() < 1e-9, "{name}: {found}, expected {ttc}");
                closing += usize::from(0.0 < ttc && ttc < 5.0);
                let at = |f: usize| scene.agents[i].track[f].map(|s| offroad(&scene.map, s.position()));
                let expected = match at(CURRENT) {
                    Some(false) => (CURRENT + 1..FRAMES)
                        .filter_map(at)
                        .fold((0, 0), |(h, v), o| (h + u64::from(o), v + 1)),
                    _ => (0, 0),
                };
                assert_eq!((scores.off_road.hits, scores.off_road.valid), expected, "{name}");
                off += expected.0;
            }
        }
    }
    // The scenes cover the cases that they are made for.
    assert!(
        violations > 30 && candidates > 600 && closing > 20 && off > 1000,
        "{violations} {candidates} {closing} {off}"
    );
}

/// Corridors found through the index have the same lanes and projections as those found in every segment of
/// every lane.
#[test]
fn corridors_are_found_as_without_an_index() {
    let mut found = 0;
    for seed in 0..60 {
        let mut dice = scenes::Dice::new(seed);
        let mut map = scenes::random(seed).map;
        map.drivable_area = None;
        for lane in &mut map.lanes {
            let mut p = Vec2::new(dice.within(-30.0, 30.0), dice.within(-30.0, 30.0));
            let mut heading = dice.within(0.0, TAU);
            let mut points = vec![p];
            for _ in 0..40 {
                heading += dice.within(-0.4, 0.4);
                p += reactsim_geometry::direction(heading) * dice.within(0.2, 1.5);
                points.push(p);
            }
            lane.baseline = reactsim_geometry::Polyline::new(&points).unwrap();
            lane.area = LaneArea::Corridor { half_width: 1.75 };
        }
        let index = reactsim_scene::MapIndex::new(&map);
        let road = reactsim_scene::Road::new(&map, &index);
        let mut hits = Vec::new();
        for _ in 0..300 {
            let p = Vec2::new(dice.within(-60.0, 60.0), dice.within(-60.0, 60.0));
            road.lanes_at(p, &mut hits);
            let within = |lane: &Lane| {
                let points = lane.baseline.points();
                let last = points.len() - 2;
                points.windows(2).enumerate().any(|(i, w)| {
                    let t = (p - w[0]).dot(&(w[1] - w[0])) / (w[1] - w[0]).norm_squared();
                    let beyond = (i == 0 && t <= 0.0) || (i == last && t >= 1.0);
                    !beyond && segment_distance(p, w[0], w[1]) < 1.75
                })
            };
            let expected: Vec<usize> = (0..map.lanes.len()).filter(|&l| within(&map.lanes[l])).collect();
            assert_eq!(hits.iter().map(|h| h.lane).collect::<Vec<_>>(), expected, "seed {seed} at {p:?}");
            for hit in &hits {
                assert_eq!(hit.projection, map.lanes[hit.lane].baseline.project(p), "seed {seed} at {p:?}");
            }
            for lane in 0..map.lanes.len() {
                let hit = hits.iter().find(|h| h.lane == lane).map(|h| h.projection);
                assert_eq!(road.lane_at(p, lane), hit);
            }
            found += hits.len();
        }
    }
    assert!(found > 500, "{found}");
}
