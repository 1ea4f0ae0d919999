//! A connection to a simulator: one request, one answer, within a time.

use std::io::{self, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, SyncSender};
use std::thread;
use std::time::{Duration, Instant};

use reactsim_scene::brief;

use super::document::{Frame, FrameWriter, read_frame};
use super::process::{Process, describe, is_interrupted, time_left};
use super::settings::Command;
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
    /// Returns the reason.
    pub(super) fn text(self) -> String {
        match self {
            Self::Broken(text) | Self::Refused(text) => text,
        }
    }
}

/// A connection to a simulator. Frames are read and written by threads of their own, so that no request can
/// wait longer than its limit.
pub(super) struct Connection {
    process: Option<Process>,
    last_lines: LastLines,
    outgoing: Sender<Vec<u8>>,
    incoming: Receiver<io::Result<Vec<u8>>>,
    /// Largest answer that is possible now, bytes.
    most: Arc<AtomicU64>,
    sequence: u64,
}

impl Connection {
    /// Starts a process, or takes our own standard input and output.
    pub(super) fn open(command: &Command, stderr: &Stderr) -> io::Result<Self> {
        let (outgoing, to_write) = mpsc::channel::<Vec<u8>>();
        // More than one frame in the queue is an answer that nobody asked for; the reader then waits.
        let (send, incoming) = mpsc::sync_channel(2);
        let most = Arc::new(AtomicU64::new(MOST_TEXT));
        let last_lines = LastLines::default();
        let (reading, writing): (Box<dyn Read + Send>, Box<dyn Write + Send>);
        let process = match command {
            Command::Shell(line) => {
                let (process, pipes) = Process::start(line)?;
                (reading, writing) = (Box::new(pipes.stdout), Box::new(pipes.stdin));
                last_lines.open();
                let (stderr, last_lines) = (stderr.clone(), last_lines.clone());
                spawn("stderr", move || stderr.drain(pipes.stderr, &last_lines))?;
                Some(process)
            }
            Command::Stdio => {
                (reading, writing) = (Box::new(io::stdin()), Box::new(io::stdout()));
                None
            }
        };
        let (limit, failed) = (Arc::clone(&most), send.clone());
        spawn("reader", move || read_frames(reading, &limit, &send))?;
        spawn("writer", move || write_frames(writing, &to_write, &failed))?;
        Ok(Self { process, last_lines, outgoing, incoming, most, sequence: 0 })
    }

    /// Sends a request and waits for its answer of type `wanted`, whose numbers have at most `numbers` bytes.
    pub(super) fn request(
        &mut self,
        mut request: FrameWriter,
        wanted: &str,
        numbers: usize,
        limit: Duration,
    ) -> Result<Frame, RequestError> {
        let deadline = Instant::now() + limit;
        let sequence = self.sequence.to_string();
        self.sequence += 1;
        request.text("seq", sequence.clone());
        self.most.store(MOST_TEXT + numbers as u64, Ordering::Relaxed);
        let frame = request.to_frame().map_err(|error| RequestError::Refused(error.to_string()))?;
        if self.outgoing.send(frame).is_err() {
            return Err(self.closed());
        }
        let bytes = match self.receive(deadline) {
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

    /// Waits for a frame. A process that has ended sends nothing more, although its children may keep its
    /// output open.
    fn receive(&mut self, deadline: Instant) -> Result<io::Result<Vec<u8>>, RecvTimeoutError> {
        loop {
            let left = time_left(deadline.saturating_duration_since(Instant::now()));
            match self.incoming.recv_timeout(left.min(LOOK_AGAIN)) {
                Err(RecvTimeoutError::Timeout) if left > LOOK_AGAIN => {}
                received => return received,
            }
            if self.process.as_mut().is_some_and(Process::has_ended) {
                // Its last answer may still be in the pipe.
                let last = self.incoming.recv_timeout(LOOK_AGAIN);
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
        let mut bye = FrameWriter::new("bye");
        bye.text("seq", self.sequence.to_string());
        if let Ok(frame) = bye.to_frame() {
            self.outgoing.send(frame).ok();
        }
        // Without a sender, the writer closes the input of the child.
        let (closed, _) = mpsc::channel();
        drop(std::mem::replace(&mut self.outgoing, closed));
        if let Some(process) = &mut self.process {
            process.wait(time_left(limit));
        }
    }

    /// Returns the error of a connection that closed: usually its process ended.
    fn closed(&mut self) -> RequestError {
        let reason =
            match self.process.as_mut().map(|process| (process.wait(time_left(TIME_TO_END)), process)) {
                Some((Some(status), _)) => describe(status),
                Some((None, process)) => {
                    process.end();
                    "it closed its standard input or output and was ended".to_owned()
                }
                None => "the parent process closed the connection".to_owned(),
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

fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
    // The threads end with their pipes; a grandchild that keeps a pipe open holds up nothing else.
    thread::Builder::new().name(format!("external {name}")).spawn(work).map(|_| ())
}

fn read_frames(mut from: Box<dyn Read + Send>, most: &AtomicU64, to: &SyncSender<io::Result<Vec<u8>>>) {
    loop {
        let read = match read_frame(&mut from, || most.load(Ordering::Relaxed)) {
            Ok(Some(bytes)) => Ok(bytes),
            Ok(None) => Err(io::ErrorKind::UnexpectedEof.into()),
            Err(error) => Err(error),
        };
        let is_end = read.is_err();
        if to.send(read).is_err() || is_end {
            return;
        }
    }
}

fn write_frames(
    mut to: Box<dyn Write + Send>,
    frames: &Receiver<Vec<u8>>,
    failed: &SyncSender<io::Result<Vec<u8>>>,
) {
    for frame in frames {
        if let Err(error) = to.write_all(&frame).and_then(|()| to.flush()) {
            failed.send(Err(io::Error::new(io::ErrorKind::BrokenPipe, error))).ok();
            return;
        }
    }
}
