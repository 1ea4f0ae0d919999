//! The processes of a simulator or planner, handed out to threads.

use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use super::connection::{Connection, RequestError};
use super::document::FrameWriter;
use super::process::is_interrupted;
use super::replies::{Description, Role};
use super::settings::{ExternalSettings, RunOutline};
use super::stderr::{LAST_WORDS_HEAD, Stderr};

/// Number of failed starts in a row after which no further process is started.
const MOST_FAILED_STARTS: u32 = 3;

/// Number of episodes in a row that end their process or exceed a limit, each run singly, after which no
/// further process is started. Each can cost two limits of time.
const MOST_FAILED_EPISODES: usize = 3;

/// Starts of the reasons why a program that never serves has not greeted.
const NOT_SERVING: [&str; 4] = [
    "it ended with exit code 0",
    "no `welcome` within",
    "the output begins with the text",
    "the output ends inside the length of a frame",
];

/// Time in which a process must end after `bye`.
const TIME_TO_CLOSE: Duration = Duration::from_secs(5);

/// A connection and its state.
pub(super) struct Worker {
    pub(super) connection: Connection,
    /// Whether it has answered a plan: later answers have less time.
    pub(super) has_planned: bool,
    /// Handle of the next episode.
    next_episode: u64,
}

impl Worker {
    /// Returns handles for new episodes.
    pub(super) fn handles(&mut self, count: usize) -> Vec<u64> {
        let first = self.next_episode;
        self.next_episode += count as u64;
        (first..self.next_episode).collect()
    }
}

/// The workers of one simulator. Those that no thread uses wait here; a worker that broke is replaced when
/// the next batch begins.
pub(super) struct Workers {
    pub(super) settings: ExternalSettings,
    outline: RunOutline,
    role: Role,
    pub(super) stderr: Stderr,
    state: Mutex<State>,
    returned: Condvar,
}

#[derive(Default)]
struct State {
    /// Workers that are free; `None` is one that must be started.
    free: Vec<Option<Worker>>,
    /// Statement of the first process, with which all others must agree.
    description: Option<Description>,
    /// Number of workers that were started.
    started: usize,
    failed_starts: u32,
    /// Reason why no further process is started.
    given_up: Option<String>,
    /// Seeds of the latest episodes that ran singly and ended their process, without another one in between.
    failing: Vec<u64>,
    /// Number of batches that failed, and the reason of the first.
    faults: Option<(usize, String)>,
}

impl Workers {
    pub(super) fn new(settings: ExternalSettings, outline: RunOutline, role: Role) -> Self {
        let free = (0..settings.workers).map(|_| None).collect();
        let state = State { free, ..State::default() };
        let (stderr, returned) = (Stderr::default(), Condvar::new());
        Self { settings, outline, role, stderr, state: Mutex::new(state), returned }
    }

    /// Takes a free worker and starts it if it is not running. `waits`: whether to wait for one.
    pub(super) fn take(&self, waits: bool) -> Result<Worker, String> {
        let mut state = self.state.lock();
        loop {
            if is_interrupted() {
                return Err("interrupted".to_owned());
            }
            if let Some(reason) = &state.given_up {
                return Err(format!("it was given up: {reason}"));
            }
            // Running ones first.
            let running = state.free.iter().position(Option::is_some);
            if let Some(at) = running.or_else(|| (!state.free.is_empty()).then_some(0)) {
                let slot = state.free.swap_remove(at);
                drop(state);
                return match slot {
                    Some(worker) => Ok(worker),
                    None => self.start(),
                };
            }
            if !waits {
                let n = self.settings.workers;
                return Err(format!(
                    "episodes of several lengths that begin together, and those of a batch that continue when \
                     agents enter or leave, need processes of their own, and none of its {n} is free: run \
                     episodes singly"
                ));
            }
            self.returned.wait(&mut state);
        }
    }

    /// Returns whether the parent process answers, of which no new one can be started.
    pub(super) fn is_parent(&self) -> bool {
        self.settings.command.is_parent()
    }

    /// Takes a worker back; `None` if it broke.
    pub(super) fn put_back(&self, worker: Option<Worker>) {
        let mut state = self.state.lock();
        if worker.is_none() && self.is_parent() {
            state.given_up.get_or_insert_with(|| "the connection to the parent process broke".to_owned());
        }
        state.free.push(worker);
        drop(state);
        self.returned.notify_all();
    }

