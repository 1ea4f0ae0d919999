//! Requests to the helper: lists, sizes and blocks of files.

use std::collections::BTreeMap;
use std::env;
use std::io::{self, ErrorKind};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use parking_lot::Mutex;
use reactsim_files::{RemoteFile, Store};

use super::answer::{Answer, Failure};
use super::blocks::Blocks;
use super::command::HelperCommand;
use super::connection::{Connection, Pending};
use super::remote_file::BlockReader;

/// Time in seconds within which every answer must come.
const LIMIT: u64 = 120;
/// Environment variable with another time in seconds.
const LIMIT_VARIABLE: &str = "REACTSIM_STORE_TIMEOUT";
/// Number of helpers in a row that end without an answer, after which no other is started.
const MAX_FRUITLESS: u32 = 3;
/// Number of attempts at a request if helpers end before they answer.
const ATTEMPTS: u32 = 2;

/// What is known of files behind URLs. There is one helper per program.
pub(crate) struct HelperStore {
    command: HelperCommand,
    helper: Mutex<Helper>,
    limit: Duration,
    files: Mutex<BTreeMap<String, FileInfo>>,
    /// URLs that could not be read. They are not tried again: several formats would, one after the other.
    failures: Mutex<BTreeMap<String, Failure>>,
    pub(super) blocks: Mutex<Blocks>,
}

#[derive(Default)]
struct Helper {
    connection: Option<Arc<Connection>>,
    /// Number of helpers in a row that ended without an answer.
    fruitless: u32,
    /// Reason why the last helper ended.
    last_reason: String,
}

/// Size and version of a file. The version changes with the content.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileInfo {
    /// Size, bytes.
    pub(super) size: u64,
    /// Tag of the content, or time of its last change; empty if neither is known.
    pub(super) version: String,
}

/// Range of a file.
#[derive(Clone, Copy)]
pub(super) struct Part {
    pub(super) start: u64,
    pub(super) length: u64,
    /// Whether the helper compares size and version of the file after reading.
    pub(super) is_checked: bool,
}

static STORE: LazyLock<HelperStore> = LazyLock::new(|| {
    let seconds = env::var(LIMIT_VARIABLE).ok().and_then(|text| text.parse().ok()).filter(|s| *s > 0);
    HelperStore::new(HelperCommand::from_environment(), Duration::from_secs(seconds.unwrap_or(LIMIT)))
});

