//! Encoding and decoding of `ScenarioRollouts` messages. Fields that the challenge does not use are passed
//! over.

use std::io::Read;
use std::path::Path;

use reactsim_scene::wosac::{JointScene, ObjectTrajectory, ScenarioRollouts};

use crate::error::{Cause, FormatError};
use crate::wire::{Fields, Message, WireError};
use crate::womd::record::source;

/// Maximum length of the message of one scenario in bytes: 32 rollouts of 1000 objects have 44 MB.
pub(super) const MAX_LENGTH: u64 = 1 << 27;
/// Maximum number of rollouts and trajectories of a scenario, to which few bytes can expand.
const MAX_TRAJECTORIES: usize = 200_000;

/// Decodes a `ScenarioRollouts` message. Numbers may be packed or not.
///
/// # Errors
/// The message is malformed, or expands to more trajectories than a scenario has.
pub fn decode_rollouts(payload: &[u8]) -> Result<ScenarioRollouts, Cause> {
    let (mut rollouts, mut fields) = (ScenarioRollouts::default(), Fields::new(payload));
    let mut left = MAX_TRAJECTORIES;
    while let Some(key) = fields.key()? {
        match key.tag() {
            1 => rollouts.scenario_id = fields.text(key)?.to_owned(),
            2 => {
                let scene = joint_scene(fields.bytes(key)?, &mut left)?;
                rollouts.joint_scenes.push(scene);
            }
            _ => drop(fields.skip(key)?),
        }
    }
    Ok(rollouts)
}

/// Decodes a `JointScene` message. `left` is the number of messages that may still be kept.
fn joint_scene(content: &[u8], left: &mut usize) -> Result<JointScene, Cause> {
    let mut count = || {
        let found = || format!("more than {MAX_TRAJECTORIES}");
        let rest = left.checked_sub(1);
        *left = rest
            .ok_or_else(|| Cause::value("the number of trajectories", found(), "rollouts of one scenario"))?;
        Ok::<_, Cause>(())
    };
    count()?;
    let (mut scene, mut fields) = (JointScene::default(), Fields::new(content));
    while let Some(key) = fields.key()? {
        match key.tag() {
            1 => {
                count()?;
                scene.trajectories.push(trajectory(fields.bytes(key)?)?);
            }
            _ => drop(fields.skip(key)?),
        }
    }
    Ok(scene)
}

/// Decodes a `SimulatedTrajectory` message.
fn trajectory(content: &[u8]) -> Result<ObjectTrajectory, WireError> {
    let (mut trajectory, mut fields) = (ObjectTrajectory::default(), Fields::new(content));
    while let Some(key) = fields.key()? {
        match key.tag() {
            2 => fields.floats(key, &mut trajectory.x)?,
            3 => fields.floats(key, &mut trajectory.y)?,
            4 => fields.floats(key, &mut trajectory.z)?,
            5 => fields.floats(key, &mut trajectory.heading)?,
            6 => trajectory.object_id = fields.int32(key)?,
            _ => drop(fields.skip(key)?),
        }
    }
    Ok(trajectory)
}

/// Encodes a `ScenarioRollouts` message with packed numbers. Zero and an empty id are what missing fields
/// mean.
pub fn encode_rollouts(rollouts: &ScenarioRollouts) -> Vec<u8> {
    let mut message = Message::default();
    if !rollouts.scenario_id.is_empty() {
        message.bytes(1, &rollouts.scenario_id);
    }
    for scene in &rollouts.joint_scenes {
        let mut trajectories = Message::default();
        for trajectory in &scene.trajectories {
            let mut content = Message::default();
            content.floats(2, &trajectory.x);
            content.floats(3, &trajectory.y);
            content.floats(4, &trajectory.z);
            content.floats(5, &trajectory.heading);
            if trajectory.object_id != 0 {
                content.int64(6, trajectory.object_id.into());
            }
            trajectories.bytes(1, content.into_bytes());
        }
        message.bytes(2, trajectories.into_bytes());
    }
    message.into_bytes()
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
