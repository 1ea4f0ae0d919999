//! Outcomes of records before the choice, in a folder: one process finds them, another one continues with
//! them.
//!
//! `outcomes.jsonl` has a line per record, `candidates.parquet` the candidates of the scenarios that passed
//! step 1, in the same order.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Lines, Write};
use std::path::{Path, PathBuf};

use reactsim_files::NewFile;
use reactsim_formats::{FormatError, error::Cause};
use reactsim_geometry::Vec2;
use serde::{Deserialize, Serialize};

use super::store::{Reader, Writer, read};
use super::{CurationOutcome, CurationProvenance, ScenarioRecord};

/// Name of the file with a line per record.
pub const OUTCOMES: &str = "outcomes.jsonl";
/// Name of the file with the candidates.
pub const CANDIDATES: &str = "candidates.parquet";

/// Indices of an input and of a record in it.
pub type Place = (usize, usize);

/// The outcome of a record.
#[derive(Clone, Debug, PartialEq)]
pub enum RecordOutcome {
    /// It has no result.
    Failed {
        /// The reason, with the name of the file.
        error: String,
        /// Id of the scenario, if it is known.
        scenario: Option<String>,
    },
    /// An earlier scenario in the same folder has its id.
    Repeated {
        /// The id.
        scenario: String,
    },
    /// It was curated up to the choice.
    Curated {
        /// Id of the scenario.
        scenario: String,
        /// Where the scenario comes from ([`Scenario::source`](reactsim_scene::Scenario)).
        source: String,
        /// The candidates, or the rule of step 1.
        outcome: CurationOutcome,
    },
}

/// A line of the file.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
enum OutcomeLine {
    Failed {
        error: String,
        scenario: Option<String>,
    },
    Repeated {
        scenario: String,
    },
    Rejected {
        scenario: String,
        source: String,
        rule: String,
    },
    /// Its record has no candidates, and thus no rows in the other file.
    Empty {
        scenario: String,
        source: String,
        digest: String,
        origin: [f64; 2],
        unproposed: BTreeMap<String, u64>,
    },
    Retained {
        source: String,
        unproposed: BTreeMap<String, u64>,
    },
}

/// Writes outcomes to a folder.
pub struct OutcomeWriter {
    path: PathBuf,
    lines: NewFile,
    candidates: Writer,
    ids: BTreeSet<String>,
}

impl OutcomeWriter {
    /// Begins the files in a folder.
    ///
    /// # Errors
    /// [`FormatError`] if they cannot be created.
    pub fn create(folder: &Path) -> Result<Self, FormatError> {
        let path = folder.join(OUTCOMES);
        let lines = NewFile::create(&path).map_err(write_error(&path))?;
        let candidates = Writer::create(folder.join(CANDIDATES))?;
        Ok(Self { path, lines, candidates, ids: BTreeSet::new() })
    }

    /// Adds the outcome of the next record, which has this place. Returns whether it failed.
    ///
    /// # Errors
    /// [`FormatError`] if the files cannot be written.
    pub fn write(&mut self, place: Place, outcome: RecordOutcome) -> Result<bool, FormatError> {
        let line = match outcome {
            RecordOutcome::Failed { error, scenario } => OutcomeLine::Failed { error, scenario },
            RecordOutcome::Repeated { scenario } => OutcomeLine::Repeated { scenario },
            RecordOutcome::Curated { scenario, source, outcome } => {
                if self.ids.insert(scenario.clone()) {
                    self.curated(scenario, source, outcome)?
                } else {
                    OutcomeLine::Repeated { scenario }
                }
            }
        };
        let failed = matches!(line, OutcomeLine::Failed { .. } | OutcomeLine::Repeated { .. });
        let written = serde_json::to_writer(&mut self.lines, &(place, line)).map_err(io::Error::from);
        written.and_then(|()| self.lines.write_all(b"\n")).map_err(write_error(&self.path))?;
        Ok(failed)
    }

