//! Encoding and decoding of `ScenarioRollouts` messages.

use std::io::Read;
use std::path::Path;

use prost::Message;
use reactsim_scene::wosac::{JointScene, ObjectTrajectory, ScenarioRollouts};

use super::message;
use crate::error::{Cause, FormatError};
use crate::womd::record::source;
use crate::womd::size::Fields;

/// Maximum length of the message of one scenario in bytes: 32 rollouts of 1000 objects have 44 MB.
pub(super) const MAX_LENGTH: u64 = 1 << 27;
/// Maximum number of rollouts and trajectories of a scenario, to which few bytes can expand.
const MAX_TRAJECTORIES: usize = 200_000;
/// Tag of the rollouts in `ScenarioRollouts`.
const JOINT_SCENES_TAG: u64 = 2;

/// Decodes a `ScenarioRollouts` message. Numbers may be packed or not.
///
/// # Errors
/// The message is malformed, or expands to more trajectories than a scenario has.
pub fn decode_rollouts(payload: &[u8]) -> Result<ScenarioRollouts, Cause> {
    let mut found = 0;
    for (tag, content) in Fields(payload) {
        found += 1 + if tag == JOINT_SCENES_TAG { Fields(content).count() } else { 0 };
        if found > MAX_TRAJECTORIES {
            let found = format!("more than {MAX_TRAJECTORIES}");
            return Err(Cause::value("the number of trajectories", found, "rollouts of one scenario"));
        }
    }
    let proto = message::ScenarioRollouts::decode(payload).map_err(|e| Cause::Undecodable(e.to_string()))?;
    let trajectory = |t: message::SimulatedTrajectory| ObjectTrajectory {
        object_id: t.object_id,
        x: t.center_x,
        y: t.center_y,
        z: t.center_z,
        heading: t.heading,
    };
    let scene = |scene: message::JointScene| JointScene {
        trajectories: scene.simulated_trajectories.into_iter().map(trajectory).collect(),
    };
    Ok(ScenarioRollouts {
        scenario_id: proto.scenario_id,
        joint_scenes: proto.joint_scenes.into_iter().map(scene).collect(),
    })
}

/// Encodes a `ScenarioRollouts` message with packed numbers.
pub fn encode_rollouts(rollouts: &ScenarioRollouts) -> Vec<u8> {
    let trajectory = |t: &ObjectTrajectory| message::SimulatedTrajectory {
        center_x: t.x.clone(),
        center_y: t.y.clone(),
        center_z: t.z.clone(),
        heading: t.heading.clone(),
        object_id: t.object_id,
    };
    let scene = |scene: &JointScene| message::JointScene {
        simulated_trajectories: scene.trajectories.iter().map(trajectory).collect(),
    };
    message::ScenarioRollouts {
        scenario_id: rollouts.scenario_id.clone(),
        joint_scenes: rollouts.joint_scenes.iter().map(scene).collect(),
    }
    .encode_to_vec()
}

/// Reads a file with one `ScenarioRollouts` message, plain or compressed with gzip or zstd.
///
/// # Errors
/// [`FormatError`] if the file cannot be read or decoded, or is longer than the rollouts of a scenario.
pub fn read_rollouts(path: &Path) -> Result<ScenarioRollouts, FormatError> {
    let refuse = |cause| FormatError::file(path, cause);
    let mut message = Vec::new();
    source(path)
        .and_then(|s| s.take(MAX_LENGTH + 1).read_to_end(&mut message))
        .map_err(|e| refuse(Cause::read(e)))?;
    if message.len() as u64 > MAX_LENGTH {
        let expected = "at most 128 MiB of one `ScenarioRollouts` message";
        return Err(refuse(Cause::value("the length of the content", "more", expected)));
    }
    decode_rollouts(&message).map_err(refuse)
}
