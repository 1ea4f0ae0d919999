//! Two streams of frames, to and from another process.

use std::fmt;
use std::io::{self, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, SyncSender};
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use super::document::read_frame;
use super::process::time_left;

/// Time that the parent process has for reading the last frames.
const TIME_TO_READ: Duration = Duration::from_secs(5);

/// Largest frame of the parent process that is no answer, bytes.
const MOST_UNASKED: u64 = 4 << 30;

/// Two streams of frames.
pub(super) struct Pipe {
    streams: Streams,
    /// Largest frame that is possible now, bytes.
    most: Arc<AtomicU64>,
    /// Whether the other process asks as well.
    is_parent: bool,
    /// Whether a request had no answer. It may come later, and is not the answer of another program.
    pub(super) is_broken: bool,
    /// Number of the next request.
    sequence: u64,
}

/// Owner of the streams of a [`Pipe`].
enum Streams {
    /// The thread that uses the pipe. It waits as long as the other process does.
    Direct { input: Box<dyn Read + Send>, output: Box<dyn Write + Send> },
    /// Threads of their own, so that no request can wait longer than its limit.
    Threads {
        outgoing: Option<Sender<Vec<u8>>>,
        incoming: Receiver<io::Result<Vec<u8>>>,
        /// Ends when everything is written.
        written: Receiver<()>,
    },
}

impl Pipe {
    /// Takes the streams, which are used directly at first. `most` is the size of the largest frame that is
    /// possible at first, bytes.
    pub(super) fn new(
        input: impl Read + Send + 'static,
        output: impl Write + Send + 'static,
        most: u64,
    ) -> Self {
        let streams = Streams::Direct { input: Box::new(input), output: Box::new(output) };
        let most = Arc::new(AtomicU64::new(most));
        Self { streams, most, is_parent: false, is_broken: false, sequence: 0 }
    }

    /// Creates the threads that read and write the streams from now on, unless there are any.
    ///
    /// # Errors
    /// If a thread cannot be started; the streams are used directly then, as before.
    pub(super) fn start_threads(&mut self) -> io::Result<()> {
        if matches!(self.streams, Streams::Threads { .. }) {
            return Ok(());
        }
        let (outgoing, to_write) = mpsc::channel::<Vec<u8>>();
        // More than one frame in the queue is an answer that nobody asked for; the reader then waits.
        let (send, incoming) = mpsc::sync_channel(2);
        let (writing, written) = mpsc::channel();
        let (limit, failed) = (Arc::clone(&self.most), send.clone());
        // The threads receive the streams once both run.
        let (to_reader, input) = mpsc::channel::<Box<dyn Read + Send>>();
        let (to_writer, output) = mpsc::channel::<Box<dyn Write + Send>>();
        spawn("reader", move || {
            if let Ok(input) = input.recv() {
                read_frames(input, &limit, &send);
            }
        })?;
        spawn("writer", move || {
            if let Ok(output) = output.recv() {
                write_frames(output, &to_write, &failed);
            }
            drop(writing);
        })?;
        let threads = Streams::Threads { outgoing: Some(outgoing), incoming, written };
        if let Streams::Direct { input, output } = std::mem::replace(&mut self.streams, threads) {
            to_reader.send(input).ok();
            to_writer.send(output).ok();
        }
        Ok(())
    }

    /// Returns the number of a new request.
    pub(super) fn number(&mut self) -> String {
        self.sequence += 1;
        (self.sequence - 1).to_string()
    }

    /// Sets the size of the largest frame that is possible now, bytes.
    pub(super) fn expect(&self, most: u64) {
        self.most.store(most, Ordering::Relaxed);
    }

    /// Sends a frame; returns whether the stream is open.
    pub(super) fn send(&mut self, frame: Vec<u8>) -> bool {
        match &mut self.streams {
            Streams::Direct { output, .. } => output.write_all(&frame).and_then(|()| output.flush()).is_ok(),
            Streams::Threads { outgoing, .. } => {
                outgoing.as_ref().is_some_and(|outgoing| outgoing.send(frame).is_ok())
            }
        }
    }

    /// Waits for a frame, which needs the threads. The end of the stream is [`io::ErrorKind::UnexpectedEof`].
    pub(super) fn receive(&self, time: Duration) -> Result<io::Result<Vec<u8>>, RecvTimeoutError> {
        let Streams::Threads { incoming, .. } = &self.streams else {
            return Err(RecvTimeoutError::Disconnected);
        };
        let received = incoming.recv_timeout(time);
        if self.is_parent && received.is_ok() {
            self.expect(MOST_UNASKED);
        }
        received
    }

    /// Closes the stream that is written, once everything is written.
    pub(super) fn close(&mut self) {
        if let Streams::Threads { outgoing, .. } = &mut self.streams {
            *outgoing = None;
        }
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        self.close();
        if let (Streams::Threads { written, .. }, true) = (&self.streams, self.is_parent) {
            // What this process writes next follows the frames.
            written.recv_timeout(time_left(TIME_TO_READ)).ok();
        }
    }
}

/// The process that started this one. It may ask over two streams, such as our standard input and output, and
/// have simulators and planners that are asked over the same streams. Clones share the streams.
#[derive(Clone)]
pub struct Parent(pub(super) Arc<Mutex<Pipe>>);

impl Parent {
    /// Takes the stream that the parent writes, and the one that it reads.
    pub fn new(input: impl Read + Send + 'static, output: impl Write + Send + 'static) -> Self {
        let mut pipe = Pipe::new(input, output, MOST_UNASKED);
        pipe.is_parent = true;
        Self(Arc::new(Mutex::new(pipe)))
    }

    /// Takes our own standard input and output.
    pub fn stdio() -> Self {
        Self::new(io::stdin(), io::stdout())
    }

    /// Waits for the next frame that nobody has asked for; `None` at the end of the stream.
    ///
    /// # Errors
    /// If the stream contains something other than frames.
    pub fn receive(&self) -> io::Result<Option<Vec<u8>>> {
        match &mut self.0.lock().streams {
            Streams::Direct { input, .. } => read_frame(input, || MOST_UNASKED),
            Streams::Threads { incoming, .. } => match incoming.recv() {
                Ok(Ok(frame)) => Ok(Some(frame)),
                Ok(Err(error)) if error.kind() != io::ErrorKind::UnexpectedEof => Err(error),
                Ok(Err(_)) | Err(_) => Ok(None),
            },
        }
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// If the stream is closed.
    pub fn send(&self, frame: Vec<u8>) -> io::Result<()> {
        let is_open = self.0.lock().send(frame);
        if is_open { Ok(()) } else { Err(io::ErrorKind::BrokenPipe.into()) }
    }
}

impl PartialEq for Parent {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Eq for Parent {}

impl fmt::Debug for Parent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Parent")
    }
}

/// Starts a thread that ends with its stream; a grandchild that keeps a stream open holds up nothing else.
pub(super) fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
    thread::Builder::new().name(format!("external {name}")).spawn(work).map(|_| ())
}

fn read_frames(mut from: impl Read, most: &AtomicU64, to: &SyncSender<io::Result<Vec<u8>>>) {
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

fn write_frames(mut to: impl Write, frames: &Receiver<Vec<u8>>, failed: &SyncSender<io::Result<Vec<u8>>>) {
    for frame in frames {
        if let Err(error) = to.write_all(&frame).and_then(|()| to.flush()) {
            failed.send(Err(io::Error::new(io::ErrorKind::BrokenPipe, error))).ok();
            return;
        }
    }
}
