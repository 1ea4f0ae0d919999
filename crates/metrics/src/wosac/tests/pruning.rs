//! Pruned searches find what comparisons with everything find, to the last bit.

use reactsim_scene::wosac::{ScenarioRollouts, WosacLog, align};

use super::super::edge_cells::EdgeCells;
use super::super::footprint::RoundedBox;
use super::super::objects::{Motion, Objects};
use super::super::road_edges::RoadEdges;
use super::super::{nearest_object, road_edges, time_to_collision};
use super::fixture;

fn compare(log: &WosacLog, rollouts: &ScenarioRollouts) {
    let objects = Objects::new(log).unwrap();
    let boxes: Vec<RoundedBox> = objects.tracks(log).map(RoundedBox::of).collect();
    let edges = RoadEdges::new(&log.road_edges);
    let mut cells = EdgeCells::new(&edges.arrays);
    let aligned = align(rollouts, log).unwrap();
    let motions: Vec<Motion> =
        [objects.logged(log)].into_iter().chain(aligned.iter().map(|r| objects.simulated(log, r))).collect();
    for (m, motion) in motions.iter().enumerate() {
        for object in 0..motion.evaluated {
            let place = format!("{} motion {m} object {object}", log.scenario_id);
            let distances = nearest_object::distances(motion, &boxes, object);
            assert_eq!(distances, nearest_object::distances_to_all(motion, &boxes, object), "{place}");
            let times = time_to_collision::times(motion, object);
            assert_eq!(times, time_to_collision::times_to_all(motion, object), "{place}");
            let distances = road_edges::distances(motion, &edges, &mut cells, object);
            assert_eq!(distances, road_edges::distances_to_all(motion, &edges, object), "{place}");
        }
    }
}

#[test]
fn pruning_changes_nothing() {
    for (seed, center) in [(1, [0.0, 0.0]), (2, [-3000.0, 7000.0]), (3, [40_000.0, -33_000.0])] {
        let (log, rollouts) = fixture::scenario(seed, 24, 4, center);
        compare(&log, &rollouts);
    }
}

#[test]
fn pruning_changes_nothing_without_partners() {
    let (log, rollouts) = fixture::scenario(4, 1, 2, [100.0, 100.0]);
    compare(&log, &rollouts);
}

#[test]
fn pruning_changes_nothing_in_recordings() {
    for mut golden in super::golden::all() {
        // A few rollouts of every kind: comparing everything takes long.
        golden.rollouts.joint_scenes = golden.rollouts.joint_scenes.into_iter().step_by(4).collect();
        compare(&golden.log, &golden.rollouts);
    }
}

#[test]
fn pruning_changes_nothing_far_from_the_map() {
    let (log, mut rollouts) = fixture::scenario(5, 6, 4, [-500.0, 300.0]);
    for (r, scene) in rollouts.joint_scenes.iter_mut().enumerate() {
        for (i, trajectory) in scene.trajectories.iter_mut().enumerate() {
            for (k, x) in trajectory.x.iter_mut().enumerate() {
                *x += 37.0 * (i * k * (r + 1)) as f32;
            }
            trajectory.z.iter_mut().for_each(|z| *z -= 5000.0 * r as f32);
        }
    }
    compare(&log, &rollouts);
}
