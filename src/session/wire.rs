//! Arguments of requests, and answers.

use std::fmt;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::evaluation::EvaluationError;
use crate::external::{DocumentError, ExternalError, Frame, FrameWriter, Values};
use crate::formats::FormatError;

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

from_errors!(DocumentError, EvaluationError, ExternalError, FormatError, serde_json::Error);

/// Returns an error with a text.
pub(super) fn refused<T>(text: impl fmt::Display) -> Result<T, RequestError> {
    Err(RequestError::new(text))
}

/// Returns the error for an index that is not below a count.
pub(super) fn missing(what: &str, index: usize, count: usize) -> RequestError {
    match count.checked_sub(1) {
        Some(last) => RequestError::new(format_args!("there is no {what} {index}, expected 0 to {last}")),
        None => RequestError::new(format_args!("there is no {what} {index}, and no other")),
    }
}

/// The result of a request.
pub(super) type Answer = Result<FrameWriter, RequestError>;

/// Returns an answer with a document of any length, which is a tensor: headers of frames are bounded.
pub(super) fn answer(kind: &str, document: &impl Serialize) -> Answer {
    let mut answer = FrameWriter::new(kind);
    answer.tensor("document", Values::bytes(serde_json::to_vec(document)?));
    Ok(answer)
}

pub(super) fn failed(RequestError(text): RequestError) -> FrameWriter {
    let mut answer = FrameWriter::new("error");
    answer.tensor("document", Values::bytes(Value::String(text).to_string().into_bytes()));
    answer
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
