//! Checks of the answers of simulators.

use std::collections::BTreeMap;

use reactsim_rollout::{Episode, PlanError};
use reactsim_scene::{AgentState, DT, FUTURE, brief, named_enum};

use super::document::{DocumentError, Frame};
use super::settings::MOST_PER_BATCH;

/// Largest distance of a planned position from the origin, metres: farther ones are errors of units or
/// frames, not motion.
const FARTHEST: f64 = 1e5;

/// Largest length of texts that a simulator states about itself, bytes.
const LONGEST_TEXT: usize = 200;

named_enum! {
    name;

    /// Role of an external program in a run.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Role {
        /// It moves the agents.
        Simulator = "simulator",
        /// It plans trajectories of the AV.
        Planner = "planner",
    }
}

/// The statement of a simulator or planner about itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// Its role.
    pub role: Role,
    /// Name.
    pub name: String,
    /// Version; may be empty.
    pub version: String,
    /// SHA-256 digest of its weights, 64 lower-case hexadecimal digits, if it has any.
    pub weights_sha256: Option<String>,
    /// Supported replan intervals, steps; empty for any.
    pub intervals: Vec<usize>,
    /// Wanted number of episodes per batch.
    pub batch: Option<usize>,
    /// Whether it supports scenarios of any length, and not only of that of the benchmark.
    pub any_length: bool,
}

impl Description {
    /// Reads `welcome`.
    pub fn read(frame: &Frame) -> Result<Self, DocumentError> {
        let refuse = |text: String| DocumentError(format!("`welcome`: {text}"));
        let short = |key: &str| {
            let text = frame.optional_text(key).unwrap_or_default().trim();
            if text.len() > LONGEST_TEXT || text.chars().any(char::is_control) {
                return Err(refuse(format!("`{key}` is longer than {LONGEST_TEXT} bytes or not one line")));
            }
            Ok(text.to_owned())
        };
        let name = short("name")?;
        if name.is_empty() {
            return Err(refuse("`name` is missing or empty".to_owned()));
        }
        let role = match frame.optional_text("role") {
            // Simulators need not state it.
            None | Some("" | "simulator") => Role::Simulator,
            Some("planner") => Role::Planner,
            Some(other) => {
                let other = brief(other);
                return Err(refuse(format!("`role` is {other:?} instead of `simulator` or `planner`")));
            }
        };
        let digest = short("weights_sha256")?.to_ascii_lowercase();
        if !digest.is_empty() && (digest.len() != 64 || !digest.bytes().all(|b| b.is_ascii_hexdigit())) {
            let text = format!("`weights_sha256` is {digest:?} instead of 64 hexadecimal digits");
            return Err(refuse(text));
        }
        let intervals: Vec<usize> = match frame.optional_text("intervals") {
            None | Some("") => Vec::new(),
            Some(text) => serde_json::from_str(text)
                .map_err(|e| refuse(format!("`intervals` is {text:?}, not a list of steps: {e}")))?,
        };
        if let Some(wrong) = intervals.iter().find(|steps| !(1..=FUTURE).contains(*steps)) {
            return Err(refuse(format!("`intervals` has {wrong}: 1 to {FUTURE} steps are possible")));
        }
        let batch = match frame.optional_text("batch") {
            None | Some("") => None,
            Some(text) => {
                let found = text.parse().ok().filter(|n| (1..=MOST_PER_BATCH).contains(n));
                let wrong = || refuse(format!("`batch` is {text:?} instead of 1 to {MOST_PER_BATCH}"));
                Some(found.ok_or_else(wrong)?)
            }
        };
        let any_length = match frame.optional_text("lengths") {
            None | Some("") => false,
            Some("any") => true,
            Some(other) => {
                let other = brief(other);
                return Err(refuse(format!("`lengths` is {other:?} instead of `any`, or nothing")));
            }
        };
        let weights_sha256 = Some(digest).filter(|d| !d.is_empty());
        Ok(Self { role, name, version: short("version")?, weights_sha256, intervals, batch, any_length })
    }
}

/// Returns the errors that `planned` states, by the index of their episode in the batch of `b` episodes.
fn errors(frame: &Frame, b: usize) -> Result<BTreeMap<usize, String>, DocumentError> {
    let Some(text) = frame.optional_text("errors").filter(|t| !t.is_empty()) else {
        return Ok(BTreeMap::new());
    };
    let errors: BTreeMap<usize, String> = serde_json::from_str(text).map_err(|e| {
        DocumentError(format!("`errors` is not an object from indices of episodes to texts: {e}"))
    })?;
    match errors.keys().find(|index| **index >= b) {
        Some(index) => Err(DocumentError(format!("`errors` names episode {index} of a batch of {b}"))),
        None => Ok(errors),
    }
}

