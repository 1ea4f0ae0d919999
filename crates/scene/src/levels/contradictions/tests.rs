//! Tests of heights that contradict one another, on the crossing of the tests of levels.

use reactsim_geometry::math;

use super::*;
use crate::levels::tests::{car, crossing};
use crate::{CURRENT, FRAMES, HISTORY, MapParts, ScenarioParts};

fn noted(scenario: &Scenario) -> Vec<(&'static str, u32)> {
    let of_heights = ["contradictory-heights", "heights-not-used"];
    let notes = scenario.notes().iter().filter(|n| of_heights.contains(n.0));
    notes.map(|(id, note)| (*id, note.count)).collect()
}

/// Returns the scenario of a crossing after a change, and the one without.
fn changed(above: f64, change: impl FnOnce(&mut ScenarioParts)) -> (Scenario, Scenario) {
    let mut parts = crossing(above, 0.0);
    let right = Scenario::assemble(parts.clone()).unwrap();
    change(&mut parts);
    (Scenario::assemble(parts).unwrap(), right)
}

/// Adds vehicles on both roads, 15 m apart.
fn add_traffic(parts: &mut ScenarioParts, above: f64) {
    for i in 0..10 {
        let along = 15.0 * f64::from(i) - 70.0;
        let low = car(&format!("low {i}"), Vec2::new(along, -1.0), Vec2::new(5.0, 0.0), 0.2);
        let high = car(&format!("high {i}"), Vec2::new(1.0, along), Vec2::new(0.0, 5.0), above - 0.3);
        parts.agents.extend([low, high]);
    }
}

#[test]
fn heights_that_agree_are_kept() {
    for above in [4.5, 7.0, 15.0] {
        let mut parts = crossing(above, 212.0);
        parts.agents.clear();
        parts.agents.push(car("av", Vec2::new(-40.0, 0.0), Vec2::new(5.0, 0.0), 213.9));
        let scenario = Scenario::assemble(parts).unwrap();
        assert_eq!((scenario.levels(), scenario.repairs.len(), noted(&scenario)), (2, 0, vec![]));
    }
}

#[test]
fn points_above_or_below_their_line_are_interpolated() {
    for above in [0.0, 7.0] {
        for size in [-9.0, -4.0, 3.2, 4.0, 6.5] {
            for points in [5..6, 12..15, 0..2, 38..41, 20..34] {
                for is_edge in [false, true] {
                    let count = points.len() as u32;
                    let (scenario, right) = changed(above, |parts| {
                        let heights = &mut parts.map.heights;
                        let line = if is_edge { &mut heights.road_edges[0] } else { &mut heights.lanes[0] };
                        line[points.clone()].iter_mut().for_each(|z| *z += size);
                    });
                    let at = format!("{size} m at {points:?}, a road at {above} m");
                    assert_eq!(scenario.start.map.heights, right.start.map.heights, "{at}");
                    // Without a road above, a height far from all others is not always a level.
                    let expected = [("contradictory-heights", count)];
                    assert!(noted(&scenario) == expected || above == 0.0, "{at}: {:?}", noted(&scenario));
                }
            }
        }
    }
}

#[test]
fn an_outlier_among_distant_points_is_found_next_to_other_lines() {
    let (scenario, _) = changed(7.0, |parts| {
        // Points that are 20 m apart: 4 m are no jump.
        let points = &mut parts.map.lanes[0].points;
        *points = points.iter().copied().step_by(4).collect();
        let heights = &mut parts.map.heights.lanes[0];
        heights.truncate(11);
        heights[7] = 4.0;
    });
    assert_eq!(noted(&scenario), [("contradictory-heights", 1)]);
    assert_eq!(scenario.start.map.heights.lanes[0], [0.0; 11]);
}

#[test]
fn a_line_at_another_height_than_all_lines_around_it_has_no_height() {
    let (scenario, right) = changed(12.0, |parts| parts.map.heights.road_edges[1].fill(4.5));
    assert_eq!(noted(&scenario), [("contradictory-heights", 41)]);
    assert_eq!(scenario.levels(), 2);
    let mut expected = right.start.map.heights.clone();
    expected.road_edges[1].clear();
    assert_eq!(scenario.start.map.heights, expected);
}

