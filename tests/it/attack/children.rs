//! Children that are silent, and programs that are interrupted or killed meanwhile.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use reactsim::external::Command as Shell;

use crate::external;
use crate::program::{program, stderr};

/// Longest time until a program has ended after a signal. It is to be 2 s; a loaded machine takes longer.
const SOON: Duration = Duration::from_secs(6);

fn run(external: &str, out: &Path) -> Child {
    let mut command = program();
    command.args(["run", "--limit", "2", "--models", "stop", "--jobs", "1", "--batch", "1", "--external"]);
    command.arg(format!("mine={external}")).arg("--out").arg(out);
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn signal(child: &Child, name: &str) {
    Command::new("kill").args([name, &child.id().to_string()]).status().unwrap();
}

fn wait_until(what: &str, limit: Duration, is_so: impl Fn() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < limit, "{what}");
        sleep(Duration::from_millis(10));
    }
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "looks for processes in /proc")]
fn one_interrupt_ends_a_run_with_a_silent_child() {
    let Some(child) = external::Child::new() else { return };
    for (name, fault) in
        [("-TERM", "hang plan 0"), ("-INT", "ignore-signals plan 2"), ("-TERM", "hang hello 0")]
    {
        let out = child.path("run");
        let mark = child.path(&format!("asked{}", fault.replace(' ', "-")));
        let fault = format!("{fault} once:{}", mark.display());
        let Shell::Shell(line) = child.command(&fault) else { unreachable!() };
        let running = run(&line, &out);
        wait_until("the child was not asked", Duration::from_secs(60), || mark.exists());
        let start = Instant::now();
        signal(&running, name);
        let output = running.wait_with_output().unwrap();
        let said = stderr(&output);
        assert!(start.elapsed() < SOON, "{fault}: {:?}", start.elapsed());
        assert_eq!(output.status.code(), Some(130), "{fault}: {said}");
        assert_eq!(child.left_over(), 0, "{fault}");
        if fault.contains("plan") {
            assert!(said.contains("to continue, repeat the command with --resume"), "{said}");
            assert!(!said.contains("failed"), "{fault}: an interrupt is no failure: {said}");
            assert_eq!(fs::read_to_string(out.join("failures.jsonl")).unwrap(), "");
            let rows = fs::read_to_string(out.join("rows.jsonl")).unwrap();
            assert!(rows.contains("\"simulator\":\"stop\""), "{fault}: rows are kept");
            fs::remove_dir_all(out).unwrap();
        }
    }
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "looks for processes in /proc")]
fn children_and_grandchildren_end_when_the_program_is_killed() {
    let home = tempfile::tempdir().unwrap();
    let mark = format!("600.{:09}", std::process::id());
    // Neither reads its input, whose end would tell of the kill.
    let line = format!("sleep {mark} & sleep {mark}");
    let mut running = run(&line, &home.path().join("run"));
    let left = || external::processes(&format!("sleep\0{mark}"));
    wait_until("no child was started", Duration::from_secs(60), || left() > 0);
    running.kill().unwrap();
    running.wait().unwrap();
    wait_until("children are left", SOON, || left() == 0);
}
