//! The loop of requests and answers.

use std::fmt;
use std::io::{self, Read, Write};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;

use super::drive::Environment;
use super::realism::LogCache;
use super::scenarios::ScenarioCache;
use super::world::World;
use super::{realism, requests, scores, world_requests};
use crate::evaluation::EvaluationError;
use crate::external::{DocumentError, Frame, FrameWriter, Values, read_frame};
use crate::formats::FormatError;

/// Largest request, bytes.
const MOST_BYTES: u64 = 4 << 30;

/// The reason why a request has no result; the text names what is expected and what was found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct RequestError(String);

impl RequestError {
    /// Creates an error with a text.
    pub(super) fn new(text: impl fmt::Display) -> Self {
        Self(text.to_string())
    }
}

macro_rules! from_errors {
    ($($error:ty),*) => {$(
        impl From<$error> for RequestError {
            fn from(error: $error) -> Self {
                Self::new(error)
            }
        }
    )*};
}

from_errors!(DocumentError, EvaluationError, FormatError);

/// The result of a request.
pub(super) type Answer = Result<FrameWriter, RequestError>;

/// Answers the requests that are read from `input` until it ends. A request that cannot be answered gives an
/// answer of the type `error`, and the next one is read.
///
/// # Errors
/// If the input contains something other than frames, or the output is closed.
pub fn serve(input: &mut dyn Read, output: &mut dyn Write) -> io::Result<()> {
    let mut session = Session::default();
    while let Some(bytes) = read_frame(input, || MOST_BYTES)? {
        output.write_all(&session.answer(bytes).to_frame().map_err(io::Error::other)?)?;
        output.flush()?;
    }
    Ok(())
}

/// State of the process between requests.
#[derive(Default)]
struct Session {
    scenarios: ScenarioCache,
    logs: LogCache,
    environment: Option<Environment>,
    world: Option<World>,
}

impl Session {
    fn answer(&mut self, bytes: Vec<u8>) -> FrameWriter {
        let frame = match Frame::read(bytes) {
            Ok(frame) => frame,
            Err(error) => return failed(&error.to_string()),
        };
        let mut answer = self.result(&frame).unwrap_or_else(|RequestError(text)| failed(&text));
        if let Some(number) = frame.optional_text("seq") {
            answer.text("seq", number);
        }
        answer
    }

    fn result(&mut self, request: &Frame) -> Answer {
        match request.text("type")? {
            "score" => scores::score(request, &mut self.scenarios),
            "wosac" => realism::score(request, &mut self.logs),
            "wosac-summary" => realism::summarise(request),
            "environment" => requests::create(request, &mut self.environment),
            "reset" => requests::reset(request, &mut self.environment),
            "step" => requests::step(request, &mut self.environment),
            "tracks" => requests::tracks(request, &mut self.environment),
            "world" => world_requests::create(request, &mut self.world),
            "world-reset" => world_requests::reset(request, &mut self.world),
            "world-step" => world_requests::step(request, &mut self.world),
            "world-tracks" => world_requests::tracks(&mut self.world),
            other => Err(RequestError::new(format_args!(
                "unknown request `{other}`: expected score, wosac, wosac-summary, environment, reset, step, \
                 tracks, world, world-reset, world-step or world-tracks"
            ))),
        }
    }
}

/// Returns the answer to a request that failed.
fn failed(text: &str) -> FrameWriter {
    let mut answer = FrameWriter::new("error");
    answer.tensor("document", Values::bytes(json!(text).to_string().into_bytes()));
    answer
}

/// Returns an answer with a document of any length, which is a tensor: headers of frames are bounded.
pub(super) fn answer(kind: &str, document: &impl Serialize) -> Answer {
    let mut answer = FrameWriter::new(kind);
    answer.tensor("document", Values::bytes(serde_json::to_vec(document).map_err(RequestError::new)?));
    Ok(answer)
}

/// Returns the arguments of a request: the tensor `arguments`, whose bytes are JSON.
pub(super) fn arguments<T: DeserializeOwned>(request: &Frame) -> Result<T, RequestError> {
    let mut json = serde_json::Deserializer::from_slice(request.bytes("arguments")?);
    serde_path_to_error::deserialize(&mut json).map_err(|error| {
        let (place, text) = (error.path().to_string(), error.inner().to_string());
        let text = text.split(" at line ").next().unwrap_or_default();
        let place = if place == "." { "the arguments".to_owned() } else { format!("the argument `{place}`") };
        RequestError::new(format_args!("{place} of the request: {}", in_words(text)))
    })
}

