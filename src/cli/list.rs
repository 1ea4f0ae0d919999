//! `reactsim list`: models, metrics, formats and the like.

mod columns;
mod parameters;
mod scenarios;
mod tasks;

use clap::{Args, Subcommand};

use self::columns::{aligned, wrapped};
use super::output::{ExitStatus, write_result};
use crate::evaluation::CASE_STUDIES;
use crate::evaluation::ScenarioSpec;
use crate::formats::FORMATS;
use crate::generation::maps;
use crate::metrics::{METRICS, OptionDescription, Options, Unit};
use crate::models::nn::{Backend, check_backend};
use crate::models::{Card, MODELS, weights};

/// Arguments of `list`.
#[derive(Debug, Args)]
#[command(disable_help_subcommand = true)]
pub(super) struct ListArgs {
    #[command(subcommand)]
    what: Kind,
}

/// Kind of item to list.
#[derive(Debug, Subcommand)]
enum Kind {
    /// The simulators that ship with the program
    Models,
    /// The parameters of a simulator, which --set changes: value, unit and range
    Parameters {
        /// Simulator, or `qp` for the stage that can follow one, whose parameters are fixed
        model: String,
    },
    /// The metrics
    Metrics,
    /// The variants of the metrics, which --metric-option selects
    MetricOptions,
    /// The scenarios of files: id, source, number of agents with the AV, category and difficulty of the
    /// deviated AV
    Scenarios(Box<ScenarioSpec>),
    /// The scenario formats that can be read
    Formats,
    /// The weights of learned models
    Weights,
    /// The map types that can be generated
    Maps,
    /// The case studies of the shipped benchmark
    Cases,
    /// The training tasks, with their recipes and the files that they can be given
    Tasks,
    /// The tensor backends that this program contains, and whether they work on this machine
    Backends,
}

/// Summary of mixed traffic.
const MIX: &str = "Mixed traffic: each agent is drawn to one of several of these simulators, such as \
                   mix:idm=0.5+ntp-guarded=0.5+pedestrian=constant-velocity. Runs by its id.";

pub(super) fn list(args: &ListArgs) -> anyhow::Result<ExitStatus> {
    let mut failed = 0;
    let rows = match &args.what {
        Kind::Parameters { model } => parameters::rows(model)?,
        Kind::Scenarios(args) => {
            let (rows, count) = scenarios::rows(args)?;
            failed = count;
            rows
        }
        Kind::Tasks => tasks::rows(),
        Kind::MetricOptions => {
            let headings = ["option", "default", "values", "description"].map(str::to_owned).to_vec();
            let row = |option: OptionDescription| {
                vec![option.name.to_owned(), option.default, option.values, option.about.to_owned()]
            };
            std::iter::once(headings).chain(Options::descriptions().into_iter().map(row)).collect()
        }
        Kind::Models => {
            let mut rows = Vec::new();
            for model in MODELS {
                let card = Card::read(model.id, model.card)?;
                let mark = if model.oracle { " †" } else { "" };
                let needs = if model.is_complete() { "" } else { " Needs --model-weights." };
                let named = if model.by_default { "" } else { " Runs by its id or --models all." };
                let summary = format!("{}{needs}{named}", card.summary);
                rows.push(vec![model.id.to_owned(), format!("{}{mark}", card.title), summary]);
            }
            rows.push(["mix:ID=SHARE+…", "Mix", MIX].map(str::to_owned).to_vec());
            rows
        }
        Kind::Metrics => METRICS
            .iter()
            .map(|m| {
                let spec = m.spec();
                let unit = match spec.unit {
                    Unit::Plain => "-",
                    unit => unit.name(),
                };
                let better = if spec.lower_is_better { "lower" } else { "higher" };
                [spec.id, spec.title, unit, better, spec.source].map(str::to_owned).to_vec()
            })
            .collect(),
        Kind::Formats => FORMATS.iter().map(|f| vec![f.id().to_owned(), f.title().to_owned()]).collect(),
        Kind::Weights => weights::manifest()?
            .into_iter()
            .map(|row| {
                let is_embedded = weights::embedded().any(|(name, _)| *name == row.file);
                let whence = if is_embedded { "shipped" } else { "to be given" };
                let bytes = format!("{} bytes", row.bytes);
                vec![row.id, row.file, bytes, row.licence, whence.to_owned(), row.sha256, row.title]
            })
            .collect(),
        Kind::Cases => {
            CASE_STUDIES.iter().map(|c| [c.name, c.scenario, c.summary].map(str::to_owned).to_vec()).collect()
        }
        Kind::Backends => Backend::ALL
            .iter()
            .map(|backend| {
                let state = check_backend(*backend).map_or_else(|e| e.to_string(), |()| "works".to_owned());
                vec![backend.name().to_owned(), state]
            })
            .collect(),
        Kind::Maps => maps::all().map(|m| vec![m.id.to_owned(), m.title.to_owned()]).collect(),
    };
    write_result(None, |out| match &args.what {
        Kind::Parameters { .. } | Kind::Tasks | Kind::MetricOptions => wrapped(&rows, out),
        _ => aligned(&rows, out),
    })?;
    Ok(if failed > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done })
}
