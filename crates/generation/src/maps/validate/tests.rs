//! A valid map built by hand, and one violation of each rule at a time.

use reactsim_geometry::{Polygon, Polyline, Vec2};
use reactsim_scene::{
    Crosswalk, LaneArea, LaneKind, LaneParts, LightState, MapHeights, MapParts, NeighborParts, RoadEdge,
    RoadEdgeKind, StopKind, StopLineParts,
};

use super::super::super::{Entry, Footway, Layout, ParkingSpot, Priority, RightOfWay, SignalPlan};
use super::{Rule, validate};

fn v(x: f64, y: f64) -> Vec2 {
    Vec2::new(x, y)
}

fn rectangle(low: Vec2, high: Vec2) -> Vec<Vec2> {
    vec![low, v(high.x, low.y), high, v(low.x, high.y)]
}

/// Returns a straight lane, 3.5 m wide, with 11 points.
fn lane(id: &str, from: Vec2, to: Vec2) -> LaneParts {
    let half = reactsim_geometry::left((to - from).normalize()) * 1.75;
    LaneParts {
        id: id.into(),
        kind: if id.ends_with(".x") { LaneKind::Connector } else { LaneKind::Lane },
        speed_limit: Some(13.4),
        points: (0..=10).map(|i| from + (to - from) * (f64::from(i) / 10.0)).collect(),
        area: LaneArea::Polygon(vec![from - half, to - half, to + half, from + half]),
        ..LaneParts::default()
    }
}

/// Returns a map of two lanes to the east (`a0`, and `a1` on its left) that cross one to the north (`b`),
/// with lights, a crosswalk over `b.in` and a parking spot.
fn sound() -> Layout {
    let mut lanes = Vec::new();
    for (name, ends) in [
        ("a0", [v(-60.0, -1.75), v(-10.0, -1.75), v(10.0, -1.75), v(60.0, -1.75)]),
        ("a1", [v(-60.0, 1.75), v(-10.0, 1.75), v(10.0, 1.75), v(60.0, 1.75)]),
        ("b", [v(0.0, -40.0), v(0.0, -8.0), v(0.0, 8.0), v(0.0, 40.0)]),
    ] {
        let ids = [".in", ".x", ".out"].map(|part| format!("{name}{part}"));
        for i in 0..3 {
            let mut part = lane(&ids[i], ends[i], ends[i + 1]);
            part.successors.extend(ids.get(i + 1).cloned());
            part.predecessors.extend(i.checked_sub(1).map(|k| ids[k].clone()));
            lanes.push(part);
        }
    }
    let beside = |id: &str| NeighborParts {
        lane: id.into(),
        self_start: 0,
        self_end: 10,
        other_start: 0,
        other_end: 10,
    };
    for part in ["in", "out"] {
        let (right, left) = (format!("a0.{part}"), format!("a1.{part}"));
        for lane in &mut lanes {
            if lane.id == right {
                lane.left.push(beside(&left));
            } else if lane.id == left {
                lane.right.push(beside(&right));
            }
        }
    }
    let plan = |lane: &str, at: Vec2, phases: &[(LightState, f64)]| SignalPlan {
        lane: lane.into(),
        stop_point: at,
        phases: phases.to_vec(),
    };
    let east = [(LightState::Go, 20.0), (LightState::Caution, 3.0), (LightState::Stop, 27.0)];
    let north = [
        (LightState::Stop, 25.0),
        (LightState::Go, 20.0),
        (LightState::Caution, 3.0),
        (LightState::Stop, 2.0),
    ];
    let stop = |lane: &str, at: Vec2| StopLineParts { kind: StopKind::Light, lane: lane.into(), at };
    let edge = |from: Vec2, to: Vec2| RoadEdge { kind: RoadEdgeKind::Boundary, points: vec![from, to] };
    let polygon = |low: Vec2, high: Vec2| Polygon { exterior: rectangle(low, high), holes: Vec::new() };
    let walk = |from: Vec2, to: Vec2| Footway {
        line: Polyline::new(&[from, to]).unwrap(),
        heights: Vec::new(),
        width: 2.0,
        crossing: false,
        crosses: Vec::new(),
        waits_for: Vec::new(),
    };
    Layout {
        map: MapParts {
            lanes,
            road_edges: vec![
                edge(v(-60.0, -3.5), v(-1.75, -3.5)),
                edge(v(-1.75, 3.5), v(-60.0, 3.5)),
                edge(v(1.75, -40.0), v(1.75, -3.5)),
            ],
            stop_lines: vec![
                stop("a0.in", v(-11.0, -1.75)),
                stop("a1.in", v(-11.0, 1.75)),
                stop("b.in", v(0.0, -8.5)),
            ],
            crosswalks: vec![Crosswalk { outline: rectangle(v(-1.75, -7.5), v(1.75, -4.5)) }],
            drivable_area: Some(vec![
                polygon(v(-60.0, -3.5), v(60.0, 3.5)),
                polygon(v(-1.75, -40.0), v(1.75, 40.0)),
                polygon(v(20.0, 3.4), v(50.0, 6.0)),
            ]),
            ..MapParts::default()
        },
        signals: vec![
            plan("a0.x", v(-10.0, -1.75), &east),
            plan("a1.x", v(-10.0, 1.75), &east),
            plan("b.x", v(0.0, -8.0), &north),
        ],
        priorities: Vec::new(),
        entries: ["a0.in", "a1.in", "b.in"].map(|l| Entry { lane: l.into(), flow: 300.0 }).to_vec(),
        yards: Vec::new(),
        parking: vec![ParkingSpot { position: v(30.0, 4.85), heading: 0.0, length: 5.5, width: 2.0 }],
        footways: vec![
            walk(v(-40.0, -6.0), v(-3.0, -6.0)),
            walk(v(3.0, -6.0), v(40.0, -6.0)),
            Footway {
                crossing: true,
                crosses: vec!["b.x".into()],
                waits_for: vec!["b.x".into()],
                ..walk(v(-2.5, -6.0), v(2.5, -6.0))
            },
        ],
    }
}