/// Poses of the centre of the AV in a plan: x and y (m, frame of the scenario) and heading (rad).
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedPoses {
    /// After 1, 2, … steps.
    pub poses: Vec<[f64; 3]>,
    /// At the present time, if the planner states it. Otherwise the plan begins at the AV.
    pub present: Option<[f64; 3]>,
}

/// Returns the trajectory of `planned`, with `steps` to `most` poses after the present. `Err` inside if the
/// planner reports a failure.
///
/// # Errors
/// If the answer has not the shape that was asked for, or numbers that are no poses in metres and radians.
pub(super) fn trajectory(
    frame: &Frame,
    steps: usize,
    most: usize,
) -> Result<Result<PlannedPoses, String>, DocumentError> {
    if let Some(text) = errors(frame, 1)?.remove(&0) {
        return Ok(Err(format!("the planner reports: {}", brief(text.trim_end()))));
    }
    let shape = frame.shape("trajectory")?;
    let &[1, poses, 3] = shape else {
        let text = format!("`trajectory` has the shape {shape:?} instead of [1, {steps} to {most}, 3]");
        return Err(DocumentError(text));
    };
    if !(steps..=most).contains(&poses) {
        return Err(DocumentError(format!(
            "`trajectory` has {poses} poses; it needs {steps}, the steps until the next plan, to {most}"
        )));
    }
    let numbers = frame.floats("trajectory", &[1, poses, 3])?;
    let poses = numbers.as_chunks::<3>().0.to_vec();
    let has_present = frame.shape("present").is_ok();
    let present = if has_present { frame.floats("present", &[1, 3])? } else { Vec::new() };
    let present = present.as_chunks::<3>().0.first().copied();
    let later = (1..).zip(&poses).map(|(step, pose)| (step, "trajectory", pose));
    for (step, tensor, pose) in present.iter().map(|pose| (0, "present", pose)).chain(later) {
        if let Some((axis, value, expected)) = impossible(*pose) {
            let text = format!("`{tensor}`: {axis} of pose {step} is {value}, expected {expected}");
            return Err(DocumentError(text));
        }
    }
    Ok(Ok(PlannedPoses { poses, present }))
}

/// Returns the first impossible value of a pose with its axis and what it should have been; NaN is
/// impossible.
fn impossible(pose: [f64; 3]) -> Option<(&'static str, f64, &'static str)> {
    let position = "metres from the origin of the scenario";
    let axes = [("x", position), ("y", position), ("heading", "radians, not degrees")];
    let mut values = axes.into_iter().zip(pose).map(|((axis, expected), value)| (axis, value, expected));
    values.find(|(_, value, _)| value.is_nan() || value.abs() >= FARTHEST)
}

/// Puts the plans of `planned` into the episodes. `active` are the episodes of the request by their index in
/// the batch of `b` episodes with at most `n` agents. Errors of single episodes go into these.
///
/// # Errors
/// If the answer as a whole has not the shape that was asked for.
pub(super) fn take_plans(
    frame: &Frame,
    (b, n): (usize, usize),
    active: &mut [(usize, &mut Episode<'_>)],
) -> Result<(), DocumentError> {
    let steps = active.first().map_or(0, |(_, episode)| episode.plan.steps());
    let states = frame.floats("states", &[b, n, steps, 3])?;
    let mut errors = errors(frame, b)?;
    for (index, episode) in active {
        if let Some(text) = errors.remove(index) {
            let text = format!("the simulator reports: {}", brief(text.trim_end()));
            episode.error = Some(PlanError::Failed(text));
            continue;
        }
        let of_episode = &states[*index * n * steps * 3..][..n * steps * 3];
        if let Err(text) = take_plan(of_episode, steps, episode) {
            episode.error = Some(PlanError::Failed(text));
        }
    }
    Ok(())
}

fn take_plan(states: &[f64], steps: usize, episode: &mut Episode<'_>) -> Result<(), String> {
    let first = usize::from(!episode.moves_av);
    for slot in first..episode.plan.agents() {
        let Some(mut before) = episode.seen.state(slot) else { continue };
        for k in 0..steps {
            let at = (slot * steps + k) * 3;
            let pose @ [x, y, heading] = [states[at], states[at + 1], states[at + 2]];
            if let Some((axis, value, expected)) = impossible(pose) {
                let step = episode.seen.step() + k + 1;
                return Err(format!(
                    "`states`: {axis} of agent {slot} at step {step} is {value}, expected {expected}"
                ));
            }
            let (vx, vy) = ((x - before.x) / DT, (y - before.y) / DT);
            before = AgentState { x, y, heading, vx, vy };
            episode.plan.set(slot, k, Some(before));
        }
    }
    Ok(())
}
