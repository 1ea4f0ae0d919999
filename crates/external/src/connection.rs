//! A connection to a simulator: one request, one answer, within a time.

use std::io;
use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use reactsim_scene::brief;

use super::document::{DocumentError, Frame, FrameWriter};
use super::pipe::{Parent, Pipe, spawn};
use super::process::{Process, describe, is_interrupted, time_left};
use super::settings::{Command, STDIO};
use super::stderr::{LastLines, Stderr};

/// Bytes of an answer beyond its numbers: header, names, texts of errors.
const MOST_TEXT: u64 = 1 << 20;

/// Time in which a process that closed its output must end before it is ended.
const TIME_TO_END: Duration = Duration::from_secs(2);

/// Time between two looks whether the process of an awaited answer still runs.
const LOOK_AGAIN: Duration = Duration::from_millis(200);

/// Why a request has no answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum RequestError {
    /// The connection cannot be used any more.
    Broken(String),
    /// The simulator answered `failed`, or with content that cannot be used. The connection goes on.
    Refused(String),
}

impl RequestError {
    pub(super) fn text(self) -> String {
        match self {
            Self::Broken(text) | Self::Refused(text) => text,
        }
    }
}

/// A connection to a simulator or planner.
pub(super) struct Connection {
    process: Option<Process>,
    last_lines: LastLines,
    pipe: Arc<Mutex<Pipe>>,
    /// Texts of all requests: which program of the parent process they are for.
    address: Vec<(&'static str, String)>,
}

impl Connection {
    /// Starts a process, or takes the streams of the parent process, where the connection has a name and a
    /// number.
    pub(super) fn open(command: &Command, stderr: &Stderr, name: &str, number: usize) -> io::Result<Self> {
        let last_lines = LastLines::default();
        match command {
            Command::Shell(line) => {
                let (process, pipes) = Process::start(line)?;
                last_lines.open();
                let (stderr, to) = (stderr.clone(), last_lines.clone());
                spawn("stderr", move || stderr.drain(pipes.stderr, &to))?;
                let mut pipe = Pipe::new(pipes.stdout, pipes.stdin, MOST_TEXT);
                pipe.start_threads()?;
                let pipe = Arc::new(Mutex::new(pipe));
                Ok(Self { process: Some(process), last_lines, pipe, address: Vec::new() })
            }
            Command::Parent(Parent(pipe)) => {
                pipe.lock().start_threads()?;
                let address = vec![("to", name.to_owned()), ("worker", number.to_string())];
                Ok(Self { process: None, last_lines, pipe: Arc::clone(pipe), address })
            }
        }
    }

    /// Sends a request and waits for its answer of type `wanted`, whose numbers have at most `numbers` bytes.
    pub(super) fn request(
        &mut self,
        mut request: FrameWriter,
        wanted: &str,
        numbers: usize,
        limit: Duration,
    ) -> Result<Frame, RequestError> {
        // Other programs of the parent process wait until this one has answered.
        let pipe = Arc::clone(&self.pipe);
        let mut pipe = pipe.lock();
        if pipe.is_broken {
            let text = "another request to the parent process had no answer".to_owned();
            return Err(RequestError::Broken(text));
        }
        let began = Instant::now();
        let sequence = pipe.number();
        pipe.expect(MOST_TEXT + numbers as u64);
        let frame = self.addressed(&mut request, &sequence);
        let frame = frame.map_err(|error| RequestError::Refused(error.to_string()))?;
        if !pipe.send(frame) {
            return Err(self.closed());
        }
        let received = self.receive(&pipe, began, limit);
        pipe.is_broken = received.is_err();
        drop(pipe);
        let bytes = match received {
            Ok(Ok(bytes)) => bytes,
            Ok(Err(error)) => {
                let is_closed =
                    matches!(error.kind(), io::ErrorKind::UnexpectedEof | io::ErrorKind::BrokenPipe);
                return Err(if is_closed { self.closed() } else { self.broken(&error.to_string()) });
            }
            Err(RecvTimeoutError::Timeout) if is_interrupted() => {
                return Err(self.broken(&format!("interrupted before `{wanted}`")));
            }
            Err(RecvTimeoutError::Timeout) => {
                let seconds = limit.as_secs_f64();
                return Err(self.broken(&format!("no `{wanted}` within {seconds} s")));
            }
            Err(RecvTimeoutError::Disconnected) => return Err(self.closed()),
        };
        let frame = match Frame::read(bytes) {
            Ok(frame) => frame,
            Err(error) => return Err(self.broken(&error.to_string())),
        };
        let kind = brief(frame.text("type").unwrap_or_default()).into_owned();
        match frame.optional_text("seq") {
            Some(found) if found == sequence => {}
            found => {
                let found = brief(found.unwrap_or("nothing"));
                let text = format!("`{kind}` answers request {found} instead of request {sequence}");
                return Err(self.broken(&text));
            }
        }
        if kind == "failed" {
            let text = frame.optional_text("error").unwrap_or("it gives no reason").trim_end();
            return Err(RequestError::Refused(brief(text).into_owned()));
        }
        if kind != wanted {
            return Err(self.broken(&format!("it answered `{kind}` instead of `{wanted}`")));
        }
        Ok(frame)
    }