/// Breaks the valid map and requires a flaw of this rule that contains `says`; other rules may be broken
/// along with it.
#[track_caller]
fn breaks(rule: Rule, says: &str, how: impl FnOnce(&mut Layout)) {
    let mut layout = sound();
    how(&mut layout);
    let flaws = validate(&layout);
    let found = flaws.iter().any(|f| f.rule == rule && f.text.contains(says));
    assert!(found, "no flaw of {rule:?} that says `{says}`: {flaws:#?}");
}

fn find<'a>(layout: &'a mut Layout, id: &str) -> &'a mut LaneParts {
    layout.map.lanes.iter_mut().find(|l| l.id == id).unwrap()
}

#[test]
fn a_sound_map_has_no_flaws() {
    assert_eq!(validate(&sound()), []);
}

#[test]
fn links() {
    breaks(Rule::Link, "does not link back", |l| find(l, "b.out").predecessors.clear());
    breaks(Rule::Link, "predecessor `b.in`", |l| find(l, "b.in").successors.clear());
    breaks(Rule::Link, "begins 0.020 m", |l| find(l, "b.out").points[0].x = 0.02);
    breaks(Rule::Link, "turns by", |l| find(l, "b.out").points[1].x = 0.4);
    breaks(Rule::Link, "repeats", |l| find(l, "b.x").successors.push("b.out".into()));
}

#[test]
fn centre_lines() {
    breaks(Rule::CentreLine, "b.out at (2.00", |l| find(l, "b.out").points[5].x = 2.0);
    breaks(Rule::CentreLine, "crosses itself", |l| {
        let points = &mut find(l, "b.out").points;
        points.truncate(4);
        points.extend([v(8.0, 30.0), v(8.0, 12.0), v(-8.0, 12.0)]);
    });
}

#[test]
fn outlines() {
    let ring = |l: &mut Layout, id: &str, ring: Vec<Vec2>| find(l, id).area = LaneArea::Polygon(ring);
    breaks(Rule::Outline, "the outline crosses itself", |l| {
        ring(l, "b.out", vec![v(-1.75, 8.0), v(1.75, 8.0), v(-1.75, 40.0), v(1.75, 40.0)]);
    });
    breaks(Rule::Outline, "the centre line leaves", |l| {
        ring(l, "b.out", rectangle(v(-1.75, 8.0), v(1.75, 20.0)));
    });
    breaks(Rule::Outline, "is outside", |l| ring(l, "b.out", rectangle(v(0.5, 8.0), v(1.75, 40.0))));
    breaks(Rule::Outline, "2 corners", |l| ring(l, "b.out", vec![v(0.5, 8.0), v(1.75, 40.0)]));
}

