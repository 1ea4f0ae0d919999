//! What commands print, write and return.

use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, anyhow};

use crate::evaluation::EvaluationError;
use crate::files::{self, FolderLock};
use crate::report::terminal::plain;

/// Outcome of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ExitStatus {
    /// Everything was done.
    Done,
    /// Done, but some scenarios failed.
    SomeFailed,
    /// Wrong input or settings: no usable result.
    BadInput,
    /// Interrupted by the user.
    Interrupted,
}

impl From<ExitStatus> for ExitCode {
    fn from(status: ExitStatus) -> Self {
        Self::from(match status {
            ExitStatus::Done => 0,
            ExitStatus::SomeFailed => 1,
            ExitStatus::BadInput => 2,
            ExitStatus::Interrupted => 130,
        })
    }
}

/// Whether only results, warnings and errors are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Whether details are printed that run folders contain.
static VERBOSE: AtomicBool = AtomicBool::new(false);

/// Whether the user has interrupted the program.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Whether a warning was printed.
static WARNED: AtomicBool = AtomicBool::new(false);

/// Sets how much is printed.
pub(super) fn set_verbosity(quiet: bool, verbose: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
    VERBOSE.store(verbose, Ordering::Relaxed);
}

pub(super) fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

pub(super) fn is_verbose() -> bool {
    VERBOSE.load(Ordering::Relaxed)
}

pub(super) fn is_interrupted() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// Writes a result to a file, which keeps its old content unless all of the new one is written, or to stdout.
/// A closed stdout (broken pipe) is not an error.
pub(super) fn write_result(
    file: Option<&Path>,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> anyhow::Result<()> {
    if let Some(path) = file {
        return write_file(path, write).with_context(|| format!("could not write {}", path.display()));
    }
    let mut out = BufWriter::new(io::stdout().lock());
    match write(&mut out).and_then(|()| out.flush()) {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
            // Dropping the writer would try to write its buffer again.
            let _ = out.into_parts();
            Ok(())
        }
        done => done.context("could not write to stdout"),
    }
}

/// Writes a file as a whole, or not at all. Devices and pipes are written to directly.
fn write_file(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    if path.metadata().is_ok_and(|metadata| !metadata.is_file()) {
        let mut out = BufWriter::new(File::create(path)?);
        return write(&mut out).and_then(|()| out.flush());
    }
    files::replace(path, write)
}

/// Prints a message to stderr; stdout holds only results.
pub(super) fn say(text: std::fmt::Arguments<'_>) {
    let text = text.to_string();
    WARNED.fetch_or(text.starts_with("warning:"), Ordering::Relaxed);
    // A closed stderr is not an error.
    writeln!(io::stderr().lock(), "{}", plain(&text)).ok();
}

/// Returns the error of a command that found nothing to work on; its reasons are the warnings, if there are
/// some.
pub(super) fn nothing(outcome: &str) -> anyhow::Error {
    match WARNED.load(Ordering::Relaxed) {
        true => anyhow!("{outcome}: see the warnings above"),
        false => {
            anyhow!("{outcome}: none is selected; check the files, and the options that select scenarios")
        }
    }
}

/// Creates a folder, if it is absent, and locks it: no other process writes it until the lock is dropped.
pub(super) fn lock_folder(path: &Path) -> anyhow::Result<FolderLock> {
    let locked = files::create_folder(path).and_then(|()| files::lock_folder(path));
    let locked = locked.with_context(|| format!("could not write {}", path.display()))?;
    Ok(locked.ok_or_else(|| EvaluationError::busy(path))?)
}

/// Says where an interrupted command left the part of a file that is finished, and what is at `out`.
pub(super) fn say_part(part: &[PathBuf], out: &Path, holds: &str) {
    let part: Vec<String> = part.iter().map(|path| path.display().to_string()).collect();
    let (part, out_is) = (part.join(" and "), if out.exists() { "is unchanged" } else { "was not written" });
    say(format_args!("interrupted: {part} has the first {holds}; {} {out_is}", out.display()));
}

/// Prints what may be of use to a person, unless only results are wanted.
pub(super) fn note(text: std::fmt::Arguments<'_>) {
    if !is_quiet() && io::stderr().is_terminal() {
        say(text);
    }
}

/// Returns a flag that the first ^C (or SIGTERM) sets, with a message on what happens `then`. The
/// second one ends the program at once.
pub(super) fn stop_on_interrupt(then: &'static str) -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            crate::external::end_all();
            #[expect(clippy::exit, reason = "second interrupt by the user; files are replaced whole")]
            std::process::exit(130);
        }
        INTERRUPTED.store(true, Ordering::Relaxed);
        crate::external::interrupt();
        say(format_args!("\ninterrupted: {then}; interrupt again to end at once"));
    })
    .context("could not install the interrupt handler")?;
    Ok(stop)
}

/// Quotes a word for a shell, if necessary.
pub(super) fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-+/".contains(c);
    if word.chars().all(plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

/// Returns a count with its noun in singular or plural.
pub(super) fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Returns whether two paths lead to the same existing file.
pub(super) fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
