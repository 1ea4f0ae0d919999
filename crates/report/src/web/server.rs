//! A server on the loopback interface, for the user who started it.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener as StdListener};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use axum::serve::Listener;
use axum::{Router, middleware};
use rand::TryRng;
use rand::rngs::SysRng;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Notify;
use tokio_io_timeout::TimeoutStream;

use super::guard::{Guard, guard};

/// Error in serving a page.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The port is unavailable, or was lost.
    #[error("could not serve the page at {address}: {source}; choose another port, or 0 for any free one")]
    Serve {
        /// Address and port.
        address: String,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The operating system has no random numbers for the token.
    #[error("the operating system gave no random numbers for the token of the page: {0}")]
    Random(String),
}

/// Handle that ends a server from another thread.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<Notify>);

impl Stop {
    /// Ends the server after the requests in progress.
    pub fn stop(&self) {
        self.0.notify_one();
    }
}

/// Settings of a site.
#[derive(Clone, Debug)]
pub struct Site {
    /// Hint for requests without the token: how to find the address.
    pub hint: &'static str,
    /// Content security policy of the page (`Content-Security-Policy`).
    pub policy: String,
}

/// A port that only this machine can reach, and the token that every request needs.
pub struct Loopback {
    listener: StdListener,
    port: u16,
    token: String,
}

impl Loopback {
    /// Binds a port, 0 for any free one.
    ///
    /// # Errors
    /// [`ServeError`] if the port is unavailable or there are no random numbers.
    pub fn bind(port: u16) -> Result<Self, ServeError> {
        let refuse = lost(port);
        let listener = StdListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(&refuse)?;
        listener.set_nonblocking(true).map_err(&refuse)?;
        let port = listener.local_addr().map_err(&refuse)?.port();
        Ok(Self { listener, port, token: token()? })
    }

    /// Returns the address of the page, which contains the token.
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    /// Answers requests until `stop` is triggered. All routes begin with `/{token}/`, which is checked
    /// first.
    ///
    /// # Errors
    /// [`ServeError`] if the port is lost.
    pub fn run(self, router: Router, site: Site, stop: &Stop) -> Result<(), ServeError> {
        let Self { listener, port, token } = self;
        let refuse = lost(port);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(&refuse)?;
        let ended = Arc::new(Notify::new());
        let notifier = Arc::clone(&ended);
        runtime.block_on(async move {
            let listener = Patient(TcpListener::from_std(listener).map_err(&refuse)?);
            let router = router.layer(middleware::from_fn_with_state(Guard::new(&token, port, &site), guard));
            let graceful = stop.0.clone();
            let server = axum::serve(listener, router).with_graceful_shutdown(async move {
                graceful.notified().await;
                notifier.notify_one();
            });
            // Browsers keep idle connections open: do not wait for them.
            let timeout = async {
                ended.notified().await;
                tokio::time::sleep(Duration::from_millis(500)).await;
            };
            tokio::select! {
                result = server => result.map_err(&refuse),
                () = timeout => Ok(()),
            }
        })
    }
}

/// Time after which a connection is closed that sends nothing: half-open ones would use up all descriptors.
const IDLE_TIME: Duration = Duration::from_secs(60);

/// A listener whose connections end when they are idle for [`IDLE_TIME`].
struct Patient(TcpListener);

impl Listener for Patient {
    type Io = Pin<Box<TimeoutStream<TcpStream>>>;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, Self::Addr) {
        // Waits a second if no descriptor is left.
        let (connection, address) = Listener::accept(&mut self.0).await;
        let mut connection = TimeoutStream::new(connection);
        connection.set_read_timeout(Some(IDLE_TIME));
        connection.set_write_timeout(Some(IDLE_TIME));
        (Box::pin(connection), address)
    }

    fn local_addr(&self) -> io::Result<Self::Addr> {
        self.0.local_addr()
    }
}

fn lost(port: u16) -> impl Fn(io::Error) -> ServeError {
    move |source| ServeError::Serve { address: format!("127.0.0.1:{port}"), source }
}

/// Draws a token of 128 random bits, as 32 hexadecimal digits.
fn token() -> Result<String, ServeError> {
    let mut bytes = [0; 16];
    SysRng.try_fill_bytes(&mut bytes).map_err(|e| ServeError::Random(e.to_string()))?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}
