//! A child process with its own process group.

use std::io::{self, Write};
use std::process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

use parking_lot::Mutex;

/// Time between two looks whether a process has ended.
const POLL: Duration = Duration::from_millis(5);

/// Process ids of all children, so that none is left when the program ends at once.
static CHILDREN: Mutex<Vec<u32>> = Mutex::new(Vec::new());

/// When the program was interrupted.
static INTERRUPTED: OnceLock<Instant> = OnceLock::new();

/// Time that simulators have after an interrupt to answer what they were asked.
const TIME_AFTER_INTERRUPT: Duration = Duration::from_secs(1);

/// States that the program is to end soon: simulators that do not answer within a second are ended, and none
/// is started any more.
pub fn interrupt() {
    INTERRUPTED.get_or_init(Instant::now);
}

pub(super) fn is_interrupted() -> bool {
    INTERRUPTED.get().is_some()
}

/// Returns a limit of time, or what an interrupt leaves of it.
pub(super) fn time_left(limit: Duration) -> Duration {
    let left = |at: &Instant| TIME_AFTER_INTERRUPT.saturating_sub(at.elapsed());
    INTERRUPTED.get().map_or(limit, |at| limit.min(left(at)))
}

/// Ends all child processes. For the end of the program without unwinding.
pub fn end_all() {
    for id in CHILDREN.lock().iter() {
        kill_group(*id);
    }
}

/// A child that is ended with everything it started, at the latest when this is dropped.
pub(super) struct Process {
    child: Child,
    guard: Option<Guard>,
}

pub(super) struct Pipes {
    pub(super) stdin: ChildStdin,
    pub(super) stdout: ChildStdout,
    pub(super) stderr: ChildStderr,
}

impl Process {
    pub(super) fn start(line: &str) -> io::Result<(Self, Pipes)> {
        let mut command = shell(line);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Lets the Python client keep prints out of the protocol from its first import on.
        command.env("REACTSIM_EXTERNAL", super::PROTOCOL);
        // A group of its own: it can be ended with all its children, and a ^C at the terminal does not reach
        // it before the program has written what is finished.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let missing = || io::Error::other("a pipe of the child is missing");
        let pipes = match (child.stdin.take(), child.stdout.take(), child.stderr.take()) {
            (Some(stdin), Some(stdout), Some(stderr)) => Ok(Pipes { stdin, stdout, stderr }),
            _ => Err(missing()),
        };
        CHILDREN.lock().push(child.id());
        let guard = Guard::of(child.id());
        let process = Self { child, guard };
        Ok((process, pipes?))
    }

    pub(super) fn has_ended(&mut self) -> bool {
        has_ended(&mut self.child)
    }

    /// Waits for the end of the process; `None` if it does not end in time.
    pub(super) fn wait(&mut self, most: Duration) -> Option<ExitStatus> {
        let began = Instant::now();
        while !self.has_ended() {
            if began.elapsed() >= most {
                return None;
            }
            thread::sleep(POLL);
        }
        self.end()
    }

    /// Ends the process and its group. Returns how the process ended.
    pub(super) fn end(&mut self) -> Option<ExitStatus> {
        let id = self.child.id();
        let mut children = CHILDREN.lock();
        if let Some(at) = children.iter().position(|c| *c == id) {
            // The child is not reaped before, so the id still names its group.
            kill_group(id);
            self.child.kill().ok();
            self.guard.take().into_iter().for_each(Guard::dismiss);
            children.swap_remove(at);
        }
        drop(children);
        self.child.wait().ok()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}

/// A process that ends the group of a child if this program is killed, which closes the pipe to the guard.
struct Guard(Child);

impl Guard {
    /// Begins to guard a child. Without a guard, a child that does not read its input outlives a kill.
    #[cfg(unix)]
    fn of(child: u32) -> Option<Self> {
        let mut command = Command::new("sh");
        command.args(["-c", r#"read -r _ || kill -s KILL -- "-$1""#, "sh"]).arg(child.to_string());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        // Signals to the group of this program must not reach it.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        command.spawn().ok().map(Self)
    }

    #[cfg(not(unix))]
    fn of(_child: u32) -> Option<Self> {
        None
    }

    /// Ends the guard, before another process can get the id of the child.
    fn dismiss(mut self) {
        if let Some(mut stdin) = self.0.stdin.take() {
            stdin.write_all(b"\n").ok();
        }
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

#[cfg(unix)]
fn shell(line: &str) -> Command {
    let mut command = Command::new("sh");
    command.arg("-c").arg(line);
    command
}

#[cfg(not(unix))]
fn shell(line: &str) -> Command {
    let mut command = Command::new("cmd");
    command.arg("/C").arg(line);
    command
}

/// Returns whether the process has ended, without reaping it: until then its id names its group.
#[cfg(unix)]
fn has_ended(child: &mut Child) -> bool {
    use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    match Pid::from_raw(child.id().cast_signed()) {
        Some(id) => !matches!(waitid(WaitId::Pid(id), options), Ok(None)),
        None => true,
    }
}

#[cfg(not(unix))]
fn has_ended(child: &mut Child) -> bool {
    !matches!(child.try_wait(), Ok(None))
}

#[cfg(unix)]
fn kill_group(id: u32) {
    if let Some(group) = rustix::process::Pid::from_raw(id.cast_signed()) {
        // Nothing is left to end if the group is gone.
        rustix::process::kill_process_group(group, rustix::process::Signal::KILL).ok();
    }
}

#[cfg(not(unix))]
fn kill_group(_id: u32) {}

/// Returns how a process ended, for messages.
pub(super) fn describe(status: ExitStatus) -> String {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return format!("it was ended by signal {signal}");
    }
    match status.code() {
        Some(code) => format!("it ended with exit code {code}"),
        None => "it ended".to_owned(),
    }
}
