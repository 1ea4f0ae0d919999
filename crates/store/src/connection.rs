//! A running helper. Threads share it: requests have numbers, and answers come in any order.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, BufRead, BufReader, Write};
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

use super::answer::{self, Answer, GREETING};
use super::command::{self, HelperCommand};

/// Number of requests without an answer, one after the other, after which a helper is ended.
const MAX_LATE: u32 = 3;
/// Number of lines of standard error that messages repeat.
const LAST_LINES: usize = 6;
/// Longest time that a message waits for the last lines of a helper that has ended.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// When the program was interrupted.
static INTERRUPTED: OnceLock<Instant> = OnceLock::new();
/// Time after an interrupt in which answers are still waited for.
const TIME_AFTER_INTERRUPT: Duration = Duration::from_secs(1);
/// Time between two looks whether the program was interrupted.
const LOOK_AGAIN: Duration = Duration::from_millis(200);

/// States that the program is to end soon: answers are waited for no longer than a second.
pub fn interrupt() {
    INTERRUPTED.get_or_init(Instant::now);
}

/// A running helper.
pub(super) struct Connection {
    stdin: Mutex<ChildStdin>,
    shared: Arc<Shared>,
    next: AtomicU64,
    /// Requests in a row that were not answered in time.
    late: AtomicU32,
}

/// Part of a connection that the thread with its answers needs.
struct Shared {
    child: Mutex<Child>,
    state: Mutex<State>,
    has_answered: AtomicBool,
}

#[derive(Default)]
struct State {
    waiting: BTreeMap<u64, Sender<Answer>>,
    /// Reason why there will be no further answer.
    end: Option<String>,
}

/// A request that is under way.
pub(super) struct Pending {
    answer: Receiver<Answer>,
    connection: Arc<Connection>,
}

impl Connection {
    /// Starts a helper and waits for its greeting.
    ///
    /// # Errors
    /// A text with the reason.
    pub(super) fn start(command: &HelperCommand, limit: Duration) -> Result<Arc<Self>, String> {
        let mut child = command::start(command).map_err(|error| error.to_string())?;
        let (Some(stdin), Some(stdout), Some(stderr)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            return Err("a pipe is missing".to_owned());
        };
        let shared = Arc::new(Shared {
            child: Mutex::new(child),
            state: Mutex::default(),
            has_answered: AtomicBool::new(false),
        });
        let (greet, greeting) = mpsc::channel();
        let reading = Arc::clone(&shared);
        let last_lines = last_lines(stderr);
        thread::spawn(move || reading.read(stdout, &greet, &last_lines));
        let connection = Arc::new(Self {
            stdin: Mutex::new(stdin),
            shared,
            next: AtomicU64::new(0),
            late: AtomicU32::new(0),
        });
        match receive(&greeting, limit) {
            Ok(()) => Ok(connection),
            Err(RecvTimeoutError::Timeout) if INTERRUPTED.get().is_some() => {
                connection.shared.end("interrupted".to_owned());
                Err("interrupted".to_owned())
            }
            Err(RecvTimeoutError::Timeout) => {
                let reason = format!("it did not begin within {} s", limit.as_secs());
                connection.shared.end(reason.clone());
                Err(reason)
            }
            Err(RecvTimeoutError::Disconnected) => Err(connection.end_reason().unwrap_or_default()),
        }
    }

    /// Returns why the helper has ended; `None` if it has not.
    pub(super) fn end_reason(&self) -> Option<String> {
        self.shared.state.lock().end.clone()
    }

    /// Returns whether any request was answered.
    pub(super) fn has_answered(&self) -> bool {
        self.shared.has_answered.load(Ordering::Relaxed)
    }

    /// Sends a request: its parts, without tabs and ends of lines.
    pub(super) fn send(self: &Arc<Self>, parts: &[&str]) -> Pending {
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        let (sender, answer) = mpsc::channel();
        let mut state = self.shared.state.lock();
        match &state.end {
            Some(reason) => drop(sender.send(Answer::Lost(reason.clone()))),
            None => drop(state.waiting.insert(id, sender)),
        }
        drop(state);
        let line = format!("{id}\t{}\n", parts.join("\t"));
        // If this fails the helper has ended, which the thread with its answers finds out too.
        self.stdin.lock().write_all(line.as_bytes()).ok();
        Pending { answer, connection: Arc::clone(self) }
    }

