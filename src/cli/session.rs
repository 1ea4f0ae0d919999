//! `reactsim session`: answers requests of the Python package.

use std::io;

use super::ExitStatus;
use crate::environment::serve;

/// Answers requests until standard input ends.
pub(super) fn session() -> anyhow::Result<ExitStatus> {
    #[cfg(unix)]
    end_with_parent()?;
    serve(&mut io::stdin().lock(), &mut io::stdout().lock())?;
    Ok(ExitStatus::Done)
}

/// Ends this process soon after its parent. Standard input does not end then if a child of the parent has a
/// copy of its other end.
#[cfg(unix)]
fn end_with_parent() -> io::Result<()> {
    use rustix::process::getppid;
    use std::thread;
    use std::time::Duration;

    let parent = getppid();
    let watch = move || {
        while getppid() == parent {
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
