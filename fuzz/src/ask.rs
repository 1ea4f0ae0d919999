//! Checks of a reader: it does not panic, its errors can be displayed, its scenarios keep their invariants.

use std::backtrace::Backtrace;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook};
use std::path::Path;
use std::sync::{Mutex, Once, PoisonError};

use crate::formats::{FORMATS, FormatError, Input, survey};
use crate::geometry::Vec2;
use crate::scene::{FRAMES, Frame, LaneArea, Scenario};

/// Most records of a file that are read.
const MOST: usize = 200;
/// Longest message, in bytes: what an input holds may be quoted, but not as a whole.
const LONGEST_MESSAGE: usize = 20_000;

/// Place and message of the last panic.
static LAST_PANIC: Mutex<String> = Mutex::new(String::new());

/// Reads a file as users do, by its content, and as the format of this name whatever its content.
pub fn ask(path: &Path, format: &str) {
    static HOOK: Once = Once::new();
    // The reader of Parquet catches panics of its library: only those that get here are findings.
    HOOK.call_once(|| {
        set_hook(Box::new(|panic| {
            let place = panic.location().map_or("", |l| l.file());
            let caught = place.contains("/parquet-") || place.contains("/arrow-");
            let trace = if caught { String::new() } else { Backtrace::force_capture().to_string() };
            *LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner) = format!("{panic}\n{trace}");
        }));
    });
    if catch_unwind(AssertUnwindSafe(|| read(path, format))).is_err() {
        eprintln!("{}", LAST_PANIC.lock().unwrap_or_else(PoisonError::into_inner));
        std::process::abort();
    }
}

fn read(path: &Path, id: &str) {
    let found = survey(path);
    if let Err(error) = &found {
        shown(error);
    }
    let forced = FORMATS.iter().copied().find(|f| f.id() == id).expect("a known format");
    let mut formats = vec![forced];
    formats.extend(found.iter().flat_map(|s| &s.inputs).map(|i| i.format).filter(|f| f.id() != id));
    for format in formats {
        match Input::new(path.to_owned(), format).open() {
            Err(error) => shown(&error),
            Ok(scenarios) => {
                for scenario in scenarios.take(MOST) {
                    match scenario {
                        Err(error) => shown(&error),
                        Ok(scenario) => holds(&scenario),
                    }
                }
            }
        }
    }
}

/// An error is for people: one line of text.
fn shown(error: &FormatError) {
    let text = error.to_string();
    assert!(!text.is_empty(), "an empty message");
    assert!(!text.chars().any(char::is_control), "control characters in {text:?}");
    assert!(
        text.len() < LONGEST_MESSAGE,
        "a message of {} bytes: {}",
        text.len(),
        &text[..text.floor_char_boundary(400)]
    );
}

fn finite(what: &str, points: &[Vec2]) {
    assert!(points.iter().all(|p| p.x.is_finite() && p.y.is_finite()), "{what} is not finite");
}

fn track(id: &str, track: &[Frame]) {
    for state in track.iter().flatten() {
        finite(id, &[state.position()]);
        assert!(state.heading.is_finite(), "the heading of {id}");
        // NaN is an unknown velocity.
        assert!(!state.vx.is_infinite() && !state.vy.is_infinite(), "the velocity of {id}");
    }
}

/// Checks the invariants of every scenario.
fn holds(scenario: &Scenario) {
    let start = &scenario.start;
    assert!(!scenario.id.is_empty(), "no id");
    finite("the origin", &[scenario.origin]);
    assert!(scenario.timestamps.is_empty() || scenario.timestamps.len() == FRAMES);
    assert!(scenario.timestamps.iter().all(|t| t.is_finite()));
    assert_eq!(start.agents.len(), start.history.len());
    for (i, agent) in start.agents.iter().enumerate() {
        assert!(
            agent.length > 0.0 && agent.width > 0.0 && agent.length.is_finite() && agent.width.is_finite()
        );
        track(&agent.id, &start.history[i]);
        track(&agent.id, &scenario.log_future.tracks[i]);
        assert_eq!(start.history[i].len() + scenario.log_future.tracks[i].len(), FRAMES);
        assert!(!agent.id.is_empty(), "an agent without an id");
        finite("an agent", &[start.now(i).position()]);
    }
    for other in &scenario.unselected {
        assert_eq!(other.track.len(), FRAMES);
        track(&other.agent.id, &other.track);
    }
    map(scenario);
    if let Some(deviation) = &scenario.deviation {
        let states: Vec<Frame> = deviation.track.iter().copied().map(Some).collect();
        track("the deviation", &states);
    }
    assert_eq!(scenario.digest().len(), 64);
    // The first steps of every simulation.
    let road = start.road();
    let mut hits = Vec::new();
    for i in 0..start.agents.len() {
        let p = start.now(i).position();
        road.lanes_at(p, &mut hits);
        road.lanes_near(p, 20.0, &mut hits);
        road.drivable(p, &mut None);
        road.in_intersection(p);
    }
}

fn map(scenario: &Scenario) {
    let map = &scenario.start.map;
    for lane in &map.lanes {
        assert!(!lane.id.is_empty(), "a lane without an id");
        finite("a lane", lane.baseline.points());
        assert!(lane.baseline.length().is_finite());
        match &lane.area {
            LaneArea::Polygon(ring) => finite("the outline of a lane", ring),
            LaneArea::Corridor { half_width } => assert!(half_width.is_finite() && *half_width > 0.0),
        }
        assert!(lane.speed_limit.is_none_or(|v| v.is_finite() && v > 0.0));
        let beside = lane.left.iter().chain(&lane.right).map(|n| n.lane);
        assert!(
            lane.successors
                .iter()
                .chain(&lane.predecessors)
                .copied()
                .chain(beside)
                .all(|l| l < map.lanes.len())
        );
    }
    map.road_edges.iter().for_each(|e| finite("an edge", &e.points));
    map.road_lines.iter().for_each(|l| finite("a line", &l.points));
    map.crosswalks.iter().for_each(|c| finite("a crosswalk", &c.outline));
    map.speed_bumps.iter().chain(&map.driveways).for_each(|s| finite("a surface", &s.outline));
    map.intersections.iter().for_each(|ring| finite("a junction", ring));
    for area in map.drivable_area.iter().flatten() {
        finite("the drivable area", &area.exterior);
        area.holes.iter().for_each(|hole| finite("a hole", hole));
    }
    for line in &map.stop_lines {
        finite("a stop line", &line.ends);
        assert!(line.lane < map.lanes.len() && line.s.is_finite());
    }
    for light in &scenario.start.lights {
        finite("a light", &[light.stop_point]);
        assert!(light.lane < map.lanes.len());
    }
}
