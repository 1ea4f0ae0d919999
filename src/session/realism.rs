//! Realism metrics of rollouts in memory.

use std::collections::VecDeque;
use std::path::PathBuf;

use reactsim_formats as formats;
use serde::Deserialize;
use serde_json::{Value, json};

use super::wire::{Answer, RequestError, answer, arguments, refused};
use crate::evaluation::realism::{
    LogFiles, LogSource, RealismFailure, RealismScores, RealismSettings, ScoredPair, score_all,
};
use crate::external::Frame;
use crate::metrics::wosac::Config;
use crate::scene::FUTURE;
use crate::scene::wosac::{JointScene, ObjectTrajectory, ScenarioRollouts, WosacLog};

/// Number of logs that are kept in memory.
const MOST_LOGS: usize = 64;
/// Largest number of threads.
const MOST_JOBS: usize = 1024;
/// Values of a state: x, y, z and heading.
const VALUES: usize = 4;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScoreArguments {
    /// Files with the logs.
    logs: Vec<PathBuf>,
    configs: Vec<String>,
    /// Whether the shares of the rollouts are computed.
    shares: bool,
    /// Number of threads.
    jobs: usize,
    scenarios: Vec<Simulated>,
}

/// A scenario of a request. Its states are the tensor with the name `states-` and its index: [rollouts,
/// objects, 80, 4].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Simulated {
    id: String,
    objects: Vec<i32>,
}

/// The logs that requests name.
#[derive(Default)]
pub(super) struct LogCache {
    paths: Vec<PathBuf>,
    files: Option<LogFiles>,
    kept: VecDeque<WosacLog>,
}

impl LogCache {
    /// Turns to these files. Logs of other files are forgotten.
    fn open(&mut self, paths: Vec<PathBuf>) -> Result<(), RequestError> {
        if self.files.is_some() && self.paths == paths {
            return Ok(());
        }
        let mut recordings = Vec::new();
        for path in &paths {
            if LogSource::is_message(path) {
                recordings.push(path.clone());
                continue;
            }
            for input in formats::survey(path)?.inputs {
                let LogSource::Recording(path) = LogSource::of(input) else {
                    return refused(format_args!(
                        "{} has no recordings: expected files of the Waymo Open Motion Dataset",
                        path.display()
                    ));
                };
                recordings.push(path);
            }
        }
        *self = Self { paths, files: Some(LogFiles::new(recordings)), kept: VecDeque::new() };
        Ok(())
    }

    fn find(&mut self, id: &str) -> Result<WosacLog, String> {
        if let Some(log) = self.kept.iter().find(|log| log.scenario_id == id) {
            return Ok(log.clone());
        }
        let found = self.files.as_mut().map(|files| (files.get(id), files.take_errors()));
        let log = match found {
            Some((Ok(Some(log)), _)) => log,
            Some((Err(error), _)) => return Err(error.to_string()),
            Some((Ok(None), errors)) if !errors.is_empty() => {
                return Err(format!("no scenario file has the scenario `{id}`; {}", errors[0]));
            }
            _ => return Err(format!("no scenario file has the scenario `{id}`")),
        };
        self.kept.push_back(log.clone());
        if self.kept.len() > MOST_LOGS {
            self.kept.pop_front();
        }
        Ok(log)
    }
}

/// Scores the rollouts of several scenarios; answers with the scores of each, and with text for
/// [`summarise`].
pub(super) fn score(request: &Frame, logs: &mut LogCache) -> Answer {
    let given: ScoreArguments = arguments(request)?;
    let configs = configs(&given.configs)?;
    if !(1..=MOST_JOBS).contains(&given.jobs) {
        return refused(format_args!("{} threads, expected 1 to {MOST_JOBS}", given.jobs));
    }
    logs.open(given.logs)?;
    let mut pairs = Vec::new();
    for (index, scenario) in given.scenarios.into_iter().enumerate() {
        let rollouts = read_rollouts(request, index, &scenario)?;
        let place = "the rollouts".to_owned();
        pairs.push(match logs.find(&scenario.id) {
            Ok(log) => Ok(ScoredPair { place, log, rollouts }),
            Err(error) => Err(RealismFailure { scenario_id: Some(scenario.id), error }),
        });
    }
    let settings = RealismSettings { configs: &configs, shares: given.shares, jobs: given.jobs };
    let scores = score_all(pairs.into_iter(), &settings, &mut |_, _| ());
    let mut rows = Vec::new();
    scores.write_rows(&mut rows).map_err(RequestError::new)?;
    answer("wosac", &json!({ "scores": scores.to_text(), "rows": String::from_utf8_lossy(&rows) }))
}

fn read_rollouts(
    request: &Frame,
    index: usize,
    scenario: &Simulated,
) -> Result<ScenarioRollouts, RequestError> {
    let name = format!("states-{index}");
    let objects = scenario.objects.len();
    let rollouts = match request.shape(&name)? {
        &[rollouts, n, FUTURE, VALUES] if n == objects => rollouts,
        found => {
            return refused(format_args!(
                "`{name}` has the shape {found:?}, expected [rollouts, {objects}, {FUTURE}, {VALUES}] for the \
                 {objects} objects"
            ));
        }
    };
    let numbers = request.floats(&name, &[rollouts, objects, FUTURE, VALUES])?;
    let trajectory = |(object_id, states): (&i32, &[f64])| {
        let values = |k: usize| states.iter().skip(k).step_by(VALUES).map(|value| *value as f32).collect();
        ObjectTrajectory {
            object_id: *object_id,
            x: values(0),
            y: values(1),
            z: values(2),
            heading: values(3),
        }
    };
    let scene = |states: &[f64]| JointScene {
        trajectories: scenario.objects.iter().zip(states.chunks(FUTURE * VALUES)).map(trajectory).collect(),
    };
    let joint_scenes = numbers.chunks((objects * FUTURE * VALUES).max(1)).map(scene).collect();
    Ok(ScenarioRollouts { scenario_id: scenario.id.clone(), joint_scenes })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SummaryArguments {
    configs: Vec<String>,
}

/// Answers with the means over the scenarios of several requests, and with the shares of all rollouts if they
/// were computed. The tensor `scores` has the bytes of the texts
/// that [`score`] returned, one per line.
pub(super) fn summarise(request: &Frame) -> Answer {
    let given: SummaryArguments = arguments(request)?;
    let mut scores = RealismScores { configs: configs(&given.configs)?, ..RealismScores::default() };
    for text in request.bytes("scores")?.split(|byte| *byte == b'\n').filter(|text| !text.is_empty()) {
        scores.add_text(text).map_err(RequestError::new)?;
    }
    if scores.rows.is_empty() {
        let mut text = "no scenario could be scored".to_owned();
        scores.failures.iter().for_each(|failure| text += &format!("\n{}", failure.error));
        return refused(text);
    }
    let mut document = Vec::new();
    scores.write_json(&mut document).map_err(RequestError::new)?;
    let document: Value = serde_json::from_slice(&document).map_err(RequestError::new)?;
    answer("wosac-summary", &document)
}

fn configs(ids: &[String]) -> Result<Vec<Config>, RequestError> {
    let known = || Config::ALL.map(|config| config.id).join(", ");
    let config = |id: &String| {
        Config::find(id).ok_or_else(|| {
            RequestError::new(format_args!("unknown configuration `{id}`: expected one of {}", known()))
        })
    };
    ids.iter().map(config).collect()
}
