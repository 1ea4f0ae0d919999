//! A straight road for tests: two lanes to the right, one in the other direction, edges on both sides; and
//! AVs on it.

use reactsim::curation::Candidate;
use reactsim::geometry::{Polygon, Vec2};
use reactsim::scene::{AgentState, DT, FUTURE, LoggedAgent, MapParts, Scenario};

use crate::scenes::{lane, line, scene, state};

/// Returns a map with lanes at y = 0 and 3.5 to the right, at 7 to the left; drivable from -2 to 9.
pub(super) fn map() -> MapParts {
    let ring = [(-200.0, -2.0), (400.0, -2.0), (400.0, 9.0), (-200.0, 9.0)];
    MapParts {
        lanes: vec![
            lane("right", line((-200.0, 0.0), (400.0, 0.0)), Some(15.0)),
            lane("left", line((-200.0, 3.5), (400.0, 3.5)), Some(15.0)),
            lane("oncoming", line((400.0, 7.0), (-200.0, 7.0)), Some(15.0)),
        ],
        drivable_area: Some(vec![Polygon {
            exterior: ring.iter().map(|&(x, y)| Vec2::new(x, y)).collect(),
            holes: Vec::new(),
        }]),
        ..MapParts::default()
    }
}

/// Returns a scene on this road; the first agent is the AV.
pub(super) fn on_road(id: &str, agents: Vec<LoggedAgent>) -> Scenario {
    scene(id, agents, map())
}

/// Returns a candidate whose state after `t` seconds is given by position, heading and speed.
pub(super) fn candidate(scenario: &Scenario, at: impl Fn(f64) -> (f64, f64, f64)) -> Candidate {
    let mut track = vec![scenario.start.now(0)];
    for k in 1..=FUTURE {
        let (x, y, heading) = at(k as f64 * DT);
        let before: AgentState = track[k - 1];
        let (vx, vy) = ((x - before.x) / DT, (y - before.y) / DT);
        track.push(AgentState { vx, vy, ..state(x, y, heading, 0.0) });
    }
    Candidate { source: "hand".into(), number: 0, intent: None, maneuver: "by hand".into(), track }
}

/// Returns the distance after `t` seconds of braking from `speed` at `loss` m/s² to a halt, metres.
pub(super) fn braked(speed: f64, loss: f64, t: f64) -> f64 {
    let t = t.min(speed / loss);
    speed * t - 0.5 * loss * t * t
}
