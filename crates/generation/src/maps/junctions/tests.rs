//! Tests of all junctions over many seeds.

use reactsim_scene::{LaneKind, LightState, StopKind};

use super::super::tests::{draw, junctions};
use crate::RightOfWay;

/// Returns the smallest radius on a line, metres, over three points at a time.
fn tightest(points: &[reactsim_geometry::Vec2]) -> f64 {
    let bend = |w: &[reactsim_geometry::Vec2]| {
        let (a, b, c) = (w[1] - w[0], w[2] - w[1], w[2] - w[0]);
        2.0 * a.perp(&b).abs() / (a.norm() * b.norm() * c.norm())
    };
    1.0 / points.windows(3).map(bend).fold(1e-9, f64::max)
}

#[test]
fn turns_have_the_radii_of_turns() {
    for kind in junctions() {
        for seed in 0..40 {
            let layout = draw(kind, seed);
            for lane in layout.map.lanes.iter().filter(|l| l.kind == LaneKind::Connector) {
                let radius = tightest(&lane.points);
                // Left turns are wider than right turns, which follow the kerb.
                let left = lane.id.starts_with(['j', 'k']) && lane.id.contains('l');
                let least = if left { 8.0 } else { 6.0 };
                assert!(radius > least, "{} {seed}: {} has a radius of {radius} m", kind.id, lane.id);
            }
        }
    }
}

#[test]
fn lights_have_plausible_times() {
    for kind in junctions().filter(|m| m.id.starts_with("signalised")) {
        for seed in 0..60 {
            let layout = draw(kind, seed);
            assert!(!layout.signals.is_empty());
            for plan in &layout.signals {
                let what = format!("{} {seed}: {}", kind.id, plan.lane);
                let total = |states: &[LightState]| {
                    plan.phases.iter().filter(|p| states.contains(&p.0)).map(|p| p.1).sum::<f64>()
                };
                let cycle: f64 = plan.phases.iter().map(|p| p.1).sum();
                assert!((49.9..=122.0).contains(&cycle), "{what}: a cycle of {cycle} s");
                let green = total(&[LightState::Go, LightState::ArrowGo]);
                assert!((7.9..=75.0).contains(&green), "{what}: green for {green} s");
                let yellow = total(&[LightState::Caution, LightState::ArrowCaution]);
                assert!((2.99..=5.01).contains(&yellow), "{what}: yellow for {yellow} s");
            }
            // Pedestrians can cross: at one metre per second or more.
            for crossing in layout.footways.iter().filter(|f| !f.waits_for.is_empty()) {
                let plans: Vec<_> =
                    layout.signals.iter().filter(|s| crossing.waits_for.contains(&s.lane)).collect();
                let cycle: f64 = plans[0].phases.iter().map(|p| p.1).sum();
                let held = |t: f64| plans.iter().any(|p| p.at(t).is_some_and(|s| !s.is_red()));
                let free =
                    (0..(2.0 * cycle) as usize).filter(|&k| !held(0.5 * k as f64)).count() as f64 * 0.5;
                assert!(free >= 8.0, "{} {seed}: {free} s to cross", kind.id);
            }
        }
    }
}

#[test]
fn each_type_has_its_rule() {
    for kind in junctions() {
        let layout = draw(kind, 1);
        assert!(!layout.map.intersections.is_empty(), "{}", kind.id);
        let stops = |kind: StopKind| layout.map.stop_lines.iter().filter(|s| s.kind == kind).count();
        let rules = |rule: RightOfWay| layout.priorities.iter().filter(|p| p.rule == rule).count();
        match kind.id {
            "all-way-stop" => {
                assert_eq!(rules(RightOfWay::AllWayStop), stops(StopKind::Sign));
                assert_eq!(layout.priorities.len(), rules(RightOfWay::AllWayStop));
            }
            "priority-t" | "priority-four-way" => {
                assert!(rules(RightOfWay::Stop) + rules(RightOfWay::Yield) > 2 && layout.signals.is_empty());
            }
            "roundabout-1" | "roundabout-2" => assert!(stops(StopKind::Yield) > 2),
            "signalised-protected" => {
                let arrows =
                    layout.signals.iter().filter(|s| s.phases.iter().any(|p| p.0 == LightState::ArrowGo));
                assert!(arrows.count() >= 2);
            }
            "signalised-and-t" => {
                assert!(rules(RightOfWay::Stop) > 0 && stops(StopKind::Light) == layout.signals.len());
            }
            _ => assert_eq!(stops(StopKind::Light), layout.signals.len(), "{}", kind.id),
        }
    }
}
