//! Small random scenes: overlapping lanes and connectors, drivable polygons or edges, agents that come, go
//! and turn around.

use std::f64::consts::{PI, TAU};

use rand_chacha::rand_core::Rng;
use reactsim_geometry::{Polygon, Polyline, Vec2, direction};
use reactsim_metrics::{Case, LoggedTrack, Object, Options};
use reactsim_rollout::{Purpose, Stream, stream};
use reactsim_scene::{
    Agent, AgentKind, AgentState, CURRENT, DT, FRAMES, Frame, HISTORY, Lane, LaneArea, LaneClass, LaneKind,
    LoggedAgent, MapIndex, Road, RoadEdge, RoadEdgeKind, RoadMap,
};

/// A scene with its log; owns everything that a case borrows.
pub(super) struct Scene {
    pub(super) map: RoadMap,
    pub(super) index: MapIndex,
    pub(super) agents: Vec<LoggedAgent>,
    pub(super) log: Vec<Vec<Frame>>,
    pub(super) av: usize,
}

impl Scene {
    pub(super) fn new(map: RoadMap, agents: Vec<LoggedAgent>, log: Vec<Vec<Frame>>, av: usize) -> Self {
        Self { index: MapIndex::new(&map), map, agents, log, av }
    }

    pub(super) fn case(&self, options: Options) -> Case<'_> {
        let objects =
            self.agents.iter().map(|a| Object { agent: &a.agent, track: (&a.track).into() }).collect();
        let log = self.log.iter().map(|t| LoggedTrack {
            history: &t[..HISTORY],
            future: &t[HISTORY..],
            recorded_history: None,
        });
        Case::new(Road::new(&self.map, &self.index), objects, self.av, options)
            .with_log(log.collect())
            .with_rollouts(vec![self.agents.iter().map(|a| &a.track[HISTORY..]).collect()])
    }
}

/// A car of 4 by 2 m.
pub(super) fn car(id: &str, track: Vec<Frame>) -> LoggedAgent {
    let agent = Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
    LoggedAgent { agent, track, heights: Vec::new() }
}

pub(super) struct Dice(Stream);

impl Dice {
    pub(super) fn new(seed: u64) -> Self {
        Self(stream(seed, "random scene", 0, Purpose::Begin))
    }

    pub(super) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn chance(&mut self, p: f64) -> bool {
        self.within(0.0, 1.0) < p
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.within(0.0, n as f64) as usize).min(n - 1)
    }
}

fn rectangle(center: Vec2, heading: f64, length: f64, width: f64) -> Vec<Vec2> {
    let (a, l) = (direction(heading) * length / 2.0, direction(heading + PI / 2.0) * width / 2.0);
    vec![center + a + l, center - a + l, center - a - l, center + a - l]
}

fn lane(dice: &mut Dice, id: usize, lanes: usize, heading: f64) -> Lane {
    let center = Vec2::new(dice.within(-15.0, 15.0), dice.within(-15.0, 15.0));
    let (length, width) = (dice.within(20.0, 60.0), dice.within(3.0, 9.0));
    let half = direction(heading) * length / 2.0;
    let bend = direction(heading + PI / 2.0) * dice.within(-1.0, 1.0);
    let links = |dice: &mut Dice| (0..2).map(|_| dice.below(lanes)).filter(|&l| l != id).collect();
    Lane {
        id: id.to_string(),
        kind: if dice.chance(0.3) { LaneKind::Lane } else { LaneKind::Connector },
        class: LaneClass::Undefined,
        speed_limit: None,
        baseline: Polyline::new(&[center - half, center + bend, center + half]).unwrap(),
        area: LaneArea::Polygon(rectangle(center, heading, length, width)),
        successors: links(dice),
        predecessors: links(dice),
        left: Vec::new(),
        right: Vec::new(),
    }
}

