//! The command line: arguments, progress, exit codes. One file per subcommand. The only module that
//! prints.

mod arguments;
mod certified;
mod command_line;
mod compare;
mod convert;
mod curate;
mod export;
mod external;
mod finished;
mod futures;
mod gallery;
mod generate;
mod help;
mod import;
mod inputs;
mod inspect;
mod leaderboard;
mod list;
mod live_table;
mod merge;
mod output;
mod partition;
mod progress;
mod reference;
mod report;
mod run;
mod score;
mod session;
mod shell;
mod study;
mod subject;
mod table_output;
mod train;
mod urls;
mod verify;
mod view;

use std::env;
use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail};
use clap::error::ErrorKind;
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser};

use self::command_line::{Cli, Command, command_line};
use self::merge::MergeArgs;
use self::output::{ExitStatus, is_interrupted, say, set_verbosity};
use crate::evaluation::EvaluationError;
use crate::evaluation::suggestion::{most_similar, question};
use crate::metrics::{OptionError, Options};
use crate::models::{self, MODELS, ModelError};
use crate::report::terminal::plain;
use crate::training::TrainingError;

/// Runs the program: parses the arguments, runs the subcommand, prints errors.
pub fn main() -> ExitCode {
    crate::evaluation::set_program_commit(crate::COMMIT);
    if let Some(refusal) = too_little_memory() {
        say(format_args!("error: {refusal}"));
        return ExitStatus::BadInput.into();
    }
    survive_file_limits();
    // Without arguments: `run` with its defaults.
    let matches = parse();
    let Cli { command, quiet, verbose } =
        Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    set_verbosity(quiet, verbose);
    let command = command.unwrap_or_else(|| {
        let bare = Cli::parse_from(["reactsim", "run"]).command;
        bare.expect("`run` needs no arguments")
    });
    let result = arguments::check(&command_line(), &matches).and_then(|()| match command {
        Command::List(args) => list::list(&args),
        Command::Inspect(args) => inspect::inspect(&args),
        Command::View(args) => view::view(&args),
        Command::Report(args) => report::report(&args),
        Command::Compare(args) => compare::compare(&args),
        Command::Run(args) => run::run(*args),
        Command::Study(args) => study::study(&args),
        Command::Score(args) => score::score(&args),
        Command::Session(args) => session::session(&args),
        Command::Curate(args) => curate::curate(&args),
        Command::Generate(args) => generate::generate(&args),
        Command::Convert(args) => convert::convert(&args),
        Command::Import(args) => import::import(&args),
        Command::Export(args) => export::export(&args),
        Command::Train(args) => train::train(&args),
        Command::Verify(args) => verify::verify(&args),
        Command::Reference(args) => reference::reference(&args),
        Command::Leaderboard(args) => leaderboard::leaderboard(&args),
        Command::Merge(args) => merge_partitions(args),
        Command::Completions(args) => shell::completions(&args, command_line()),
        Command::Man(args) => shell::man(&args, command_line()),
    });
    match result {
        Ok(status) => status.into(),
        Err(error) => {
            let mut err = io::stderr().lock();
            let mut last = String::new();
            for (depth, cause) in error.chain().enumerate() {
                let text = cause.to_string();
                // Some errors already end with the text of their cause.
                if depth == 0 || !last.ends_with(&text) {
                    let label = if depth == 0 { "error" } else { "  cause" };
                    writeln!(err, "{label}: {}", plain(&text)).ok();
                }
                last = text;
            }
            if let Some(hint) = hint(&error) {
                writeln!(err, "hint: {}", plain(&hint)).ok();
            }
            // What the interrupt ended may be the reason.
            let status = if is_interrupted() { ExitStatus::Interrupted } else { ExitStatus::BadInput };
            status.into()
        }
    }
}

/// Joins the partitions of a command, whose arguments they state.
fn merge_partitions(args: MergeArgs) -> anyhow::Result<ExitStatus> {
    let partitions = args.open()?;
    let out = args.out;
    let arguments = std::iter::once("reactsim").chain(partitions.arguments().iter().map(String::as_str));
    let parsed = command_line()
        .try_get_matches_from(arguments)
        .and_then(|matches| Cli::from_arg_matches(&matches))
        .context("the arguments in partition.json are not those of this program")?;
    match parsed.command {
        Some(Command::Run(args)) => run::merge(*args, &partitions, out),
        Some(Command::Study(args)) => study::merge(&args, &partitions, &out),
        Some(Command::Curate(args)) => curate::merge(args, &partitions, out),
        Some(Command::Generate(args)) => generate::merge(args, &partitions, out),
        Some(Command::Score(args)) => score::merge(args, &partitions, out),
        _ => bail!("partition.json is damaged: it has another command"),
    }
}

