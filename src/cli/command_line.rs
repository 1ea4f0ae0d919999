//! The definition of all arguments.

use clap::{CommandFactory, Parser, Subcommand};

use super::{
    compare, convert, curate, export, generate, help, import, inspect, leaderboard, list, merge, reference,
    report, run, score, session, shell, study, train, verify, view,
};

/// Largest width of help, columns.
pub(super) const HELP_WIDTH: usize = 98;

/// Do simulated agents respond feasibly when the autonomous vehicle (AV) leaves the log?
#[derive(Debug, Parser)]
#[command(name = "reactsim", version, max_term_width = HELP_WIDTH, after_help = AFTER)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Option<Command>,
    /// Print results, warnings and errors only: no progress and no hints
    #[arg(long, short, global = true)]
    pub(super) quiet: bool,
    /// Also print how plans ended, which run folders contain in any case
    #[arg(long, short, global = true, conflicts_with = "quiet")]
    pub(super) verbose: bool,
}

const AFTER: &str = "\
Exit codes: 0 done; 1 done, but some scenarios failed; 2 wrong input or settings; 130 interrupted.

Without arguments, the program runs the default baselines on the shipped scenarios.";

/// Commands of the program, in the order of [`help::TASKS`].
#[derive(Debug, Subcommand)]
pub(super) enum Command {
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
    Run(Box<run::RunArgs>),
    /// Run studies: any axes, replan interval, reactive against realism protocol, ablations
    Study(Box<study::StudyArgs>),
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

/// Returns the definition of all arguments.
pub(super) fn command_line() -> clap::Command {
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
