//! The loop of requests and answers.

use std::fmt;
use std::io::{self, Read, Write};

use reactsim_evaluation::EvaluationError;
use reactsim_external::{DocumentError, Frame, FrameWriter, read_frame};
use reactsim_formats::FormatError;
use serde::de::DeserializeOwned;

use super::scenarios::ScenarioCache;
use super::scores;

/// Largest request, bytes.
const MOST_BYTES: u64 = 4 << 30;

/// The reason why a request has no result.
#[derive(Debug)]
pub(super) struct RequestError(String);

impl RequestError {
    /// Creates an error with a text that names what is expected and what was found.
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
        output.write_all(&session.answer(bytes).to_frame())?;
        output.flush()?;
    }
    Ok(())
}

/// What the process keeps between requests.
#[derive(Default)]
struct Session {
    scenarios: ScenarioCache,
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
            other => Err(RequestError::new(format_args!("unknown request `{other}`: expected `score`"))),
        }
    }
}

/// Returns the answer to a request that failed.
fn failed(text: &str) -> FrameWriter {
    let mut answer = FrameWriter::new("error");
    answer.text("error", text);
    answer
}

/// Returns the arguments of a request.
pub(super) fn arguments<T: DeserializeOwned>(request: &Frame) -> Result<T, RequestError> {
    let text = request.text("arguments")?;
    serde_json::from_str(text)
        .map_err(|error| RequestError::new(format_args!("the arguments of the request: {error}")))
}
