//! `reactsim session`: answers requests of the Python package.

use std::io;

use clap::Args;

use super::output::ExitStatus;
use crate::external::Parent;
use crate::session::serve;

#[derive(Debug, Args)]
pub(super) struct SessionArgs {
    /// Process whose end is the end of this one (Unix); the parent process by default
    ///
    /// A parent that names itself is noticed even if it ends before this process has started.
    #[arg(long, value_name = "PID", value_parser = clap::value_parser!(i32).range(1..))]
    parent: Option<i32>,
}

/// Answers requests until standard input ends.
pub(super) fn session(args: &SessionArgs) -> anyhow::Result<ExitStatus> {
    #[cfg(unix)]
    end_with(args.parent)?;
    serve(&Parent::stdio())?;
    Ok(ExitStatus::Done)
}

/// Ends this process soon after its parent, and after process `named`. Standard input does not end then if
/// a child of the parent has a copy of its other end.
#[cfg(unix)]
fn end_with(named: Option<i32>) -> io::Result<()> {
    use rustix::io::Errno;
    use rustix::process::{Pid, getppid, test_kill_process};
    use std::thread;
    use std::time::Duration;

    let parent = getppid();
    // The parent may have ended already, and another process may start this one for the process that is
    // named.
    let other = named.and_then(Pid::from_raw).filter(|&named| parent != Some(named));
    let watch = move || {
        while getppid() == parent && other.is_none_or(|other| test_kill_process(other) != Err(Errno::SRCH)) {
            thread::sleep(Duration::from_secs(1));
        }
        #[expect(
            clippy::exit,
            reason = "the answers have no reader any more, and no file is open for writing"
        )]
        std::process::exit(0);
    };
    thread::Builder::new().name("parent".to_owned()).spawn(watch).map(|_| ())
}