    fn curated(
        &mut self,
        scenario: String,
        source: String,
        outcome: CurationOutcome,
    ) -> Result<OutcomeLine, FormatError> {
        Ok(match outcome {
            CurationOutcome::Rejected { rule } => OutcomeLine::Rejected { scenario, source, rule },
            CurationOutcome::Retained(record, unproposed) => match self.candidates.write(&record)? {
                true => OutcomeLine::Retained { source, unproposed },
                false => {
                    let (digest, origin) = (record.scenario_digest, [record.origin.x, record.origin.y]);
                    OutcomeLine::Empty { scenario, source, digest, origin, unproposed }
                }
            },
        })
    }

    /// Completes the files.
    ///
    /// # Errors
    /// [`FormatError`] if they cannot be written.
    pub fn finish(self) -> Result<(), FormatError> {
        self.lines.finish().map_err(write_error(&self.path))?;
        self.candidates.finish(&CurationProvenance::default())
    }
}

/// Iterator over the outcomes in a folder, in the order of the records.
pub struct OutcomeReader {
    path: PathBuf,
    lines: Lines<BufReader<File>>,
    next: u64,
    candidates: Reader,
}

impl OutcomeReader {
    /// Opens the files in a folder.
    ///
    /// # Errors
    /// [`FormatError`] if they cannot be read.
    pub fn open(folder: &Path) -> Result<Self, FormatError> {
        let path = folder.join(OUTCOMES);
        let file = File::open(&path).map_err(|e| FormatError::file(&path, Cause::read(e)))?;
        let candidates = read(folder.join(CANDIDATES))?;
        Ok(Self { path, lines: BufReader::new(file).lines(), next: 0, candidates })
    }

    fn outcome(&mut self, text: io::Result<String>) -> Result<(Place, RecordOutcome), Cause> {
        let text = text.map_err(Cause::read)?;
        let (place, line): (Place, OutcomeLine) =
            serde_json::from_str(&text).map_err(|error| Cause::Undecodable(error.to_string()))?;
        let outcome = match line {
            OutcomeLine::Failed { error, scenario } => RecordOutcome::Failed { error, scenario },
            OutcomeLine::Repeated { scenario } => RecordOutcome::Repeated { scenario },
            OutcomeLine::Rejected { scenario, source, rule } => {
                RecordOutcome::Curated { scenario, source, outcome: CurationOutcome::Rejected { rule } }
            }
            OutcomeLine::Empty { scenario, source, digest, origin: [x, y], unproposed } => {
                let record = ScenarioRecord {
                    scenario_id: scenario.clone(),
                    scenario_digest: digest,
                    origin: Vec2::new(x, y),
                    candidates: Vec::new(),
                    scene: None,
                };
                let outcome = CurationOutcome::Retained(Box::new(record), unproposed);
                RecordOutcome::Curated { scenario, source, outcome }
            }
            OutcomeLine::Retained { source, unproposed } => {
                let record = self.candidates.next().transpose().map_err(|error| *error.cause)?;
                let record = record.ok_or_else(|| Cause::schema(CANDIDATES, "its end", "a scenario"))?;
                let scenario = record.scenario_id.clone();
                let outcome = CurationOutcome::Retained(Box::new(record), unproposed);
                RecordOutcome::Curated { scenario, source, outcome }
            }
        };
        Ok((place, outcome))
    }
}

impl Iterator for OutcomeReader {
    type Item = Result<(Place, RecordOutcome), FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        let text = self.lines.next()?;
        let number = self.next;
        self.next += 1;
        Some(self.outcome(text).map_err(|cause| FormatError::record(&self.path, number, None, cause)))
    }
}

fn write_error(path: &Path) -> impl FnOnce(io::Error) -> FormatError + use<> {
    let path = path.to_owned();
    move |error| FormatError::file(&path, Cause::write(error))
}
