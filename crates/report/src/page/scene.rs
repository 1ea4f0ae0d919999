//! One scenario with the rollouts of simulators, as JSON.

use reactsim_evaluation::EventRecord;
use reactsim_formats::sketch;
use reactsim_scene::{Frame, Scenario};
use serde::Serialize;
use serde_json::value::RawValue;

use super::tracks::spans;

/// Version of the JSON format.
const VERSION: u32 = 1;

/// One rollout of a subject.
pub(super) struct SubjectRollout {
    /// Index of the subject.
    pub(super) subject: usize,
    /// The frames of each agent of the scenario.
    pub(super) tracks: Vec<Vec<Frame>>,
    /// Events of this rollout.
    pub(super) events: Vec<EventRecord>,
}

#[derive(Serialize)]
struct Scene<'a> {
    v: u32,
    id: &'a str,
    source: &'a str,
    /// Map, lights and log ([`sketch`]).
    sketch: Box<RawValue>,
    subjects: Vec<Subject<'a>>,
}

#[derive(Serialize)]
struct Subject<'a> {
    subject: usize,
    /// Encoded spans of each agent ([`spans`]).
    tracks: Vec<Vec<Vec<i64>>>,
    events: Vec<SceneEvent<'a>>,
}

/// An event; agents by their index in the scenario.
#[derive(Serialize)]
struct SceneEvent<'a> {
    metric: &'a str,
    agent: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    partner: Option<usize>,
    step: usize,
    last: usize,
    counted: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<&'a str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    values: Vec<(&'a str, f64)>,
}

pub(super) fn scene(scenario: &Scenario, rollouts: &[SubjectRollout]) -> serde_json::Result<String> {
    let current = scenario.start.current();
    let place = |id: &str| scenario.start.agents.iter().position(|a| a.id == id);
    let subjects = rollouts.iter().map(|rollout| Subject {
        subject: rollout.subject,
        tracks: rollout.tracks.iter().map(|track| spans(track, current)).collect(),
        events: rollout
            .events
            .iter()
            .filter_map(|event| {
                Some(SceneEvent {
                    metric: &event.metric,
                    agent: place(&event.agent)?,
                    partner: event.partner.as_deref().and_then(place),
                    step: event.step,
                    last: event.last_step,
                    counted: event.counted,
                    reason: event.reason.as_deref(),
                    values: event.values.iter().map(|(n, v)| (n.as_str(), (v * 1e3).round() / 1e3)).collect(),
                })
            })
            .collect(),
    });
    serde_json::to_string(&Scene {
        v: VERSION,
        id: &scenario.id,
        source: &scenario.source,
        sketch: RawValue::from_string(sketch(scenario))?,
        subjects: subjects.collect(),
    })
}
