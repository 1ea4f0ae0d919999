//! Made-up scenarios: objects on a road between two edges, and rollouts of them.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim_scene::{
    AgentKind, CURRENT, FRAMES, FUTURE, HISTORY,
    wosac::{JointScene, LaneSignal, ObjectTrajectory, ScenarioRollouts, SurfaceLane, WosacLog, WosacTrack},
};

/// A scenario of `objects` objects around the world point `center`, and `rollouts` rollouts. Of the objects,
/// the last one is the AV and the first two are marked for prediction.
pub(super) fn scenario(
    seed: u64,
    objects: usize,
    rollouts: usize,
    center: [f32; 2],
) -> (WosacLog, ScenarioRollouts) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let tracks: Vec<WosacTrack> = (0..objects).map(|i| track(&mut rng, i, center)).collect();
    let av = objects - 1;
    let edges = (0..6).map(|i| edge(&mut rng, center, 8.0 * (i as f32 - 3.0))).collect();
    let lane = |i: i64| SurfaceLane {
        id: 100 + i,
        points: (0..20 + i)
            .map(|p| [center[0] - 50.0 + 5.0 * p as f32, center[1] + 8.0 * i as f32])
            .collect(),
    };
    let signal =
        |i: i64| LaneSignal { lane: 100 + i, state: 4, stop_point: [center[0], center[1] + 8.0 * i as f32] };
    let log = WosacLog {
        scenario_id: format!("made-up-{seed}"),
        av,
        tracks_to_predict: vec![0, 1.min(av)],
        road_edges: edges,
        surface_lanes: (-2..3).map(lane).collect(),
        signals: vec![(-2..3).map(signal).collect(); FRAMES],
        tracks,
    };
    let scene = |rng: &mut ChaCha8Rng| JointScene {
        trajectories: log.tracks.iter().map(|track| rollout(rng, track)).collect(),
    };
    let joint_scenes = (0..rollouts).map(|_| scene(&mut rng)).collect();
    let rollouts = ScenarioRollouts { scenario_id: log.scenario_id.clone(), joint_scenes };
    (log, rollouts)
}

/// Makes all rollouts follow the log.
pub(super) fn follow_log(log: &WosacLog, rollouts: &mut ScenarioRollouts) {
    for scene in &mut rollouts.joint_scenes {
        for (trajectory, track) in scene.trajectories.iter_mut().zip(&log.tracks) {
            trajectory.x = track.x[HISTORY..].to_vec();
            trajectory.y = track.y[HISTORY..].to_vec();
            trajectory.z = track.z[HISTORY..].to_vec();
            trajectory.heading = track.heading[HISTORY..].to_vec();
        }
    }
}

fn track(rng: &mut ChaCha8Rng, i: usize, center: [f32; 2]) -> WosacTrack {
    let (length, width) = (rng.random_range(0.5..9.0), rng.random_range(0.5..2.6));
    let start = [rng.random_range(-60.0f32..60.0), rng.random_range(-20.0f32..20.0)];
    let (speed, heading) = (rng.random_range(0.0f32..15.0), rng.random_range(-0.6f32..0.6));
    let frames = || (0..FRAMES).map(|f| (f as f32 - CURRENT as f32) / 10.0);
    WosacTrack {
        id: 1000 - i as i32,
        kind: AgentKind::ALL[i % 4 * usize::from(i > 1)],
        length,
        width,
        height: 1.5,
        x: frames().map(|t| center[0] + start[0] + t * speed * heading.cos()).collect(),
        y: frames().map(|t| center[1] + start[1] + t * speed * heading.sin()).collect(),
        z: frames().map(|t| 30.0 + 0.2 * t).collect(),
        heading: frames().map(|t| heading + 0.01 * t).collect(),
        valid: (0..FRAMES).map(|f| i < 2 || f == CURRENT || (f * 7 + i * 3) % 11 > 1).collect(),
    }
}

fn rollout(rng: &mut ChaCha8Rng, track: &WosacTrack) -> ObjectTrajectory {
    let [pace, lift, turn, sway] = [
        rng.random_range(-0.5f32..1.5),
        if rng.random_bool(0.2) { 6.0 } else { 0.0 },
        rng.random_range(-0.05f32..0.05),
        rng.random_range(-4.0f32..4.0),
    ];
    let future = |values: &[f32]| values[HISTORY..].to_vec();
    let along = |values: &[f32], offset: f32| -> Vec<f32> {
        let now = values[CURRENT];
        future(values).iter().map(|value| now + (value - now) * pace + offset).collect()
    };
    let heading = (0..FUTURE).map(|k| track.heading[CURRENT] + turn * k as f32).collect();
    ObjectTrajectory {
        object_id: track.id,
        x: along(&track.x, 0.0),
        y: along(&track.y, sway),
        z: along(&track.z, lift),
        heading,
    }
}

/// A winding road edge with a bridge above it, at a lateral position.
fn edge(rng: &mut ChaCha8Rng, center: [f32; 2], lateral: f32) -> Vec<[f32; 3]> {
    let (height, step) = (rng.random_range(28.0f32..36.0), rng.random_range(0.4f32..3.0));
    let count = (200.0 / step) as usize;
    (0..count)
        .map(|p| {
            let x = p as f32 * step - 100.0;
            [center[0] + x, center[1] + lateral + 2.0 * (0.2 * x).sin(), height + 0.01 * x]
        })
        .collect()
}
