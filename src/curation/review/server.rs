//! The server of the page: loopback only, one thread.

mod desk;
mod guard;
mod routes;

use std::net::{Ipv4Addr, TcpListener as StdListener};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rand::TryRng;
use rand::rngs::SysRng;
use tokio::net::TcpListener;
use tokio::sync::Notify;

use self::desk::Desk;
use super::{Clock, Journal, ReviewError, system_clock};
use crate::curation::store::Store;

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

/// Ends a server from another thread.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<Notify>);

impl Stop {
    /// Asks the server to end. It does so after the requests that it is answering.
    pub fn stop(&self) {
        self.0.notify_one();
    }
}

/// Serves the review of one file. The page is there as soon as this exists; requests are answered by [`Self::run`].
pub struct ReviewServer {
    desk: Arc<Mutex<Desk>>,
    listener: StdListener,
    port: u16,
    token: String,
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
        let address = (Ipv4Addr::LOCALHOST, options.port);
        let refuse = |source| ReviewError::Serve { address: format!("127.0.0.1:{}", options.port), source };
        let listener = StdListener::bind(address).map_err(refuse)?;
        listener.set_nonblocking(true).map_err(refuse)?;
        let port = listener.local_addr().map_err(refuse)?.port();
        let path = journal.path().to_owned();
        let desk = Desk::new(store, journal, options);
        let warnings = desk.warnings();
        Ok(Self {
            desk: Arc::new(Mutex::new(desk)),
            listener,
            port,
            token: token()?,
            journal: path,
            warnings,
        })
    }

    /// Where the page is: the address holds the token, without which nothing is answered.
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
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
        let Self { desk, listener, port, token, .. } = self;
        let refuse = |source| ReviewError::Serve { address: format!("127.0.0.1:{port}"), source };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(refuse)?;
        let ended = Arc::new(Notify::new());
        let told = Arc::clone(&ended);
        runtime.block_on(async move {
            let listener = TcpListener::from_std(listener).map_err(refuse)?;
            let router = routes::router(desk, &token, port);
            let graceful = stop.0.clone();
            let server = axum::serve(listener, router).with_graceful_shutdown(async move {
                graceful.notified().await;
                told.notify_one();
            });
            // A browser keeps connections open that it may never use.
            let patience = async {
                ended.notified().await;
                tokio::time::sleep(Duration::from_millis(500)).await;
            };
            tokio::select! {
                result = server => result.map_err(refuse),
                () = patience => Ok(()),
            }
        })
    }
}

/// 128 random bits as 32 hexadecimal digits.
fn token() -> Result<String, ReviewError> {
    let mut bytes = [0; 16];
    SysRng.try_fill_bytes(&mut bytes).map_err(|e| ReviewError::Random(e.to_string()))?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}
