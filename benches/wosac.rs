//! Time of the realism metrics of the Sim Agents challenge for one scenario, in all configurations, on one
//! thread, and the share of every stage.
//!
//! `cargo bench -p reactsim --bench wosac --no-default-features --features formats -- SCENARIO ROLLOUTS`, with a
//! recorded scenario (TFRecord or one `Scenario` message) and its rollouts (one `ScenarioRollouts` message); either
//! may be compressed with gzip or zstd. Without arguments: the scenario with 84 simulated objects and 32
//! rollouts of which the official code was measured to take 114 s of processor time, if it is there, and else
//! a made-up one of the same size.
#![expect(clippy::print_stdout, reason = "the table is what this program is for")]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use reactsim::formats::wosac::{WosacLogs, encode_rollouts, read_rollouts};
use reactsim::geometry::math;
use reactsim::metrics::wosac::{Config, Scorer, Stage};
use reactsim::scene::wosac::{
    JointScene, LaneSignal, ObjectTrajectory, ScenarioRollouts, SurfaceLane, WosacLog, WosacTrack,
};
use reactsim::scene::{AgentKind, CURRENT, FRAMES, HISTORY};

/// Number of rounds, of which the best and the median are printed.
const ROUNDS: usize = 30;
/// Target in milliseconds.
const TARGET: f64 = 60.0;
/// Number of simulated objects and of evaluated ones in the made-up scenario.
const OBJECTS: usize = 84;
const EVALUATED: usize = 5;
const ROLLOUTS: usize = 32;

fn main() -> Result<(), Box<dyn Error>> {
    let mut paths = std::env::args().skip(1).filter(|a| !a.starts_with("--")).map(PathBuf::from);
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/wosac_golden");
    let named = |end: &str| golden.join(format!("ee519cf571686d19.{end}.binproto.zst"));
    let scenario = paths.next().or_else(|| Some(named("scenario")).filter(|path| path.exists()));
    let (log, rollouts, read_time) = match scenario {
        None => {
            let (log, rollouts) = made_up();
            (log, rollouts, 0.0)
        }
        Some(scenario) => {
            let path = paths.next().unwrap_or_else(|| named("rollouts"));
            let rollouts = read_rollouts(&path)?;
            let log = WosacLogs::open(&scenario)?
                .find(|log| log.as_ref().is_ok_and(|log| log.scenario_id == rollouts.scenario_id))
                .ok_or("the scenario of the rollouts is not in the file")??;
            let begun = Instant::now();
            read_rollouts(&path)?;
            (log, rollouts, begun.elapsed().as_secs_f64() * 1e3)
        }
    };
    let (mut prepare, mut total) = (Vec::new(), Vec::new());
    let mut stages = Stage::ALL.map(|stage| (stage, 0.0));
    let mut metametric = 0.0;
    for _ in 0..ROUNDS {
        let begun = Instant::now();
        let scorer = Scorer::new(&log)?;
        prepare.push(begun.elapsed().as_secs_f64() * 1e3);
        let begun = Instant::now();
        metametric = scorer.score(&rollouts, &Config::ALL)?[0].metametric;
        total.push(begun.elapsed().as_secs_f64() * 1e3);
        let mut last = Instant::now();
        scorer.score_observed(&rollouts, &Config::ALL, &mut |stage| {
            let now = Instant::now();
            if let Some(entry) = stages.iter_mut().find(|entry| entry.0 == stage) {
                entry.1 += (now - last).as_secs_f64() * 1e3;
            }
            last = now;
        })?;
    }
    prepare.sort_by(f64::total_cmp);
    total.sort_by(f64::total_cmp);
    println!(
        "`{}`: {} simulated objects, {} rollouts, metametric {metametric:.6}\n",
        log.scenario_id,
        log.simulated().count(),
        rollouts.joint_scenes.len()
    );
    println!("| part | best, ms | median, ms | target, ms |\n|---|--:|--:|--:|");
    println!("| map and log | {:.2} | {:.2} | |", prepare[0], prepare[ROUNDS / 2]);
    println!("| rollouts | {:.2} | {:.2} | {TARGET} |", total[0], total[ROUNDS / 2]);
    println!(
        "| reading {:.1} MB of rollouts | {read_time:.2} | | |\n",
        encode_rollouts(&rollouts).len() as f64 / 1e6
    );
    let sum: f64 = stages.iter().map(|entry| entry.1).sum();
    println!("| stage | mean, ms | share |\n|---|--:|--:|");
    for (stage, time) in stages {
        println!("| {stage:?} | {:.2} | {:.0} % |", time / ROUNDS as f64, 100.0 * time / sum);
    }
    Ok(())
}

/// Returns a scenario with lanes, road edges and lights, and rollouts that sway around its log.
fn made_up() -> (WosacLog, ScenarioRollouts) {
    let track = |i: usize| {
        let (lane, place) = (i % 6, i / 6);
        let (x, y) = (14.0 * place as f32 - 90.0, 3.5 * lane as f32);
        let speed = if lane % 2 == 0 { 9.0 } else { 0.0 };
        let at = |f: usize| (f as f32 - CURRENT as f32) / 10.0;
        WosacTrack {
            id: i as i32,
            kind: AgentKind::Vehicle,
            length: 4.6,
            width: 2.0,
            height: 1.6,
            x: (0..FRAMES).map(|f| x + speed * at(f)).collect(),
            y: vec![y; FRAMES],
            z: vec![0.8; FRAMES],
            heading: vec![0.0; FRAMES],
            valid: vec![true; FRAMES],
        }
    };
    let line = |y: f32| (0..800).map(move |p| [p as f32 * 0.5 - 200.0, y + 0.01 * p as f32]);
    let log = WosacLog {
        scenario_id: "made-up".into(),
        tracks: (0..OBJECTS).map(track).collect(),
        av: 0,
        tracks_to_predict: (1..EVALUATED).collect(),
        road_edges: (0..12)
            .map(|i| line(30.0 * i as f32 - 160.0).map(|[x, y]| [x, y, 0.0]).collect())
            .collect(),
        surface_lanes: (0..6)
            .map(|i| SurfaceLane { id: i, points: line(3.5 * i as f32).collect() })
            .collect(),
        signals: vec![
            (0..6)
                .map(|lane| LaneSignal { lane, state: 4, stop_point: [20.0, 3.5 * lane as f32] })
                .collect();
            FRAMES
        ],
    };
    let moved = |track: &WosacTrack, rollout: usize| {
        let phase = (track.id as usize * ROLLOUTS + rollout) as f64;
        let sway = |k: usize| math::sin(0.05 * k as f64 + phase) as f32;
        let future = |values: &[f32], scale: f32| {
            values[HISTORY..].iter().enumerate().map(|(k, value)| value + scale * sway(k)).collect()
        };
        ObjectTrajectory {
            object_id: track.id,
            x: future(&track.x, 3.0),
            y: future(&track.y, 1.0),
            z: future(&track.z, 0.1),
            heading: future(&track.heading, 0.2),
        }
    };
    let scene = |r: usize| JointScene { trajectories: log.tracks.iter().map(|t| moved(t, r)).collect() };
    let rollouts = ScenarioRollouts {
        scenario_id: log.scenario_id.clone(),
        joint_scenes: (0..ROLLOUTS).map(scene).collect(),
    };
    (log, rollouts)
}
