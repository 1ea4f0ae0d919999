//! One scenario as a message, for programs that read scenarios instead of simulating them.

use reactsim_scene::{AgentState, FUTURE, Scenario};

use super::document::{FrameWriter, Values};
use super::scenes::{add_scenes, frame_numbers, light_code, state_numbers};

/// Content of a scene beyond the information known at the current frame.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneExtras {
    /// Nothing.
    None,
    /// The logged future, and the deviated AV at the steps 1 to 80 if there is one.
    Future {
        /// 80 states in the scenario frame.
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
    add_scenes(&mut document, &[&scenario.start]);
    if let SceneExtras::Future { av } = extras {
        let future = &scenario.log_future;
        let frames = || future.tracks.iter().flatten();
        let (n, k) = (future.tracks.len(), future.lights.len());
        let lights = future.lights.iter().flatten().map(|light| light_code(*light));
        document
            .tensor("future", Values::f64(&[1, n, FUTURE, 5], frames().copied().flat_map(frame_numbers)))
            .tensor("future_valid", Values::u8(&[1, n, FUTURE], frames().map(|f| u8::from(f.is_some()))))
            .tensor("light_future", Values::u8(&[k, FUTURE], lights));
        if let Some(track) = av {
            document.tensor("av", Values::f64(&[track.len(), 5], track.into_iter().flat_map(state_numbers)));
        }
    }
    document
}