#[test]
fn boxes_off_the_ground_are_on_it() {
    let track = |frames: Range<usize>, error: f64| {
        let (scenario, _) = changed(7.0, move |parts| {
            add_traffic(parts, 7.0);
            parts.agents[0].heights[frames].iter_mut().flatten().for_each(|z| *z += error);
        });
        scenario
    };
    let right = track(0..0, 0.0);
    for frames in [CURRENT..CURRENT + 1, 4..5, 7..CURRENT + 1, 0..FRAMES] {
        for error in [-30.0, -3.4, 3.4, 5.0, 30.0] {
            let scenario = track(frames.clone(), error);
            assert_eq!((scenario.levels(), &scenario.start.agents), (2, &right.start.agents));
            for (i, agent) in right.start.agents.iter().enumerate() {
                let difference = (scenario.start.height_now(i) - right.start.height_now(i)).abs();
                assert!(difference < 0.5, "{}: {difference} m after {error} m at {frames:?}", agent.id);
            }
            let count = frames.len().min(HISTORY) as u32;
            assert_eq!(noted(&scenario), [("contradictory-heights", count)]);
        }
    }
    // Of the levels under it, a box without a usable height is on the road that it drives along.
    let (scenario, _) = changed(7.0, |parts| {
        add_traffic(parts, 7.0);
        parts.agents[0] = car("av", Vec2::new(2.0, 0.0), Vec2::new(5.0, 0.0), 30.0);
        let mut across = car("across", Vec2::new(-2.0, 1.0), Vec2::new(0.0, 5.0), -30.0);
        across.track.iter_mut().flatten().for_each(|s| s.heading = std::f64::consts::FRAC_PI_2);
        parts.agents[1] = across;
    });
    let agents = scenario.start.agents.iter();
    let across = agents.clone().position(|agent| agent.id == "across").unwrap();
    assert_eq!((scenario.start.height_now(0), scenario.start.height_now(across)), (0.0, 7.0));
}

#[test]
fn no_heights_are_used_if_agents_and_map_disagree() {
    let flat = {
        let mut parts = crossing(0.0, 0.0);
        add_traffic(&mut parts, 0.0);
        Scenario::assemble(parts).unwrap()
    };
    for (above, datum, agents) in
        [(0.0, 30.0, 0..22), (7.0, 30.0, 0..22), (7.0, -2.6, 0..22), (7.0, 12.0, 1..6)]
    {
        let count = agents.len() as u32;
        let (scenario, _) = changed(above, |parts| {
            add_traffic(parts, above);
            let wrong = parts.agents[agents].iter_mut().flat_map(|a| a.heights.iter_mut().flatten());
            wrong.for_each(|z| *z += datum);
        });
        assert_eq!(noted(&scenario), [("heights-not-used", count)], "{datum} m above {above} m");
        assert!(!scenario.start.has_levels());
        assert_eq!(scenario.start.agents, flat.start.agents);
    }
    // One of two agents is an outlier.
    let (scenario, _) = changed(0.0, |parts| parts.agents[0].heights.fill(Some(30.0)));
    assert_eq!(noted(&scenario), [("contradictory-heights", HISTORY as u32)]);
    assert!(!scenario.start.has_levels());
}

#[test]
fn third_coordinates_that_are_directions_are_no_heights() {
    let angles = |points: &[Vec2], unit: f64| -> Vec<f64> {
        let way = |i: usize| points[(i + 1).min(points.len() - 1)] - points[i.min(points.len() - 2)];
        (0..points.len()).map(|i| heading_of(way(i)) * unit).collect()
    };
    for unit in [1.0, 1.0 / DEGREE] {
        let (scenario, _) = changed(0.0, |parts| {
            let MapParts { lanes, road_edges, heights, .. } = &mut parts.map;
            lanes[1].points.iter_mut().for_each(|p| *p += Vec2::new(20.0 * math::sin(0.05 * p.y), 0.0));
            heights.lanes = lanes.iter().map(|l| angles(&l.points, unit)).collect();
            heights.road_edges = road_edges.iter().map(|e| angles(&e.points, unit)).collect();
        });
        assert!(!scenario.start.has_levels());
        assert_eq!(scenario.repairs.get(DIRECTIONS), Some(&6), "{:?}", scenario.repairs);
        assert_eq!(noted(&scenario), []);
    }
    // Agents: less half of the height of the box.
    let (scenario, _) = changed(7.0, |parts| {
        for (i, agent) in parts.agents.iter_mut().enumerate() {
            for (f, (state, z)) in agent.track.iter_mut().zip(&mut agent.heights).enumerate() {
                let heading = 0.02 * f as f64 + i as f64;
                state.as_mut().unwrap().heading = heading;
                *z = Some(heading - 0.8);
            }
        }
    });
    assert_eq!(scenario.repairs.get(DIRECTIONS), Some(&2), "{:?}", scenario.repairs);
    assert_eq!(
        (scenario.levels(), scenario.start.height_now(0), scenario.start.height_now(1)),
        (2, 0.0, 7.0)
    );
}

#[test]
fn mended_scenarios_do_not_change() {
    let (mut scenario, _) = changed(7.0, |parts| {
        add_traffic(parts, 7.0);
        parts.map.heights.lanes[0][10] = 5.0;
        parts.agents[1].heights[CURRENT] = Some(1.0);
    });
    let digest = scenario.digest();
    scenario.complete();
    assert_eq!((scenario.digest(), scenario.repairs[OUTLIERS]), (digest, 2));
}
