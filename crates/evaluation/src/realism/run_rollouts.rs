//! The rollouts of a run as those of a submission.

use std::collections::BTreeMap;

use reactsim_formats::rollouts::RolloutRecord;
use reactsim_scene::{
    CURRENT, FUTURE,
    wosac::{JointScene, ObjectTrajectory, ScenarioRollouts, WosacLog, WosacTrack},
};

/// The reason why the rollouts of a run are not those of a submission.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RunRolloutsError {
    /// A simulated object was not simulated in the run.
    #[error(
        "scenario `{scenario}`: {count} objects that are valid at the current frame were not simulated, first \
         {object}: run with `all-agents`"
    )]
    NotSimulated {
        /// Id of the scenario.
        scenario: String,
        /// Id of the first object.
        object: i32,
        /// Number of such objects.
        count: usize,
    },
    /// The rollouts are not in world coordinates.
    #[error(
        "scenario `{scenario}`, rollout {rollout}: the rollout does not state the origin of its coordinates, \
         expected rollouts that `reactsim run` wrote"
    )]
    NoOrigin {
        /// Id of the scenario.
        scenario: String,
        /// Index of the rollout.
        rollout: u32,
    },
    /// The rollouts have another number of steps than the challenge.
    #[error(
        "scenario `{scenario}`, rollout {rollout}: object {object} has {steps} steps, expected the 80 of the \
         realism metrics of Sim Agents"
    )]
    Steps {
        /// Id of the scenario.
        scenario: String,
        /// Index of the rollout.
        rollout: u32,
        /// Id of the object.
        object: i32,
        /// Number of steps.
        steps: usize,
    },
    /// An object disappears in a rollout.
    #[error(
        "scenario `{scenario}`, rollout {rollout}: object {object} is absent at step {step}, expected 80 states"
    )]
    Absent {
        /// Id of the scenario.
        scenario: String,
        /// Index of the rollout.
        rollout: u32,
        /// Id of the object.
        object: i32,
        /// First step without a state, from 1.
        step: usize,
    },
}

/// Converts rollouts of a run. Positions are in the world, restored in double precision before they are
/// rounded; z stays at its value of the current frame. `id_of` returns the id of an agent in the log.
///
/// # Errors
/// [`RunRolloutsError`] if an object of the log was not simulated, is absent at a step or has another number
/// of steps, or if the place of the rollouts in the world is unknown.
pub fn run_rollouts(
    records: &[RolloutRecord],
    log: &WosacLog,
    id_of: impl Fn(&str) -> Option<i32>,
) -> Result<ScenarioRollouts, RunRolloutsError> {
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
) -> Result<JointScene, RunRolloutsError> {
    let scenario = || log.scenario_id.clone();
    let Some(shift) = record.origin else {
        return Err(RunRolloutsError::NoOrigin { scenario: scenario(), rollout: record.rollout });
    };
    let ids = record.agent_ids.iter().enumerate();
    let places: BTreeMap<i32, usize> = ids.filter_map(|(place, id)| Some((id_of(id)?, place))).collect();
    let is_absent = |track: &&WosacTrack| !places.contains_key(&track.id);
    if let Some(first) = log.simulated().find(is_absent) {
        let count = log.simulated().filter(is_absent).count();
        return Err(RunRolloutsError::NotSimulated { scenario: scenario(), object: first.id, count });
    }
    let trajectory = |track: &WosacTrack| {
        let states = &record.tracks[places[&track.id]];
        if states.len() != FUTURE {
            let (rollout, object, steps) = (record.rollout, track.id, states.len());
            return Err(RunRolloutsError::Steps { scenario: scenario(), rollout, object, steps });
        }
        if let Some(step) = (0..FUTURE).find(|&k| states.get(k).copied().flatten().is_none()) {
            let (rollout, object) = (record.rollout, track.id);
            return Err(RunRolloutsError::Absent { scenario: scenario(), rollout, object, step: step + 1 });
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
