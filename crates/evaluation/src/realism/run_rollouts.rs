//! The rollouts of a run as those of a submission.

use std::collections::BTreeMap;

use reactsim_formats::rollouts::RolloutRecord;
use reactsim_scene::{
    CURRENT, FUTURE,
    wosac::{JointScene, ObjectTrajectory, ScenarioRollouts, WosacLog, WosacTrack},
};

/// Converts rollouts of a run. Positions are in the world, restored in double precision before they are
/// rounded; z stays at its value of the current frame. `id_of` returns the id of an agent in the log.
///
/// # Errors
/// A text if an object of the log was not simulated, is absent at a step or has another number of steps, or
/// if the place of the rollouts in the world is unknown.
pub(super) fn run_rollouts(
    records: &[RolloutRecord],
    log: &WosacLog,
    id_of: impl Fn(&str) -> Option<i32>,
) -> Result<ScenarioRollouts, String> {
    let joint_scenes = records.iter().map(|record| joint_scene(record, log, &id_of));
    Ok(ScenarioRollouts {
        scenario_id: log.scenario_id.clone(),
        joint_scenes: joint_scenes.collect::<Result<_, _>>()?,
    })
}

fn joint_scene(
    record: &RolloutRecord,
    log: &WosacLog,
    id_of: impl Fn(&str) -> Option<i32>,
) -> Result<JointScene, String> {
    let (scenario, rollout) = (&log.scenario_id, record.rollout);
    let Some(shift) = record.origin else {
        return Err(format!(
            "scenario `{scenario}`, rollout {rollout}: the rollout does not state the origin of its \
             coordinates, expected rollouts that `reactsim run` wrote"
        ));
    };
    let ids = record.agent_ids.iter().enumerate();
    let places: BTreeMap<i32, usize> = ids.filter_map(|(place, id)| Some((id_of(id)?, place))).collect();
    let is_absent = |track: &&WosacTrack| !places.contains_key(&track.id);
    if let Some(first) = log.simulated().find(is_absent) {
        let count = log.simulated().filter(is_absent).count();
        return Err(format!(
            "scenario `{scenario}`: {count} objects that are valid at the current frame were not simulated, \
             first {}: run with `all-agents`",
            first.id
        ));
    }
    let trajectory = |track: &WosacTrack| {
        let states = &record.tracks[places[&track.id]];
        let object = format!("scenario `{scenario}`, rollout {rollout}: object {}", track.id);
        if states.len() != FUTURE {
            return Err(format!(
                "{object} has {} steps, expected the 80 of the realism metrics of Sim Agents",
                states.len()
            ));
        }
        if let Some(step) = (0..FUTURE).find(|&k| states.get(k).copied().flatten().is_none()) {
            return Err(format!("{object} is absent at step {}, expected 80 states", step + 1));
        }
        let states = states.iter().flatten();
        Ok(ObjectTrajectory {
            object_id: track.id,
            x: states.clone().map(|state| (state.x + shift.x) as f32).collect(),
            y: states.clone().map(|state| (state.y + shift.y) as f32).collect(),
            z: vec![track.z[CURRENT]; FUTURE],
            heading: states.map(|state| state.heading as f32).collect(),
        })
    };
    let trajectories = log.simulated().map(trajectory).collect::<Result<_, _>>()?;
    Ok(JointScene { trajectories })
}
