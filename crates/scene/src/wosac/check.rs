//! Validation of rollouts against the log of their scenario.

use std::collections::BTreeMap;

use super::{CHALLENGE_ROLLOUTS, JointScene, ObjectTrajectory, ScenarioRollouts, WosacLog, WosacTrack};
use crate::{CURRENT, FUTURE, SceneError, limits};

/// Checks rollouts by the rules of the challenge, in the order of the official code: the scenario id is set,
/// there are 32 rollouts, arrays have 80 entries, ids are those of simulated objects, none is missing. Then
/// the rules that the official code lacks: the id is that of the scenario, no object is listed twice, and
/// values are finite and plausible.
///
/// # Errors
/// The first violation, with rollout, object and field.
pub fn check_rollouts(rollouts: &ScenarioRollouts, log: &WosacLog) -> Result<(), SceneError> {
    let found = rollouts.joint_scenes.len();
    if !rollouts.scenario_id.is_empty() && found != CHALLENGE_ROLLOUTS {
        return Err(Place::of(rollouts).error("the number of joint_scenes", found, "32"));
    }
    align(rollouts, log).map(|_| ())
}

/// Checks rollouts as [`check_rollouts`] does, but accepts any number of them (at least one), and brings the
/// trajectories of every rollout into the order of [`WosacLog::simulated`].
///
/// # Errors
/// Same as [`check_rollouts`].
pub fn align<'a>(
    rollouts: &'a ScenarioRollouts,
    log: &WosacLog,
) -> Result<Vec<Vec<&'a ObjectTrajectory>>, SceneError> {
    let place = Place::of(rollouts);
    if rollouts.scenario_id.is_empty() {
        return Err(place.error("scenario_id", "empty", format!("`{}`", log.scenario_id)));
    }
    if rollouts.joint_scenes.is_empty() {
        return Err(place.error("the number of joint_scenes", 0, "at least one rollout"));
    }
    let simulated: Vec<&WosacTrack> = log.simulated().collect();
    let slots: BTreeMap<i32, usize> = simulated.iter().enumerate().map(|(i, track)| (track.id, i)).collect();
    for (scene, joint) in rollouts.joint_scenes.iter().enumerate() {
        place.scene(scene).official(joint, &slots)?;
    }
    if rollouts.scenario_id != log.scenario_id {
        return Err(place.error(
            "scenario_id",
            format!("`{}`", rollouts.scenario_id),
            format!("`{}`", log.scenario_id),
        ));
    }
    let center = log.tracks.get(log.av).map_or([0.0; 3], |av| [&av.x, &av.y, &av.z].map(|v| v[CURRENT]));
    let scenes = rollouts.joint_scenes.iter().enumerate();
    scenes.map(|(scene, joint)| place.scene(scene).ordered(joint, &slots, center)).collect()
}

/// Part of the rollouts that errors refer to.
#[derive(Clone, Copy)]
struct Place<'a> {
    scenario: &'a str,
    scene: Option<usize>,
    object: Option<i32>,
}

impl<'a> Place<'a> {
    fn of(rollouts: &'a ScenarioRollouts) -> Self {
        Self { scenario: &rollouts.scenario_id, scene: None, object: None }
    }

    fn scene(self, scene: usize) -> Self {
        Self { scene: Some(scene), ..self }
    }

    fn object(self, object: i32) -> Self {
        Self { object: Some(object), ..self }
    }

    fn error(self, field: &str, value: impl ToString, expected: impl Into<String>) -> SceneError {
        let scene = self.scene.map(|scene| format!("rollout {scene}: ")).unwrap_or_default();
        let object = self.object.map(|object| format!("object {object}: ")).unwrap_or_default();
        SceneError {
            scenario: self.scenario.to_owned(),
            field: format!("{scene}{object}{field}"),
            value: value.to_string(),
            expected: expected.into(),
        }
    }

    /// Applies the rules of the official code to one rollout.
    fn official(self, joint: &JointScene, slots: &BTreeMap<i32, usize>) -> Result<(), SceneError> {
        let mut is_present = vec![false; slots.len()];
        for trajectory in &joint.trajectories {
            let place = self.object(trajectory.object_id);
            for (field, values) in trajectory.fields() {
                if values.len() != FUTURE {
                    return Err(place.error(
                        &format!("the length of {field}"),
                        values.len(),
                        "80 (frames 11 to 90)",
                    ));
                }
            }
            let slot = slots.get(&trajectory.object_id).ok_or_else(|| {
                self.error("object_id", trajectory.object_id, "the id of an object that is valid at frame 10")
            })?;
            is_present[*slot] = true;
        }
        let missing = slots.iter().find(|(_, slot)| !is_present[**slot]);
        let Some((missing, _)) = missing else { return Ok(()) };
        let count = is_present.iter().filter(|present| !**present).count();
        let expected = format!("a trajectory for each of the {} objects valid at frame 10", slots.len());
        Err(self.error("object_id", format!("missing for {count} objects, first {missing}"), expected))
    }

    /// Applies the remaining rules to one rollout and returns its trajectories in order.
    fn ordered<'b>(
        self,
        joint: &'b JointScene,
        slots: &BTreeMap<i32, usize>,
        center: [f32; 3],
    ) -> Result<Vec<&'b ObjectTrajectory>, SceneError> {
        let mut ordered: Vec<Option<&ObjectTrajectory>> = vec![None; slots.len()];
        for trajectory in &joint.trajectories {
            let place = self.object(trajectory.object_id);
            place.plausible(trajectory, center)?;
            let slot = slots.get(&trajectory.object_id).map(|slot| &mut ordered[*slot]);
            if slot.is_some_and(|slot| slot.replace(trajectory).is_some()) {
                return Err(self.error("object_id", trajectory.object_id, "one trajectory per object"));
            }
        }
        Ok(ordered.into_iter().flatten().collect())
    }

    /// Checks that the values of a trajectory are finite and plausible. `center` is the AV's current
    /// position.
    fn plausible(self, trajectory: &ObjectTrajectory, center: [f32; 3]) -> Result<(), SceneError> {
        let bounds =
            [limits::MAX_COORDINATE, limits::MAX_COORDINATE, limits::MAX_COORDINATE, limits::MAX_HEADING];
        let center = [center[0], center[1], center[2], 0.0];
        for (((field, values), bound), center) in trajectory.fields().into_iter().zip(bounds).zip(center) {
            // Without early exit, so that the loop is vectorised.
            let is_within = |value: f32| (value - center).abs() < bound as f32;
            if values.iter().fold(true, |all, value| all & is_within(*value)) {
                continue;
            }
            let Some(step) = values.iter().position(|value| !is_within(*value)) else { continue };
            let expected = match field {
                "heading" => "a heading below a thousand turns",
                _ => "a position within 100 km of the AV",
            };
            return Err(self.error(&format!("{field}[{step}]"), values[step], expected));
        }
        Ok(())
    }
}
