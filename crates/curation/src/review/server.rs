//! The server of the page: loopback only, single-threaded.

mod routes;
mod state;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use parking_lot::Mutex;
use reactsim_web::{Loopback, Site, Stop};

use self::state::ReviewState;
use super::{Clock, Journal, ReviewError, system_clock};
use crate::store::Store;

/// Options of a review.
pub struct ReviewOptions {
    /// Port; 0 for any free one.
    pub port: u16,
    /// Journals of other reviewers, which are only read.
    pub reviews: Vec<PathBuf>,
    /// Name of the reviewer; the page asks for it if it is missing.
    pub reviewer: Option<String>,
    /// Name that the page suggests when it asks.
    pub suggestion: String,
    /// Source of the times of decisions.
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

/// Content security policy of the page: nothing is loaded from elsewhere.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                      img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Server for the review of one file. The port is open as soon as this exists; [`Self::run`] answers the
/// requests.
pub struct ReviewServer {
    state: Arc<Mutex<ReviewState>>,
    loopback: Loopback,
    journal: PathBuf,
    warnings: Vec<String>,
}

impl ReviewServer {
    /// Opens the journal next to the file, reads the others and opens the port.
    ///
    /// # Errors
    /// When there is nothing to review, a journal cannot be read or is in use, or the port is not
    /// available.
    pub fn new(store: Store, options: ReviewOptions) -> Result<Self, ReviewError> {
        if store.scenarios().is_empty() {
            return Err(ReviewError::Empty { path: store.path().to_owned() });
        }
        let mut journal = Journal::open(&Journal::path_for(store.path()))?;
        journal.merge(&options.reviews)?;
        let loopback = Loopback::bind(options.port)?;
        let path = journal.path().to_owned();
        let state = ReviewState::new(store, journal, options);
        let warnings = state.warnings();
        Ok(Self { state: Arc::new(Mutex::new(state)), loopback, journal: path, warnings })
    }

    /// Returns the address of the page. It contains the token, without which no request is answered.
    pub fn url(&self) -> String {
        self.loopback.url()
    }

    /// Returns the journal that decisions are written to.
    pub fn journal(&self) -> &Path {
        &self.journal
    }

    /// Returns warnings to show before the review begins.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Answers requests until `stop` is set. Decisions are on disk before they are confirmed, so nothing
    /// is left to write.
    ///
    /// # Errors
    /// When the port is lost.
    pub fn run(self, stop: &Stop) -> Result<(), ReviewError> {
        let site = Site {
            hint: "open the address that `reactsim curate review` printed",
            policy: POLICY.to_owned(),
        };
        Ok(self.loopback.run(routes::router(self.state), site, stop)?)
    }
}