#[test]
fn ground_and_edges() {
    breaks(Rule::Drivable, "b.in", |l| {
        l.map.drivable_area.as_mut().unwrap()[1].exterior = rectangle(v(-1.75, -30.0), v(1.75, 40.0));
    });
    breaks(Rule::Drivable, "b.in", |l| {
        l.map.drivable_area.as_mut().unwrap()[1].exterior = rectangle(v(-1.7, -40.0), v(1.75, 40.0));
    });
    breaks(Rule::Edge, "on the left: false, on the right: true", |l| l.map.road_edges[0].points.reverse());
    breaks(Rule::Edge, "on the left: true, on the right: true", |l| {
        l.map.road_edges[0].points = vec![v(-20.0, 0.0), v(20.0, 0.0)];
    });
    breaks(Rule::Edge, "no road edges", |l| l.map.road_edges.clear());
}

#[test]
fn neighbours_and_overlaps() {
    breaks(Rule::Neighbour, "with the same stretch", |l| find(l, "a0.in").left[0].self_end = 9);
    breaks(Rule::Neighbour, "no stretch", |l| find(l, "a0.in").left[0].self_end = 11);
    breaks(Rule::Neighbour, "the other side", |l| {
        for id in ["a0.in", "a1.in"] {
            let lane = find(l, id);
            std::mem::swap(&mut lane.left, &mut lane.right);
        }
    });
    breaks(Rule::Neighbour, "another direction", |l| find(l, "a1.in").points.reverse());
    breaks(Rule::Neighbour, "m away", |l| find(l, "a1.in").points.iter_mut().for_each(|p| p.y += 3.0));
    breaks(Rule::Overlap, "overlaps lane `a1.in`", |l| {
        find(l, "a0.in").area = LaneArea::Polygon(rectangle(v(-60.0, -3.5), v(-10.0, 0.4)));
    });
}

#[test]
fn stop_lines_and_signals() {
    breaks(Rule::StopLine, "not on the lane", |l| l.map.stop_lines[0].at.y = -5.0);
    breaks(Rule::Signal, "second light", |l| l.signals[0].lane = "a1.x".into());
    breaks(Rule::Signal, "a cycle of 51 s", |l| l.signals[1].phases[2].1 = 28.0);
    breaks(Rule::Signal, "longer than 0 s", |l| l.signals[1].phases.push((LightState::Stop, 0.0)));
    breaks(Rule::Signal, "stop point is", |l| l.signals[1].stop_point.x = -20.0);
    breaks(Rule::Signal, "no stop line", |l| l.map.stop_lines.truncate(2));
    breaks(Rule::Signal, "may go at", |l| {
        l.signals[0].phases =
            vec![(LightState::ArrowGo, 24.0), (LightState::ArrowCaution, 3.0), (LightState::ArrowStop, 23.0)];
    });
    // A priority decides where the lights do not.
    let mut layout = sound();
    for plan in &mut layout.signals[..2] {
        plan.phases = vec![(LightState::Go, 50.0)];
    }
    layout.priorities = vec![Priority {
        lane: "b.x".into(),
        to: vec!["a0.x".into(), "a1.x".into()],
        rule: RightOfWay::Yield,
    }];
    assert_eq!(validate(&layout), []);
}

/// Replaces the lights of the valid map with signs.
fn with_signs(layout: &mut Layout, rule: RightOfWay, both: bool) {
    layout.signals.clear();
    layout.footways[2].waits_for.clear();
    layout.map.stop_lines.iter_mut().for_each(|s| s.kind = StopKind::Sign);
    let to = |ids: &[&str]| ids.iter().map(|&id| id.to_owned()).collect();
    layout.priorities = vec![Priority { lane: "b.x".into(), to: to(&["a0.x", "a1.x"]), rule }];
    if both {
        for id in ["a0.x", "a1.x"] {
            layout.priorities.push(Priority { lane: id.into(), to: to(&["b.x"]), rule });
        }
    }
}

#[test]
fn priorities() {
    for (rule, both) in
        [(RightOfWay::Yield, false), (RightOfWay::Stop, false), (RightOfWay::AllWayStop, true)]
    {
        let mut layout = sound();
        with_signs(&mut layout, rule, both);
        assert_eq!(validate(&layout), [], "{rule:?}");
    }
    breaks(Rule::Priority, "neither it nor `b.x` gives way", |l| {
        with_signs(l, RightOfWay::Yield, false);
        l.priorities[0].to.pop();
    });
    breaks(Rule::Priority, "neither it nor `b.x` gives way", |l| {
        l.signals.remove(1);
    });
    breaks(Rule::Priority, "which gives way to it", |l| with_signs(l, RightOfWay::Stop, true));
    breaks(Rule::Priority, "does not meet", |l| {
        with_signs(l, RightOfWay::Yield, false);
        l.priorities[0].to.push("a0.out".into());
    });
    breaks(Rule::Priority, "no stop line with a sign", |l| {
        with_signs(l, RightOfWay::Stop, false);
        l.map.stop_lines[2].kind = StopKind::Yield;
    });
}

