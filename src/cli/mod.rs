//! The command line: arguments, progress, exit codes. One file per subcommand. The only module that
//! prints.

mod also;
mod arguments;
mod certified;
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
mod inspect;
mod leaderboard;
mod list;
mod live_table;
mod log_sources;
mod merge;
mod partition;
mod progress;
mod reference;
mod report;
mod run;
mod scenario_args;
mod score;
mod session;
mod shell;
mod study;
mod subject;
mod suggestion;
mod table_output;
mod train;
mod urls;
mod verify;
mod view;

use std::env;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, anyhow};
use clap::error::ErrorKind;
use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};

use self::suggestion::{did_you_mean, most_similar, question};
use crate::evaluation::{EvaluationError, ReadingSpec};
use crate::files::{self, FolderLock};
use crate::formats::{Input, PassedOver};
use crate::metrics::{OptionError, Options};
use crate::models::{self, MODELS, ModelError};
use crate::report::terminal::plain;
use crate::training::TrainingError;

/// Largest width of help, columns.
const HELP_WIDTH: usize = 98;

/// Do simulated agents respond feasibly when the autonomous vehicle (AV) leaves the log?
#[derive(Debug, Parser)]
#[command(name = "reactsim", version, max_term_width = HELP_WIDTH, after_help = AFTER)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Print results, warnings and errors only: no progress and no hints
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Also print how plans ended, which run folders contain in any case
    #[arg(long, short, global = true, conflicts_with = "quiet")]
    verbose: bool,
}

/// Whether only results, warnings and errors are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Whether details are printed that run folders contain.
static VERBOSE: AtomicBool = AtomicBool::new(false);

fn is_verbose() -> bool {
    VERBOSE.load(Ordering::Relaxed)
}

/// Whether the user has interrupted the program.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

fn is_interrupted() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

const AFTER: &str = "\
Exit codes: 0 done; 1 done, but some scenarios failed; 2 wrong input or settings; 130 interrupted.

Without arguments, the program runs the default baselines on the shipped scenarios.";

/// Commands of the program, in the order of [`help::TASKS`].
#[derive(Debug, Subcommand)]
enum Command {
    /// List models, parameters, metrics, formats, weights, maps, cases or backends
    List(list::ListArgs),
    /// Describe and draw a scenario
    Inspect(inspect::InspectArgs),
    /// Show run folders in a browser: tables, figures, every scene from above
    View(view::ViewArgs),
    /// Print the tables of finished runs, or write them as an HTML page
    Report(report::ReportArgs),
    /// Compare two runs on the same scenarios, scenario by scenario
    Compare(compare::CompareArgs),
    /// Run simulators on scenarios and print the table of their metrics
    Run(run::RunArgs),
    /// Run studies: replan interval, reactive against realism protocol, ablations
    Study(study::StudyArgs),
    /// Score rollouts that any program produced
    Score(score::ScoreArgs),
    /// Answer requests of the Python package over standard input and output
    Session(session::SessionArgs),
    /// Create AV trajectories that leave the log (deviated AVs), review and analyse them
    Curate(curate::CurateArgs),
    /// Generate scenarios: maps, traffic and, for benchmarks, deviated AVs
    Generate(generate::GenerateArgs),
    /// Convert scenarios of any format to native Parquet
    Convert(convert::ConvertArgs),
    /// Read the deviated AVs of other data sets
    Import(import::ImportArgs),
    /// Write deviated AVs, scenarios or runs for other programs
    Export(export::ExportArgs),
    /// Train networks, build vocabularies and intention points
    Train(train::TrainArgs),
    /// Check that this program reproduces the numbers of a reference
    Verify(verify::VerifyArgs),
    /// Create references, and write their tables into documents
    Reference(reference::ReferenceArgs),
    /// List references and submitted runs in one table
    Leaderboard(leaderboard::LeaderboardArgs),
    /// Join the partitions of a command into the output of the whole
    Merge(merge::MergeArgs),
    /// Print a completion script for a shell
    Completions(shell::CompletionsArgs),
    /// Write manual pages
    Man(shell::ManArgs),
}

/// Outcome of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ExitStatus {
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
    QUIET.store(quiet, Ordering::Relaxed);
    VERBOSE.store(verbose, Ordering::Relaxed);
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
        Command::Run(args) => run::run(args),
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
        Command::Merge(args) => merge::merge(args),
        Command::Completions(args) => shell::completions(&args),
        Command::Man(args) => shell::man(&args),
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

/// Returns the definition of all arguments.
fn command_line() -> clap::Command {
    let command = with_negative_numbers(Cli::command());
    let template = help::template(&command);
    command.help_template(template)
}

fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|arg| {
        let is_option = !arg.is_positional() && arg.get_action().takes_values();
        arg.allow_negative_numbers(is_option)
    });
    command.mut_subcommands(with_negative_numbers)
}

