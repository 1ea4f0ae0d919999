//! One scenario as a message, for programs that read scenarios instead of simulating them.

use reactsim_scene::{AgentState, Length, Scenario};

use super::document::{FrameWriter, Values};
use super::length;
use super::scenes::{add_scenes, frame_numbers, light_code, state_numbers};

/// Content of a scene beyond the information known at the current frame.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneExtras {
    /// Nothing.
    None,
    /// The logged future, and the deviated AV at every step if there is one.
    Future {
        /// One state per step, in the scenario frame.
        av: Option<Vec<AgentState>>,
    },
}

/// Creates the message `scene`: the tensors of `begin` for one episode, always with its ids.
pub fn scene_frame(scenario: &Scenario, number: u64, extras: SceneExtras) -> FrameWriter {
    let mut document = FrameWriter::new("scene");
    let agents: Vec<&str> = scenario.start.agents.iter().map(|a| a.id.as_str()).collect();
    let json = |value: serde_json::Value| value.to_string();
    document
        .text("scenario_ids", json(serde_json::json!([scenario.id])))
        .text("agent_ids", json(serde_json::json!([agents])))
        .text("origins", json(serde_json::json!([[scenario.origin.x, scenario.origin.y]])))
        .tensor("episode", Values::u64(&[1], [number]))
        .tensor("seed", Values::u64(&[1], [0]));
    length::add(&mut document, scenario.length());
    let Length { history, future: steps } = scenario.length();
    let start = &scenario.start;
    let point_heights = add_scenes(&mut document, &[start]);
    let (n, obstacles) = (start.agents.len(), start.obstacles.len());
    document
        .tensor("heights", agent_heights(&start.heights, n, history))
        .tensor("point_heights", Values::f64(&[point_heights.len()], point_heights))
        .tensor("obstacle_heights", known_or_nan(&[obstacles], &start.obstacle_heights));
    if let SceneExtras::Future { av } = extras {
        let future = &scenario.log_future;
        let frames = || future.tracks.iter().flatten();
        let (n, k) = (future.tracks.len(), future.lights.len());
        let lights = future.lights.iter().flatten().map(|light| light_code(*light));
        document
            .tensor("future", Values::f64(&[1, n, steps, 5], frames().copied().flat_map(frame_numbers)))
            .tensor("future_valid", Values::u8(&[1, n, steps], frames().map(|f| u8::from(f.is_some()))))
            .tensor("future_heights", agent_heights(&future.heights, n, steps))
            .tensor("light_future", Values::u8(&[k, steps], lights));
        if let Some(track) = av {
            document.tensor("av", Values::f64(&[track.len(), 5], track.into_iter().flat_map(state_numbers)));
        }
    }
    document
}

/// Returns the heights of agents at a number of frames, [1, agents, frames].
fn agent_heights(heights: &[Vec<Option<f64>>], agents: usize, frames: usize) -> Values {
    known_or_nan(&[1, agents, frames], heights.iter().flatten())
}

/// Returns heights as numbers, NaN where unknown. No heights at all mean that the scenario has one level: all
/// are unknown.
fn known_or_nan<'a>(shape: &[usize], heights: impl IntoIterator<Item = &'a Option<f64>>) -> Values {
    let mut numbers: Vec<f64> = heights.into_iter().map(|height| height.unwrap_or(f64::NAN)).collect();
    if numbers.is_empty() {
        numbers.resize(shape.iter().product(), f64::NAN);
    }
    Values::f64(shape, numbers)
}
