//! The standard error of child processes.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Condvar, Mutex, MutexGuard};

/// Number of lines that messages repeat.
const LAST_LINES: usize = 24;

/// Text before the last lines of a process in messages.
pub(super) const LAST_WORDS_HEAD: &str = "; the end of its standard error:";

/// Length to which a line is cut in messages, bytes.
const LINE_LENGTH: usize = 400;

/// Bytes kept until a target is set; later ones are dropped.
const MOST_BUFFERED: usize = 1 << 20;

/// Bytes written to a file; later ones are dropped.
const MOST_WRITTEN: u64 = 64 << 20;

/// Longest time that a message waits for the last lines of a process that has ended; a grandchild may keep
/// the stream open.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Target of the standard error of child processes.
pub enum StderrTarget {
    /// Appended to this file.
    File(PathBuf),
    /// Passed to a function line by line.
    Lines(Box<dyn Fn(&str) + Send>),
}

/// Standard error of all processes of one simulator: the last lines for messages, everything for the target.
#[derive(Clone, Default)]
pub(super) struct Stderr(Arc<Mutex<State>>);

#[derive(Default)]
struct State {
    /// Bytes that came before the target was set.
    early: Vec<u8>,
    target: Option<Open>,
}

enum Open {
    File { file: File, written: u64 },
    Lines(Box<dyn Fn(&str) + Send>),
}

/// The last lines of one process.
#[derive(Clone, Default)]
pub(super) struct LastLines(Arc<(Mutex<LastLinesState>, Condvar)>);

#[derive(Default)]
struct LastLinesState {
    lines: VecDeque<String>,
    /// Whether more lines can come.
    is_open: bool,
}

impl LastLines {
    /// States that lines will come, until [`Stderr::drain`] meets the end of the stream.
    pub(super) fn open(&self) {
        self.lock().is_open = true;
    }

    /// Returns the lines of a process that has ended as a text to append to a message. What it wrote last may
    /// still be on its way.
    pub(super) fn text(&self) -> String {
        let (_, ended) = &*self.0;
        let mut state = self.lock();
        ended.wait_while_for(&mut state, |state| state.is_open, LAST_WORDS);
        let lines = &state.lines;
        if lines.is_empty() {
            return String::new();
        }
        let lines: Vec<String> = lines.iter().map(|line| format!("\n    {line}")).collect();
        format!("{LAST_WORDS_HEAD}{}", lines.concat())
    }

    fn push(&self, line: &[u8]) {
        let text = String::from_utf8_lossy(&line[..line.len().min(LINE_LENGTH)]);
        // Control characters would disturb the terminal.
        let text: String = text.chars().filter(|c| !c.is_control() || *c == '\t').collect();
        let lines = &mut self.lock().lines;
        if lines.len() == LAST_LINES {
            lines.pop_front();
        }
        lines.push_back(text);
    }

    fn end(&self) {
        self.lock().is_open = false;
        self.0.1.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, LastLinesState> {
        self.0.0.lock()
    }
}

impl Stderr {
    /// Sends everything, also what came before, to a target.
    pub(super) fn set_target(&self, target: StderrTarget) -> io::Result<()> {
        let open = match target {
            StderrTarget::File(path) => {
                let file = OpenOptions::new().create(true).append(true).open(path)?;
                Open::File { file, written: 0 }
            }
            StderrTarget::Lines(pass) => Open::Lines(pass),
        };
        let mut state = self.0.lock();
        state.target = Some(open);
        let early = std::mem::take(&mut state.early);
        early.split_inclusive(|b| *b == b'\n').for_each(|line| state.put(line));
        Ok(())
    }

    /// Reads a stream to its end. What is read is never kept back, so that the child cannot block on it.
    pub(super) fn drain(&self, mut from: impl Read, last: &LastLines) {
        let mut line: Vec<u8> = Vec::new();
        let mut buffer = [0; 8192];
        loop {
            let n = match from.read(&mut buffer) {
                Ok(0) => break,
                Ok(n) => n,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(_) => break,
            };
            for part in buffer[..n].split_inclusive(|b| *b == b'\n') {
                line.extend_from_slice(part);
                if part.ends_with(b"\n") || line.len() >= buffer.len() {
                    self.put(&line, last);
                    line.clear();
                }
            }
        }
        if !line.is_empty() {
            self.put(&line, last);
        }
        last.end();
    }

    /// Adds a text of this program to the log.
    pub(super) fn note(&self, text: &str) {
        text.lines().for_each(|line| self.store(format!("{line}\n").as_bytes()));
    }

    fn put(&self, line: &[u8], last: &LastLines) {
        last.push(line.strip_suffix(b"\n").unwrap_or(line));
        self.store(line);
    }

    fn store(&self, line: &[u8]) {
        let mut state = self.0.lock();
        match &state.target {
            Some(_) => state.put(line),
            None if state.early.len() < MOST_BUFFERED => state.early.extend_from_slice(line),
            None => {}
        }
    }
}

impl State {
    fn put(&mut self, line: &[u8]) {
        match &mut self.target {
            Some(Open::File { file, written }) if *written < MOST_WRITTEN => {
                *written += line.len() as u64;
                // A full disk loses the log of the child, not the run.
                file.write_all(line).ok();
                if *written >= MOST_WRITTEN {
                    file.write_all(b"\n[further output is not stored]\n").ok();
                }
            }
            Some(Open::Lines(pass)) => pass(String::from_utf8_lossy(line).trim_end()),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::thread;

    use super::*;

    #[test]
    fn the_last_lines_are_kept_and_all_lines_passed_on() {
        let (stderr, last) = (Stderr::default(), LastLines::default());
        assert_eq!(last.text(), "");
        stderr.drain("early\n".as_bytes(), &last);
        let (send, lines) = mpsc::channel();
        let pass = move |line: &str| send.send(line.to_owned()).unwrap();
        stderr.set_target(StderrTarget::Lines(Box::new(pass))).unwrap();
        let text: String = (0..40).map(|i| format!("line {i}\x1b\n")).collect();
        stderr.drain(text.as_bytes(), &last);
        stderr.drain(&[b'x'; 20_000][..], &last);
        let passed: Vec<String> = lines.try_iter().collect();
        assert_eq!((passed[0].as_str(), passed.len()), ("early", 44));
        let text = last.text();
        assert!(text.contains("\n    line 39\n") && !text.contains("line 2\n"), "{text}");
        assert!(!text.contains('\x1b') && text.len() < 2000, "{text}");
    }
    #[test]
    fn a_message_waits_for_the_last_lines() {
        let (stderr, last) = (Stderr::default(), LastLines::default());
        last.open();
        let (reader, mut writer) = std::io::pipe().unwrap();
        thread::scope(|scope| {
            scope.spawn(|| stderr.drain(reader, &last));
            let text = scope.spawn(|| last.text());
            thread::sleep(Duration::from_millis(20));
            writer.write_all(b"late\n").unwrap();
            drop(writer);
            assert!(text.join().unwrap().ends_with("\n    late"));
        });
    }

    #[test]
    fn a_stream_that_stays_open_holds_up_no_message() {
        let last = LastLines::default();
        last.open();
        assert_eq!(last.text(), "");
    }
}