/// Smallest limit of the address space with which anything can be done, MiB.
const MIN_ADDRESS_SPACE: u64 = 256;

/// Returns why the program would soon be ended by a failed allocation, if the limit of its address space is
/// very small.
fn too_little_memory() -> Option<String> {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, getrlimit};
        let limit = getrlimit(Resource::As).current? >> 20;
        let needed = MIN_ADDRESS_SPACE;
        (limit < needed).then(|| {
            format!("the address space is limited to {limit} MiB (`ulimit -v`); allow at least {needed}")
        })
    }
    #[cfg(not(unix))]
    None
}

/// Makes a write beyond the limit of the size of files (`ulimit -f`) an error instead of the end of the
/// program.
fn survive_file_limits() {
    #[cfg(unix)]
    {
        let passed = Arc::new(AtomicBool::new(false));
        // Without the handler, the signal ends the program as it did before.
        signal_hook::flag::register(signal_hook::consts::SIGXFSZ, passed).ok();
    }
}

/// Parses the arguments. Values may begin with a minus sign, so that a negative number is refused as a value
/// and not as an unknown option.
fn parse() -> ArgMatches {
    let matches = command_line().try_get_matches();
    let matches = matches.unwrap_or_else(|error| match error.kind() {
        ErrorKind::InvalidUtf8 => refuse_encoding(),
        _ => end(&error),
    });
    urls::check(&command_line(), &matches).unwrap_or_else(|error| error.exit());
    matches
}

/// Prints help, the version or a wrong argument, and ends the program.
fn end(error: &clap::Error) -> ! {
    let mut code = error.exit_code();
    match error.print().and_then(|()| io::stdout().flush()) {
        Err(failure) if !error.use_stderr() && failure.kind() != io::ErrorKind::BrokenPipe => {
            say(format_args!("error: could not write to stdout: {failure}"));
            code = 2;
        }
        _ => {}
    }
    #[expect(clippy::exit, reason = "nothing has begun")]
    std::process::exit(code)
}

/// Names the argument that is not text, which clap does not, and ends the program.
fn refuse_encoding() -> ! {
    let arguments: Vec<OsString> = env::args_os().collect();
    let bad = arguments.iter().position(|argument| argument.to_str().is_none()).unwrap_or(0);
    let option = arguments[..bad].last().filter(|last| last.as_encoded_bytes().starts_with(b"--"));
    let option = option.map(|option| format!(" of {}", option.display())).unwrap_or_default();
    let value = arguments[bad].display();
    let text = format!("the value `{value}`{option} is not UTF-8; give a name in UTF-8\n");
    Cli::command().error(ErrorKind::InvalidUtf8, text).exit()
}

/// Suggests what to try next, if the error's own text does not.
fn hint(error: &anyhow::Error) -> Option<String> {
    if let Some(TrainingError::Write { source, .. }) = error.downcast_ref() {
        let full = source.kind() == io::ErrorKind::StorageFull;
        return full.then(|| "the last checkpoint is intact; free some space and give --resume".to_owned());
    }
    match error.downcast_ref::<EvaluationError>()? {
        EvaluationError::UnknownSimulator { id, .. } => {
            let meant = question(most_similar(id, MODELS.iter().map(|m| m.id)));
            Some(format!("{meant}`reactsim list models` describes each of them"))
        }
        EvaluationError::Model(ModelError::UnknownParameter { id, key, .. }) => {
            let setup = models::find(id)?.setup().ok()?;
            let meant = most_similar(key, setup.parameters.ranges().ok()?.into_iter().map(|(key, _, _)| key));
            let meant = question(meant.map(|meant| format!("{id}.{meant}")));
            Some(format!("{meant}`reactsim list parameters {id}` shows all"))
        }
        EvaluationError::Option(OptionError::Unknown { name, .. }) => {
            let known = Options::descriptions().into_iter().map(|option| option.name);
            Some(format!("{}`reactsim list metric-options` shows all", question(most_similar(name, known))))
        }
        EvaluationError::Resumable(_) => Some("the same command with --resume continues the run".to_owned()),
        EvaluationError::WhichSimulator(_) => Some("--simulator ID chooses one".to_owned()),
        EvaluationError::NoRun { .. } => Some("`reactsim run --out FOLDER` writes a run folder".to_owned()),
        EvaluationError::Model(ModelError::OutOfRange { id, .. }) => {
            Some(format!("`reactsim list parameters {id}` shows the ranges of all parameters"))
        }
        EvaluationError::Write { source, .. } => match source.kind() {
            io::ErrorKind::StorageFull => {
                Some("finished rows are kept; free some space and give --resume".to_owned())
            }
            _ => None,
        },
        _ => None,
    }
}