#[test]
fn entries() {
    breaks(Rule::Entry, "it is no entry", |l| {
        l.entries.pop();
    });
    breaks(Rule::Entry, "named twice", |l| l.entries[0].lane = "a1.in".into());
    breaks(Rule::Entry, "vehicles per hour", |l| l.entries[0].flow = f64::NAN);
    breaks(Rule::Entry, "another lane leads into it", |l| l.entries[0].lane = "a0.x".into());
    breaks(Rule::Entry, "leaves the map", |l| {
        find(l, "b.out").successors.push("b.in".into());
        find(l, "b.in").predecessors.push("b.out".into());
    });
    breaks(Rule::Entry, "ends inside", |l| find(l, "a0.x").successors.clear());
    breaks(Rule::Entry, "begins inside", |l| find(l, "a0.out").predecessors.clear());
}

#[test]
fn parking() {
    breaks(Rule::Parking, "outside the drivable", |l| l.parking[0].position.y = 5.2);
    breaks(Rule::Parking, "0.2 m from lane `a1.out`", |l| l.parking[0].position.y = 4.6);
}

#[test]
fn footways() {
    let line =
        |l: &mut Layout, i: usize, points: [Vec2; 2]| l.footways[i].line = Polyline::new(&points).unwrap();
    breaks(Rule::Footway, "is on drivable ground", |l| line(l, 0, [v(-40.0, -3.9), v(-3.0, -5.0)]));
    breaks(Rule::Footway, "from other footways", |l| line(l, 1, [v(6.0, -6.0), v(40.0, -6.0)]));
    breaks(Rule::Footway, "ends on drivable ground", |l| line(l, 2, [v(-2.5, -6.0), v(1.0, -6.0)]));
    breaks(Rule::Footway, "without naming it", |l| l.footways[2].crosses.clear());
    breaks(Rule::Footway, "does not cross lane `a0.x`", |l| l.footways[2].crosses.push("a0.x".into()));
    breaks(Rule::Footway, "has no light", |l| l.footways[2].waits_for.push("b.in".into()));
    breaks(Rule::Footway, "names lanes", |l| l.footways[0].crosses.push("b.x".into()));
    breaks(Rule::Footway, "no crosswalk", |l| l.map.crosswalks.clear());
    breaks(Rule::Footway, "m wide", |l| l.footways[0].width = 0.1);
}

/// Adds heights: `b` for the road to the north and the footways along its crosswalk, 0 for the other road.
fn with_heights(layout: &mut Layout, b: f64) {
    let map = &mut layout.map;
    let of = |is_b: bool, points: usize| vec![if is_b { b } else { 0.0 }; points];
    let (edges, areas) = (map.road_edges.iter().enumerate(), map.drivable_area.iter().flatten().enumerate());
    map.heights = MapHeights {
        lanes: map.lanes.iter().map(|l| of(l.id.starts_with('b'), l.points.len())).collect(),
        road_edges: edges.map(|(i, e)| of(i == 2, e.points.len())).collect(),
        crosswalks: map.crosswalks.iter().map(|c| of(true, c.outline.len())).collect(),
        drivable_area: areas.map(|(i, p)| of(i == 1, p.exterior.len())).collect(),
        ..MapHeights::default()
    };
    for footway in &mut layout.footways {
        footway.heights = vec![b; footway.line.points().len()];
    }
}

#[test]
fn heights() {
    let lane = |l: &mut Layout, id: &str| l.map.lanes.iter().position(|lane| lane.id == id).unwrap();
    breaks(Rule::Height, "begins at 0.500 m", |l| {
        with_heights(l, 0.0);
        let out = lane(l, "b.out");
        l.map.heights.lanes[out].fill(0.5);
    });
    breaks(Rule::Height, "rises by 6.", |l| {
        with_heights(l, 0.0);
        let out = lane(l, "b.out");
        l.map.heights.lanes[out] = (0..=10).map(|i| 0.2 * f64::from(i)).collect();
    });
}

#[test]
fn roads_on_different_levels_do_not_meet() {
    let mut layout = sound();
    layout.signals.clear();
    layout.footways[2].waits_for.clear();
    for (height, sound) in [(0.0, false), (8.0, true)] {
        with_heights(&mut layout, height);
        let flaws = validate(&layout);
        assert_eq!(flaws.is_empty(), sound, "{height} m: {flaws:#?}");
        assert!(flaws.iter().all(|f| f.rule == Rule::Priority), "{flaws:#?}");
    }
}