    fn late(&self, limit: Duration) {
        if self.late.fetch_add(1, Ordering::Relaxed) + 1 >= MAX_LATE {
            self.shared.end(format!("{MAX_LATE} requests were not answered within {} s", limit.as_secs()));
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.shared.end("it is no longer needed".to_owned());
    }
}

impl Pending {
    /// Waits for the answer.
    pub(super) fn wait(self, limit: Duration) -> Answer {
        match receive(&self.answer, limit) {
            Ok(answer) => {
                self.connection.late.store(0, Ordering::Relaxed);
                answer
            }
            Err(RecvTimeoutError::Timeout) if INTERRUPTED.get().is_some() => {
                Answer::Lost("interrupted".to_owned())
            }
            Err(RecvTimeoutError::Timeout) => {
                self.connection.late(limit);
                Answer::Late
            }
            Err(RecvTimeoutError::Disconnected) => {
                Answer::Lost(self.connection.end_reason().unwrap_or_default())
            }
        }
    }
}

/// Waits for something that is sent, no longer than this, and not long after an interrupt.
fn receive<T>(from: &Receiver<T>, limit: Duration) -> Result<T, RecvTimeoutError> {
    let start = Instant::now();
    loop {
        let left = limit.saturating_sub(start.elapsed());
        let after = |at: &Instant| left.min(TIME_AFTER_INTERRUPT.saturating_sub(at.elapsed()));
        let left = INTERRUPTED.get().map_or(left, after);
        match from.recv_timeout(left.min(LOOK_AGAIN)) {
            Err(RecvTimeoutError::Timeout) if left > LOOK_AGAIN => {}
            received => return received,
        }
    }
}

impl Shared {
    /// Passes answers to those who wait for them, until the helper ends.
    fn read(&self, stdout: ChildStdout, greet: &Sender<()>, last_lines: &Receiver<String>) {
        let mut stdout = BufReader::new(stdout);
        let mut reason = match answer::line(&mut stdout) {
            Ok(Some(line)) if line == GREETING => {
                greet.send(()).ok();
                self.pass_on(&mut stdout)
            }
            Ok(Some(line)) => format!("it begins with `{}`, not with `{GREETING}`", line.escape_debug()),
            Ok(None) => "it ended".to_owned(),
            Err(text) => text,
        };
        self.child.lock().kill().ok();
        if let Ok(lines) = last_lines.recv_timeout(LAST_WORDS)
            && !lines.is_empty()
        {
            reason = format!("{reason} ({lines})");
        }
        self.end(reason);
    }

    /// Returns why there is no further answer.
    fn pass_on(&self, stdout: &mut impl BufRead) -> String {
        loop {
            match answer::read(stdout) {
                Ok(Some((id, answer))) => {
                    self.has_answered.store(true, Ordering::Relaxed);
                    // Nobody waits for blocks that were read ahead of a file that is closed.
                    if let Some(waiting) = self.state.lock().waiting.remove(&id) {
                        waiting.send(answer).ok();
                    }
                }
                Ok(None) => return "it ended".to_owned(),
                Err(text) => return text,
            }
        }
    }

    /// Ends the helper, and everybody's waiting for it. The first reason counts.
    fn end(&self, reason: String) {
        let mut state = self.state.lock();
        let waiting = std::mem::take(&mut state.waiting);
        let reason = state.end.get_or_insert(reason).clone();
        drop(state);
        for sender in waiting.into_values() {
            sender.send(Answer::Lost(reason.clone())).ok();
        }
        let mut child = self.child.lock();
        child.kill().ok();
        child.wait().ok();
    }
}

/// Returns a receiver of the last lines of a stream, which come when it ends. The stream is always read, so
/// that the helper cannot block on it.
fn last_lines(stderr: ChildStderr) -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        let mut last: VecDeque<String> = VecDeque::new();
        for line in BufReader::new(stderr).split(b'\n').map_while(io::Result::ok) {
            let line = String::from_utf8_lossy(&line).trim().chars().take(300).collect::<String>();
            if !line.is_empty() {
                last.push_back(line);
            }
            if last.len() > LAST_LINES {
                last.pop_front();
            }
        }
        sender.send(Vec::from(last).join(" | ")).ok();
    });
    receiver
}