fn map(dice: &mut Dice) -> RoadMap {
    let lanes = 7;
    let base = dice.within(0.0, TAU);
    let mut map = RoadMap {
        lanes: (0..lanes)
            .map(|i| {
                let turn = if dice.chance(0.5) { PI } else { 0.0 };
                let off = dice.within(-0.3, 0.3);
                lane(dice, i, lanes, base + turn + off)
            })
            .collect(),
        intersections: vec![rectangle(Vec2::new(dice.within(-9.0, 9.0), 0.0), base, 30.0, 30.0)],
        ..RoadMap::default()
    };
    if dice.chance(0.5) {
        let hole = rectangle(Vec2::new(dice.within(-9.0, 9.0), 4.0), base, 6.0, 6.0);
        map.drivable_area = Some(vec![
            Polygon { exterior: rectangle(Vec2::zeros(), base, 60.0, 25.0), holes: vec![hole] },
            Polygon { exterior: rectangle(Vec2::zeros(), base + 1.0, 50.0, 12.0), holes: Vec::new() },
        ]);
    } else {
        for _ in 0..4 {
            let mut p = Vec2::new(dice.within(-25.0, 25.0), dice.within(-25.0, 25.0));
            let mut heading = dice.within(0.0, TAU);
            let mut points = vec![p];
            for _ in 0..6 {
                heading += dice.within(-1.5, 1.5);
                p += direction(heading) * dice.within(2.0, 9.0);
                points.push(p);
            }
            if dice.chance(0.3) {
                points.push(points[0]);
            }
            map.road_edges.push(RoadEdge { kind: RoadEdgeKind::Unknown, points });
        }
    }
    map
}

fn track(dice: &mut Dice) -> Vec<Frame> {
    let mut p = Vec2::new(dice.within(-15.0, 15.0), dice.within(-15.0, 15.0));
    let mut heading = dice.within(-7.0, 7.0);
    let mut speed = if dice.chance(0.2) { 0.0 } else { dice.within(0.0, 9.0) };
    let (turn, with_state) = (dice.within(-0.06, 0.06), dice.chance(0.6));
    let backing = dice.chance(0.2);
    let mut frames = Vec::with_capacity(FRAMES);
    let mut absent = 0;
    for f in 0..FRAMES {
        let sign = if backing { -1.0 } else { 1.0 };
        let v = direction(heading) * speed * sign;
        p += v * DT;
        heading += turn * speed.min(3.0);
        speed = (speed + dice.within(-0.8, 0.8)).max(0.0);
        if dice.chance(0.03) {
            absent = dice.below(6);
        }
        absent = if f == CURRENT { 0_usize } else { absent.saturating_sub(1) };
        let (vx, vy) = if with_state && dice.chance(0.97) { (v.x, v.y) } else { (f64::NAN, f64::NAN) };
        frames.push((absent == 0).then_some(AgentState { x: p.x, y: p.y, heading, vx, vy }));
    }
    frames
}

pub(super) fn random(seed: u64) -> Scene {
    let mut dice = Dice::new(seed);
    let map = map(&mut dice);
    let kinds = [AgentKind::Vehicle, AgentKind::Vehicle, AgentKind::Pedestrian, AgentKind::Cyclist];
    let agents: Vec<LoggedAgent> = (0..7)
        .map(|i| {
            let kind = match i {
                0..=2 => AgentKind::Vehicle,
                6 => AgentKind::Other,
                _ => kinds[dice.below(4)],
            };
            let (length, width) = match kind {
                AgentKind::Vehicle => (dice.within(3.5, 6.0), dice.within(1.6, 2.4)),
                _ => (dice.within(0.5, 2.0), dice.within(0.4, 0.9)),
            };
            let agent = Agent { id: format!("a{i}"), kind, length, width };
            LoggedAgent { agent, track: track(&mut dice), heights: Vec::new() }
        })
        .collect();
    let log = agents
        .iter()
        .map(|a| {
            let (dx, dy) = (dice.within(-0.1, 0.1), dice.within(-0.1, 0.1));
            let shifted = |(f, s): (usize, &Frame)| {
                let k = f.saturating_sub(CURRENT) as f64;
                s.map(|s| AgentState { x: s.x + dx * k, y: s.y + dy * k, ..s })
            };
            a.track.iter().enumerate().map(shifted).collect()
        })
        .collect();
    Scene::new(map, agents, log, 0)
}