/// Suggests what to try next, if the error's own text does not.
fn hint(error: &anyhow::Error) -> Option<String> {
    if let Some(TrainingError::Write { source, .. }) = error.downcast_ref() {
        let full = source.kind() == io::ErrorKind::StorageFull;
        return full.then(|| "the last checkpoint is intact; free some space and give --resume".to_owned());
    }
    match error.downcast_ref::<EvaluationError>()? {
        EvaluationError::UnknownSimulator { id, .. } | EvaluationError::UnknownMember { id, .. } => {
            let meant = question(most_similar(id, MODELS.iter().map(|m| m.id)));
            Some(format!("{meant}`reactsim list models` describes each of them"))
        }
        EvaluationError::Model(ModelError::UnknownParameter { id, key, .. }) => {
            let setup = models::find(id)?.setup().ok()?;
            let meant = most_similar(key, setup.ranges().ok()?.into_iter().map(|(key, _, _)| key));
            let meant = question(meant.map(|meant| format!("{id}.{meant}")));
            Some(format!("{meant}`reactsim list parameters {id}` shows all"))
        }
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

/// Writes a result to a file, which keeps its old content unless all of the new one is written, or to stdout.
/// A closed stdout (broken pipe) is not an error.
fn write_result(
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

/// Whether a warning was printed.
static WARNED: AtomicBool = AtomicBool::new(false);

/// Prints a message to stderr; stdout holds only results.
fn say(text: std::fmt::Arguments<'_>) {
    let text = text.to_string();
    WARNED.fetch_or(text.starts_with("warning:"), Ordering::Relaxed);
    // A closed stderr is not an error.
    writeln!(io::stderr().lock(), "{}", plain(&text)).ok();
}

/// Returns the error of a command that found nothing to work on; its reasons are the warnings, if there are
/// some.
fn nothing(outcome: &str) -> anyhow::Error {
    match WARNED.load(Ordering::Relaxed) {
        true => anyhow!("{outcome}: see the warnings above"),
        false => {
            anyhow!("{outcome}: none is selected; check the files, and the options that select scenarios")
        }
    }
}

/// Creates a folder, if it is absent, and locks it: no other process writes it until the lock is dropped.
fn lock_folder(path: &Path) -> anyhow::Result<FolderLock> {
    let locked = files::create_folder(path).and_then(|()| files::lock_folder(path));
    let locked = locked.with_context(|| format!("could not write {}", path.display()))?;
    Ok(locked.ok_or_else(|| EvaluationError::Busy { path: path.to_owned() })?)
}

/// Says where an interrupted command left the part of a file that is finished, and what is at `out`.
fn say_part(part: &[PathBuf], out: &Path, holds: &str) {
    let part: Vec<String> = part.iter().map(|path| path.display().to_string()).collect();
    let (part, out_is) = (part.join(" and "), if out.exists() { "is unchanged" } else { "was not written" });
    say(format_args!("interrupted: {part} has the first {holds}; {} {out_is}", out.display()));
}

/// Prints what may be of use to a person, unless only results are wanted.
fn note(text: std::fmt::Arguments<'_>) {
    if !is_quiet() && io::stderr().is_terminal() {
        say(text);
    }
}

/// Returns a flag that the first ^C (or SIGTERM) sets, with a message on what happens `then`. The
/// second one ends the program at once.
fn stop_on_interrupt(then: &'static str) -> anyhow::Result<Arc<AtomicBool>> {
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
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-+/".contains(c);
    if word.chars().all(plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

/// Returns a count with its noun in singular or plural.
fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Returns whether two paths lead to the same existing file.
fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Finds the scenario files at all paths and recognises their formats. Warns of files that have the
/// name of a scenario file only.
fn find_inputs(paths: &[PathBuf]) -> anyhow::Result<Vec<Input>> {
    inputs_of(&ReadingSpec::default(), paths)
}

/// Warns of files that have the name of a scenario file only.
fn warn_passed_over(files: PassedOver) {
    for (file, reason) in files {
        say(format_args!("warning: {} is skipped: {reason}", file.display()));
    }
}

/// Finds inputs as [`find_inputs`], and sets how they are read.
fn inputs_of(reading: &ReadingSpec, paths: &[PathBuf]) -> anyhow::Result<Vec<Input>> {
    let (inputs, passed_over) = reading.find_inputs(paths)?;
    warn_passed_over(passed_over);
    Ok(inputs)
}

/// Parses the requested variants of the metrics.
fn metric_options(requested: &[String]) -> anyhow::Result<Options> {
    let mut options = Options::default();
    for option in requested {
        let (name, value) = split_option(option)?;
        options.set(name, value).map_err(|error| match error {
            OptionError::Unknown { .. } => {
                let known = Options::descriptions().into_iter().map(|option| option.name);
                anyhow!("{error}{}", did_you_mean(name, known))
            }
            other => other.into(),
        })?;
    }
    Ok(options)
}

/// Splits a metric option into name and value.
fn split_option(option: &str) -> anyhow::Result<(&str, &str)> {
    let wrong = || anyhow!("`{option}` is not a metric option: write name=value, such as fault_order=nuplan");
    option.split_once('=').ok_or_else(wrong)
}
