//! The command that starts the helper.

use std::env;
use std::io;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// Environment variable with another command.
const COMMAND: &str = "REACTSIM_STORE";
/// Module of the helper.
const MODULE: &str = "reactsim.store";

/// Starts the helper, a program and its arguments, with pipes for its standard streams.
///
/// # Errors
/// Those of the system, and if there are no words.
pub(super) fn start(words: &[String]) -> io::Result<Child> {
    let (program, arguments) = words.split_first().ok_or_else(|| io::Error::other("it is empty"))?;
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    // A ^C at the terminal must not end the helper before the program has read what it still needs.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command.spawn()
}

/// Returns the command as its words.
pub(super) fn words() -> Vec<String> {
    match env::var(COMMAND) {
        Ok(line) => split(&line),
        Err(_) => vec![python(), "-m".to_owned(), MODULE.to_owned()],
    }
}

/// Returns the interpreter next to this program, as in an installed package, or else the one in PATH.
fn python() -> String {
    let name = if cfg!(windows) { "python.exe" } else { "python3" };
    let folder = env::current_exe().ok().and_then(|path| Some(path.parent()?.to_owned()));
    let beside: Option<PathBuf> = folder.map(|folder| folder.join(name)).filter(|path| path.is_file());
    beside.map_or_else(|| name.to_owned(), |path| path.to_string_lossy().into_owned())
}

/// Splits a command line at spaces. Quotation marks of both kinds protect spaces.
fn split(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in line.chars() {
        match quote {
            Some(mark) if c == mark => quote = None,
            None if c == '\'' || c == '"' => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            None if c.is_whitespace() => words.extend(word.take()),
            _ => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotation_marks_protect_spaces() {
        assert_eq!(split("  a 'b c'  \"d'e\"f '' "), ["a", "b c", "d'ef", ""]);
        assert_eq!(split(r"C:\a\python.exe x"), [r"C:\a\python.exe", "x"]);
        assert!(split(" ").is_empty());
    }
}
