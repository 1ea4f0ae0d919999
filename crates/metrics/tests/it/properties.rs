//! The metrics depend neither on the axes of the world nor on the order of agents.

use proptest::prelude::*;
use reactsim_geometry::{Polygon, Polyline, Vec2};
use reactsim_metrics::{DirTracking, Options, Scores, score_case};
use reactsim_scene::{AgentState, Frame, Lane, LaneArea, LoggedAgent, RoadEdge, RoadMap};

use super::scenes::{self, Scene};

struct Motion {
    angle: f64,
    shift: Vec2,
}

impl Motion {
    fn turn(&self, v: Vec2) -> Vec2 {
        let (sin, cos) = self.angle.sin_cos();
        Vec2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
    }

    fn point(&self, p: &Vec2) -> Vec2 {
        self.turn(*p) + self.shift
    }

    fn points(&self, points: &[Vec2]) -> Vec<Vec2> {
        points.iter().map(|p| self.point(p)).collect()
    }

    fn track(&self, track: &[Frame]) -> Vec<Frame> {
        let moved = |s: AgentState| {
            let (p, v) = (self.point(&s.position()), self.turn(Vec2::new(s.vx, s.vy)));
            AgentState { x: p.x, y: p.y, heading: s.heading + self.angle, vx: v.x, vy: v.y }
        };
        track.iter().map(|s| s.map(moved)).collect()
    }

    fn map(&self, map: &RoadMap) -> RoadMap {
        let lane = |l: &Lane| Lane {
            baseline: Polyline::new(&self.points(l.baseline.points())).unwrap(),
            area: match &l.area {
                LaneArea::Polygon(ring) => LaneArea::Polygon(self.points(ring)),
                corridor => corridor.clone(),
            },
            ..l.clone()
        };
        let area = |p: &Polygon| Polygon {
            exterior: self.points(&p.exterior),
            holes: p.holes.iter().map(|h| self.points(h)).collect(),
        };
        RoadMap {
            lanes: map.lanes.iter().map(lane).collect(),
            road_edges: map
                .road_edges
                .iter()
                .map(|e| RoadEdge { kind: e.kind, points: self.points(&e.points) })
                .collect(),
            intersections: map.intersections.iter().map(|r| self.points(r)).collect(),
            drivable_area: map.drivable_area.as_ref().map(|a| a.iter().map(area).collect()),
            ..RoadMap::default()
        }
    }

    fn scene(&self, scene: &Scene) -> Scene {
        let agents = scene.agents.iter();
        let agents = agents.map(|a| LoggedAgent { track: self.track(&a.track), ..a.clone() }).collect();
        let log = scene.log.iter().map(|t| self.track(t)).collect();
        Scene::new(self.map(&scene.map), agents, log, scene.av)
    }
}

/// Checks that all values are equal within rounding, and that the events are the same.
fn same(a: &Scores, b: &Scores) -> Result<(), TestCaseError> {
    for ((spec, a), (_, b)) in a.values.iter().zip(&b.values) {
        let (a, b) = (a.and_then(|s| s.value()), b.and_then(|s| s.value()));
        let close = match (a, b) {
            (Some(a), Some(b)) => (a - b).abs() < 1e-9 * (1.0 + a.abs()),
            (a, b) => a == b,
        };
        prop_assert!(close, "{}: {a:?} and {b:?}", spec.id);
    }
    let key = |s: &Scores| {
        let mut keys: Vec<_> = s
            .events
            .iter()
            .map(|e| {
                let mut pair = [Some(e.agent.clone()), e.partner.clone()];
                pair.sort();
                (e.metric, e.step, e.last_step, pair, e.reason, e.counted)
            })
            .collect();
        keys.sort();
        keys
    };
    prop_assert_eq!(key(a), key(b));
    Ok(())
}

fn options(pointwise: bool) -> Options {
    let dir_tracking = if pointwise { DirTracking::Pointwise } else { DirTracking::Route };
    Options { dir_tracking, aa_include_av: pointwise, ..Options::default() }
}

proptest! {
    #[test]
    fn rigid_motion_changes_nothing(
        seed in any::<u64>(), angle in -3.0..3.0_f64, x in -900.0..900.0_f64, y in -900.0..900.0_f64, pointwise: bool,
    ) {
        let scene = scenes::random(seed);
        let moved = Motion { angle, shift: Vec2::new(x, y) }.scene(&scene);
        same(&score_case(&scene.case(options(pointwise))), &score_case(&moved.case(options(pointwise))))?;
    }

    #[test]
    fn renumbering_changes_nothing(seed in any::<u64>(), turn in 1_usize..7, pointwise: bool) {
        let scene = scenes::random(seed);
        let n = scene.agents.len();
        let order = |i: usize| (i * 3 + turn) % n;
        let agents = (0..n).map(|i| scene.agents[order(i)].clone()).collect();
        let log = (0..n).map(|i| scene.log[order(i)].clone()).collect();
        let av = (0..n).find(|&i| order(i) == scene.av).unwrap();
        let permuted = Scene::new(scene.map.clone(), agents, log, av);
        same(&score_case(&scene.case(options(pointwise))), &score_case(&permuted.case(options(pointwise))))?;
    }
}