impl HelperStore {
    /// Returns the store of this program.
    pub(crate) fn shared() -> &'static Self {
        &STORE
    }

    pub(super) fn new(command: HelperCommand, limit: Duration) -> Self {
        Self {
            command,
            helper: Mutex::default(),
            limit,
            files: Mutex::default(),
            failures: Mutex::default(),
            blocks: Mutex::default(),
        }
    }

    /// Returns size and version of a file, as they were found first.
    ///
    /// # Errors
    /// If there is no such file, or it cannot be read.
    pub(super) fn info(&self, url: &str) -> io::Result<FileInfo> {
        if let Some(known) = self.files.lock().get(url) {
            return Ok(known.clone());
        }
        let content = text(self.call(url, &["info", url])?)?;
        let (size, version) = content.split_once('\t').ok_or_else(strange)?;
        let info = FileInfo { size: size.parse().map_err(|_| strange())?, version: version.to_owned() };
        self.files.lock().insert(url.to_owned(), info.clone());
        Ok(info)
    }

    /// Reads a part of a file that has this size and version.
    ///
    /// # Errors
    /// If it cannot be read, or has another size or version.
    pub(super) fn read(&self, url: &str, info: &FileInfo, part: Part) -> io::Result<Vec<u8>> {
        let parts = read_request(url, info, part);
        let content = self.call(url, &parts.each_ref().map(String::as_str))?;
        self.check_length(url, part, content)
    }

    /// Begins to read a part of a file.
    pub(super) fn read_ahead(&self, url: &str, info: &FileInfo, part: Part) -> Option<Pending> {
        let connection = self.connection().ok()?;
        Some(connection.send(&read_request(url, info, part).each_ref().map(String::as_str)))
    }

    /// Waits for a part that was read ahead; reads it again if the helper ended meanwhile.
    ///
    /// # Errors
    /// Same as [`Self::read`].
    pub(super) fn finish(
        &self,
        url: &str,
        info: &FileInfo,
        part: Part,
        pending: Pending,
    ) -> io::Result<Vec<u8>> {
        match pending.wait(self.limit) {
            Answer::Lost(_) => self.read(url, info, part),
            answer => {
                let content = self.settle(url, answer)?;
                self.check_length(url, part, content)
            }
        }
    }

    fn check_length(&self, url: &str, part: Part, content: Vec<u8>) -> io::Result<Vec<u8>> {
        if content.len() as u64 == part.length {
            return Ok(content);
        }
        let text = format!(
            "the store gives {} of {} bytes from byte {} on; it was changed while it was read, or its server \
             is faulty: start again",
            content.len(),
            part.length,
            part.start
        );
        Err(self.remember(url, Failure { kind: ErrorKind::InvalidData, text }))
    }

    /// Sends a request and waits for its answer.
    fn call(&self, url: &str, parts: &[&str]) -> io::Result<Vec<u8>> {
        if url.contains(char::is_control) {
            return Err(io::Error::new(ErrorKind::InvalidInput, "URLs have no control characters"));
        }
        if let Some(failure) = self.failures.lock().get(url) {
            return Err(failure.clone().into());
        }
        let mut reason = String::new();
        for _ in 0..ATTEMPTS {
            match self.connection()?.send(parts).wait(self.limit) {
                Answer::Lost(why) => reason = why,
                answer => return self.settle(url, answer),
            }
        }
        let text = format!("{}: {reason}; start again, or copy the file to a file system", self.subject());
        Err(self.remember(url, Failure { kind: ErrorKind::BrokenPipe, text }))
    }

    /// Returns the content of an answer.
    fn settle(&self, url: &str, answer: Answer) -> io::Result<Vec<u8>> {
        let failure = match answer {
            Answer::Content(content) => return Ok(content),
            Answer::Failure(failure) => failure,
            Answer::Lost(text) => Failure { kind: ErrorKind::BrokenPipe, text },
            Answer::Late => {
                let text = format!(
                    "there was no answer within {} s; check the connection, or set {LIMIT_VARIABLE} to more \
                     seconds",
                    self.limit.as_secs()
                );
                Failure { kind: ErrorKind::TimedOut, text }
            }
        };
        Err(self.remember(url, failure))
    }

    fn remember(&self, url: &str, failure: Failure) -> io::Error {
        self.failures.lock().insert(url.to_owned(), failure.clone());
        failure.into()
    }

    /// Returns the name of the helper in messages.
    fn subject(&self) -> String {
        format!("the helper `{}`", self.command.name)
    }

    /// Returns the connection to the helper, which is started if there is none.
    fn connection(&self) -> io::Result<Arc<Connection>> {
        let mut helper = self.helper.lock();
        if let Some(connection) = helper.connection.take() {
            let Some(reason) = connection.end_reason() else {
                helper.connection = Some(Arc::clone(&connection));
                return Ok(connection);
            };
            helper.last_reason = reason;
            helper.fruitless = if connection.has_answered() { 0 } else { helper.fruitless + 1 };
        }
        if helper.fruitless < MAX_FRUITLESS {
            match Connection::start(&self.command, self.limit) {
                Ok(connection) => {
                    helper.connection = Some(Arc::clone(&connection));
                    return Ok(connection);
                }
                // A program that does not begin now will not begin later.
                Err(reason) => (helper.last_reason, helper.fruitless) = (reason, MAX_FRUITLESS),
            }
        }
        Err(io::Error::other(format!(
            "{} cannot be used: {}; URLs are read by Python: `pip install 'reactsim[store]'` in the Python \
             of this command, or set REACTSIM_STORE to a command such as `/path/to/python /path/to/reactsim/store.py`",
            self.subject(),
            helper.last_reason
        )))
    }
}

impl Store for HelperStore {
    fn open(&'static self, url: &str) -> io::Result<Box<dyn RemoteFile>> {
        Ok(Box::new(BlockReader::open(self, url)?))
    }

    fn list(&self, url: &str) -> io::Result<Vec<String>> {
        let content = text(self.call(url, &["list", url])?)?;
        let mut found = Vec::new();
        for line in content.lines() {
            let mut parts = line.splitn(3, '\t');
            let (Some(size), Some(version), Some(name)) = (parts.next(), parts.next(), parts.next()) else {
                return Err(strange());
            };
            let file = join(url, name);
            // Web servers state sizes one by one.
            if !size.is_empty() {
                let size = size.parse().map_err(|_| strange())?;
                let info = FileInfo { size, version: version.to_owned() };
                self.files.lock().insert(file.clone(), info);
            }
            found.push(file);
        }
        Ok(found)
    }
}

fn read_request(url: &str, info: &FileInfo, part: Part) -> [String; 6] {
    let (size, version) = match part.is_checked {
        true => (info.size.to_string(), info.version.clone()),
        false => (String::new(), String::new()),
    };
    ["read".to_owned(), url.to_owned(), part.start.to_string(), part.length.to_string(), size, version]
}

/// Returns the URL of a file below another one; without a name, the other one.
fn join(url: &str, name: &str) -> String {
    match name {
        "" => url.to_owned(),
        name => format!("{}/{name}", url.trim_end_matches('/')),
    }
}

fn text(content: Vec<u8>) -> io::Result<String> {
    String::from_utf8(content).map_err(|_| strange())
}

fn strange() -> io::Error {
    io::Error::other("the helper gives an answer of another kind; install it in the version of this program")
}