    /// Notes that a batch failed, in the log of the simulator as well. `seeds` are the seeds of its episodes;
    /// `is_broken`: whether its process is lost.
    pub(super) fn failed(&self, seeds: &[u64], reason: &str, is_broken: bool) {
        // Its standard error is in the log already.
        let own = reason.split(LAST_WORDS_HEAD).next().unwrap_or(reason);
        self.stderr.note(&format!("reactsim: a batch of {} failed: {own}", seeds.len()));
        // The end of the program is no fault of the simulator.
        if is_interrupted() {
            return;
        }
        let mut state = self.state.lock();
        state.faults.get_or_insert_with(|| (0, own.to_owned())).0 += 1;
        let [seed] = seeds else { return };
        // An episode that is tried again counts once.
        if is_broken && state.failing.last() != Some(seed) {
            state.failing.push(*seed);
        }
        if state.failing.len() >= MOST_FAILED_EPISODES {
            let n = MOST_FAILED_EPISODES;
            let text = format!(
                "{n} episodes in a row ended its process or had no answer in time, the last: {reason}"
            );
            state.given_up.get_or_insert(text);
        }
    }

    /// Notes that a batch came to its end.
    pub(super) fn succeeded(&self) {
        self.state.lock().failing.clear();
    }

    /// Returns the number of batches that failed, and the reason of the first; `None` if none did.
    pub(super) fn faults(&self) -> Option<(usize, String)> {
        self.state.lock().faults.clone()
    }

    /// Returns the reason why no further process is started; `None` if one is.
    pub(super) fn given_up(&self) -> Option<String> {
        self.state.lock().given_up.clone()
    }

    fn start(&self) -> Result<Worker, String> {
        let greeted = self.greet();
        let mut state = self.state.lock();
        let worker = greeted.and_then(|(connection, description)| {
            let first = state.description.get_or_insert_with(|| description.clone());
            if *first == description {
                Ok(Worker { connection, has_planned: false, next_episode: 0 })
            } else {
                Err(format!(
                    "a new process states {description:?}, the first one stated {first:?}; \
                     all must be the same"
                ))
            }
        });
        if let Err(reason) = &worker {
            state.failed_starts += 1;
            if state.failed_starts >= MOST_FAILED_STARTS || self.is_parent() {
                state.given_up = Some(reason.clone());
            }
            state.free.push(None);
            drop(state);
            self.returned.notify_all();
        } else {
            state.failed_starts = 0;
        }
        worker
    }

    /// Opens a connection and exchanges greetings.
    fn greet(&self) -> Result<(Connection, Description), String> {
        let Self { settings, outline, role, stderr, .. } = self;
        let number = {
            let mut state = self.state.lock();
            state.started += 1;
            state.started - 1
        };
        let opened = Connection::open(&settings.command, stderr, &settings.name, number);
        let mut connection = opened.map_err(|e| format!("`{}`: {e}", settings.command.text()))?;
        let mut hello = FrameWriter::new("hello");
        hello
            .text("program", format!("reactsim {}", env!("CARGO_PKG_VERSION")))
            .text("protocols", format!("[\"{}\"]", super::PROTOCOL))
            .text("role", role.name())
            .text("name", settings.name.clone())
            .text("replan_steps", format!("{:?}", outline.intervals))
            .text("protocol_name", format!("{:?}", outline.protocols))
            .text("reveals_ids", if settings.reveal_ids { "1" } else { "0" });
        let read = |connection: &mut Connection| {
            let welcome = connection.request(hello, "welcome", 0, settings.limits.start)?;
            let description =
                Description::read(&welcome).map_err(|e| RequestError::Refused(e.to_string()))?;
            if description.role != *role {
                let (found, wanted) = (description.role.name(), role.name());
                let text = format!("it states that it is a {found}, and is used as a {wanted}");
                return Err(RequestError::Refused(text));
            }
            Ok(description)
        };
        let is_silent = |text: &str| NOT_SERVING.iter().any(|start| text.starts_with(start));
        let description = read(&mut connection).map_err(|error| match error {
            RequestError::Broken(text) if is_silent(&text) => {
                format!("{text}\na program in Python must call `reactsim.serve` and print nothing before")
            }
            RequestError::Broken(text) => text,
            // Its process still runs, and its standard error may say more.
            RequestError::Refused(text) => format!("{text}{}", connection.last_lines()),
        })?;
        Ok((connection, description))
    }

    /// Returns the statement of the simulator, once it has started.
    pub(super) fn description(&self) -> Option<Description> {
        self.state.lock().description.clone()
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        let Self { settings, stderr, state, .. } = self;
        let state = state.get_mut();
        let mut open: Vec<_> = state.free.drain(..).flatten().map(|worker| worker.connection).collect();
        if settings.command.is_parent() {
            // The parent reads frames until `bye` of every worker, also of those that broke.
            let again = |number| Connection::open(&settings.command, stderr, &settings.name, number).ok();
            open = (0..state.started).filter_map(again).collect();
        }
        for connection in open {
            connection.close(TIME_TO_CLOSE);
        }
    }
}
