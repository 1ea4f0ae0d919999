//! A call of the program with limits of time and memory.

use std::fs::{self, File};
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Longest duration of a call.
const LIMIT: Duration = Duration::from_secs(120);
/// Largest address space of a call, KiB.
const MEMORY: u32 = 8 << 20;

pub(crate) struct Answer {
    /// Exit code; `None` if the program was ended by a signal or after the limit of time.
    pub(crate) code: Option<i32>,
    pub(crate) output: String,
    pub(crate) error: String,
}

/// Calls the program within the limits; its output goes through files in `folder`.
pub(crate) fn call(arguments: &[String], folder: &Path) -> Answer {
    let [output, error] = ["stdout", "stderr"].map(|name| folder.join(name));
    let mut child = Command::new("sh")
        .args(["-c", &format!("ulimit -v {MEMORY}; exec \"$@\""), "sh"])
        .arg(assert_cmd::cargo::cargo_bin!("reactsim"))
        .args(arguments)
        .stdout(File::create(&output).unwrap())
        .stderr(File::create(&error).unwrap())
        .stdin(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let code = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status.code();
        }
        if start.elapsed() > LIMIT {
            child.kill().unwrap();
            child.wait().unwrap();
            break None;
        }
        sleep(Duration::from_millis(2));
    };
    let text = |path| String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
    Answer { code, output: text(&output), error: text(&error) }
}