    /// Returns the frame of a request with this number.
    fn addressed(&self, request: &mut FrameWriter, sequence: &str) -> Result<Vec<u8>, DocumentError> {
        for (key, text) in &self.address {
            request.text(key, text.clone());
        }
        request.text("seq", sequence);
        request.to_frame()
    }

    /// Waits for a frame until the time since `began` reaches the limit. A process that has ended sends nothing
    /// more, although its children may keep its output open.
    fn receive(
        &mut self,
        pipe: &Pipe,
        began: Instant,
        limit: Duration,
    ) -> Result<io::Result<Vec<u8>>, RecvTimeoutError> {
        loop {
            let left = time_left(limit.saturating_sub(began.elapsed()));
            match pipe.receive(left.min(LOOK_AGAIN)) {
                Err(RecvTimeoutError::Timeout) if left > LOOK_AGAIN => {}
                received => return received,
            }
            if self.process.as_mut().is_some_and(Process::has_ended) {
                // Its last answer may still be in the pipe.
                let last = pipe.receive(LOOK_AGAIN);
                return last.map_err(|_| RecvTimeoutError::Disconnected);
            }
        }
    }

    /// Returns the last lines of the standard error of the process, as a text to append to a message.
    pub(super) fn last_lines(&self) -> String {
        self.last_lines.text()
    }

    /// Says `bye` and gives the process the time to end; then it is ended.
    pub(super) fn close(mut self, limit: Duration) {
        let pipe = Arc::clone(&self.pipe);
        let mut pipe = pipe.lock();
        let sequence = pipe.number();
        if let Ok(frame) = self.addressed(&mut FrameWriter::new("bye"), &sequence) {
            pipe.send(frame);
        }
        if let Some(process) = &mut self.process {
            pipe.close();
            process.wait(time_left(limit));
        }
    }

    /// Returns the error of a connection that closed: usually its process ended.
    fn closed(&mut self) -> RequestError {
        let ended = self.process.as_mut().map(|process| (process.wait(time_left(TIME_TO_END)), process));
        let reason = match ended {
            Some((Some(status), _)) => describe(status),
            Some((None, process)) => {
                process.end();
                "it closed its standard input or output and was ended".to_owned()
            }
            None => format!(
                "the parent process closed the connection; a program with {STDIO} runs in the script that \
                 starts this one"
            ),
        };
        RequestError::Broken(format!("{reason}{}", self.last_lines.text()))
    }

    /// Returns the error of a connection with content that cannot be used; the process is ended.
    fn broken(&mut self, reason: &str) -> RequestError {
        let ending = match &mut self.process {
            Some(process) => {
                process.end();
                "; it was ended"
            }
            None => "",
        };
        RequestError::Broken(format!("{reason}{ending}{}", self.last_lines.text()))
    }
}
