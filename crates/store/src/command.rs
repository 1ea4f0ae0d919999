//! The command that starts the helper.

use std::env;
use std::io;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// Environment variable with another command.
const COMMAND: &str = "REACTSIM_STORE";
/// Program of the helper. Python looks for modules in the current folder first, where anybody's `http.py` may
/// be, so this folder is removed before the first import. Python 3.11 has the option `-P` for it.
const CODE: &str = "import sys; sys.path = [p for p in sys.path if p]; import reactsim.store as s; s.main()";

/// Command that starts the helper: a program and its arguments.
pub(super) struct HelperCommand {
    words: Vec<String>,
    /// Name in messages.
    pub(super) name: String,
}

impl HelperCommand {
    /// Returns the command of the environment variable, or the module of the Python package.
    pub(super) fn from_environment() -> Self {
        match env::var(COMMAND) {
            Ok(line) => Self::new(split(&line)),
            Err(_) => {
                let python = python();
                let name = format!("{python} -m reactsim.store");
                Self { words: vec![python, "-c".to_owned(), CODE.to_owned()], name }
            }
        }
    }

    pub(super) fn new(words: Vec<String>) -> Self {
        Self { name: words.join(" "), words }
    }
}

/// Starts the helper with pipes for its standard streams.
///
/// # Errors
/// Those of the system, and if there are no words.
pub(super) fn start(command: &HelperCommand) -> io::Result<Child> {
    let words = command.words.split_first();
    let (program, arguments) = words.ok_or_else(|| io::Error::other("it is empty"))?;
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    // A ^C at the terminal must not end the helper before the program has read what it still needs.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command.spawn()
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

    #[test]
    fn no_module_of_the_current_folder_is_imported() {
        let folder = tempfile::tempdir().unwrap();
        let trap = "open('TRAPPED', 'w').close()\n";
        std::fs::create_dir(folder.path().join("reactsim")).unwrap();
        for module in ["reactsim/__init__.py", "reactsim/store.py", "fsspec.py", "http.py", "numpy.py"] {
            std::fs::write(folder.path().join(module), trap).unwrap();
        }
        let run = |arguments: &[&str]| {
            let mut python = Command::new("python3");
            python.args(arguments).current_dir(&folder).stdin(Stdio::null());
            python.env("PYTHONPATH", concat!(env!("CARGO_MANIFEST_DIR"), "/../../python")).output().is_ok()
        };
        if !run(&["-c", CODE]) {
            return;
        }
        assert!(!folder.path().join("TRAPPED").exists());
        // The trap works: this is how Python starts a module.
        assert!(run(&["-m", "reactsim.store"]) && folder.path().join("TRAPPED").exists());
    }
}
