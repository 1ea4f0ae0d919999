//! The server of the page: loopback only, one thread.

mod desk;
mod routes;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use self::desk::Desk;
use super::{Clock, Journal, ReviewError, system_clock};
use crate::curation::store::Store;
use crate::web::{Loopback, Site, Stop};

/// How a file is reviewed.
pub struct ReviewOptions {
    /// Port; 0 for any free one.
    pub port: u16,
    /// Journals of other reviewers, which are only read.
    pub reviews: Vec<PathBuf>,
    /// Name of the reviewer; where there is none the page asks.
    pub reviewer: Option<String>,
    /// What the page proposes as a name where it asks.
    pub suggestion: String,
    /// Tells when decisions are made.
    pub clock: Clock,
}

impl Default for ReviewOptions {
    fn default() -> Self {
        Self {
            port: 0,
            reviews: Vec::new(),
            reviewer: None,
            suggestion: String::new(),
            clock: system_clock(),
        }
    }
}

/// What the page may load: nothing from elsewhere.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Serves the review of one file. The page is there as soon as this exists; requests are answered by [`Self::run`].
pub struct ReviewServer {
    desk: Arc<Mutex<Desk>>,
    loopback: Loopback,
    journal: PathBuf,
    warnings: Vec<String>,
}

impl ReviewServer {
    /// Opens the journal beside the file, reads the others and takes the port.
    ///
    /// # Errors
    /// When there is nothing to review, a journal can not be read or is in use, or the port can not be had.
    pub fn new(store: Store, options: ReviewOptions) -> Result<Self, ReviewError> {
        if store.scenarios().is_empty() {
            return Err(ReviewError::Empty { path: store.path().to_owned() });
        }
        let mut journal = Journal::open(&Journal::beside(store.path()))?;
        journal.merge(&options.reviews)?;
        let loopback = Loopback::bind(options.port)?;
        let path = journal.path().to_owned();
        let desk = Desk::new(store, journal, options);
        let warnings = desk.warnings();
        Ok(Self { desk: Arc::new(Mutex::new(desk)), loopback, journal: path, warnings })
    }

    /// Where the page is: the address holds the token, without which nothing is answered.
    pub fn url(&self) -> String {
        self.loopback.url()
    }

    /// The journal that decisions are written to.
    pub fn journal(&self) -> &Path {
        &self.journal
    }

    /// What a user should be told before the review begins.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Answers requests until `stop` is asked for. Decisions are on the disk before they are answered, so nothing is left to write.
    ///
    /// # Errors
    /// When the port is lost.
    pub fn run(self, stop: &Stop) -> Result<(), ReviewError> {
        let site = Site {
            hint: "open the address that `reactsim curate review` printed",
            policy: POLICY.to_owned(),
        };
        Ok(self.loopback.run(routes::router(self.desk), site, stop)?)
    }
}