/// Returns a message of the JSON reader with its types of numbers in words.
fn in_words(text: &str) -> String {
    let words = [
        ("expected usize", "expected a whole number, 0 or more"),
        ("expected u64", "expected a whole number, 0 or more"),
        ("expected u32", "expected a whole number, 0 to 4294967295"),
        ("expected a nonzero usize", "expected a whole number, 1 or more"),
        ("expected i32", "expected a whole number"),
    ];
    words.into_iter().fold(text.to_owned(), |text, (rust, plain)| text.replace(rust, plain))
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::scene::FUTURE;

    /// A request: its type, its arguments and a tensor.
    type Sent<'a> = (&'a str, Value, Option<(&'static str, Values)>);

    /// Sends requests; returns the answers.
    fn answers(requests: &[Sent<'_>]) -> Vec<Frame> {
        let mut input = Vec::new();
        for (seq, (kind, arguments, tensor)) in requests.iter().enumerate() {
            let mut frame = FrameWriter::new(kind);
            frame.text("seq", seq.to_string());
            frame.tensor("arguments", Values::bytes(arguments.to_string().into_bytes()));
            if let Some((name, values)) = tensor {
                frame.tensor(name, values.clone());
            }
            input.extend(frame.to_frame().unwrap());
        }
        let mut output = Vec::new();
        serve(&mut input.as_slice(), &mut output).unwrap();
        let mut rest = output.as_slice();
        let mut found = Vec::new();
        while let Some(bytes) = read_frame(&mut rest, || MOST_BYTES).unwrap() {
            found.push(Frame::read(bytes).unwrap());
        }
        let numbers: Vec<&str> = found.iter().map(|answer| answer.text("seq").unwrap()).collect();
        assert_eq!(numbers, (0..requests.len()).map(|seq| seq.to_string()).collect::<Vec<_>>());
        found
    }

    fn document(answer: &Frame) -> Value {
        serde_json::from_slice(answer.bytes("document").unwrap()).unwrap()
    }

    fn error(answer: &Frame) -> String {
        assert_eq!(answer.text("type").unwrap(), "error");
        document(answer).as_str().unwrap().to_owned()
    }

    /// Arguments of an environment with small arrays.
    fn environment(action: &Value) -> Value {
        json!({
            "reading": { "paths": [] }, "ids": [], "limit": 2, "simulator": "idm", "weights": {},
            "parameters": {}, "replan": "2hz", "av_lookahead": true, "seed": 0, "action": action, "every": 1,
            "sizes": { "agents": 3, "history": 2, "lanes": 4, "points": 3, "lights": 1, "route": 2 },
            "end_at": [], "scores": true, "metric_options": {},
        })
    }

    fn begin(slot: usize, scenario: usize) -> Value {
        json!({ "slot": slot, "scenario": scenario, "rollout": 0 })
    }

    #[test]
    fn wrong_requests_are_answered_with_their_fault() {
        let none = json!({ "episodes": [] });
        let unknown = json!({ "reading": { "paths": [] }, "scenario": "x", "simulator": "s", "agents": ["a"],
            "allow": [], "pose": null, "metric_options": {} });
        let found = answers(&[
            ("draw", json!({}), None),
            ("step", none, None),
            ("score", json!({}), None),
            ("score", unknown, None),
        ]);
        assert_eq!(
            error(&found[0]),
            "unknown request `draw`: expected score, wosac, wosac-summary, environment, reset, step, tracks, \
             world, world-reset, world-step or world-tracks"
        );
        assert_eq!(error(&found[1]), "there is no environment: create one first");
        assert!(error(&found[2]).starts_with("the arguments of the request: missing field `reading`"));
        assert_eq!(error(&found[3]), "no scenario `x` in the shipped benchmark");
    }

    #[test]
    fn episodes_are_stepped_restarted_and_scored() {
        let both = json!({ "episodes": [begin(0, 0), begin(1, 1)] });
        let actions = || Some(("actions", Values::f64(&[2, 2], [0.5, 0.0, -1.0, 0.01])));
        let mut requests = vec![("environment", environment(&json!("bicycle")), None), ("reset", both, None)];
        let none = json!({ "episodes": [] });
        requests.extend((0..FUTURE).map(|_| ("step", none.clone(), actions())));
        requests.push(("step", none.clone(), actions()));
        requests.push(("step", json!({ "episodes": [begin(0, 1), begin(1, 1)] }), actions()));
        requests.push(("tracks", json!({ "slot": 1 }), None));
        let found = answers(&requests);
        let description = document(&found[0]);
        assert_eq!(description["scenarios"].as_array().unwrap().len(), 2);
        assert_eq!(found[1].shape("agents").unwrap(), [2, 3, 2, 7]);
        let last = &found[1 + FUTURE];
        let ends = document(last);
        assert!(ends["1"]["rows"][0]["metrics"]["aav-collision"]["count"].is_u64());
        assert_eq!(document(&found[FUTURE]), json!({}));
        assert_eq!(error(&found[2 + FUTURE]), "the episode in slot 0 is over: reset it");
        assert_eq!(found[3 + FUTURE].text("type").unwrap(), "stepped");
        assert_eq!(found[4 + FUTURE].shape("states").unwrap()[1..], [11, 5]);
    }

    #[test]
    fn impossible_settings_and_actions_are_refused() {
        let one = || json!({ "episodes": [begin(0, 0)] });
        let far = Some(("actions", Values::f64(&[1, 5], [900.0, 0.0, 0.0, 0.0, 0.0])));
        let found = answers(&[
            ("environment", environment(&json!({ "plan": { "poses": 0 } })), None),
            ("environment", environment(&json!("state")), None),
            ("reset", json!({ "episodes": [begin(0, 7)] }), None),
            ("reset", one(), None),
            ("step", json!({ "episodes": [] }), far),
            ("tracks", json!({ "slot": 0 }), None),
        ]);
        assert_eq!(error(&found[0]), "a plan has 0 poses, expected 1 to 80: at least `every`");
        assert_eq!(error(&found[2]), "there is no scenario 7, expected 0 to 1");
        assert!(error(&found[4]).contains("expected at most 8.0 m"), "{}", error(&found[4]));
        assert_eq!(found[5].shape("states").unwrap()[1..], [11, 5]);
    }
}
