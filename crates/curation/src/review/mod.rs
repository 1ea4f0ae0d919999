//! The review page: people verify candidates by hand in a browser (ReactSim-Bench, "Data Collection
//! Pipeline", step 4).
//!
//! A [`ReviewServer`] serves one file of candidates on the loopback interface. Decisions go to a
//! [`Journal`] next to the file, one line at a time; the page gets its confirmation after the line is on
//! disk. The scene that the page draws ([`sketch`](reactsim_web::sketch())) is stored with the candidates,
//! so that the page needs no scenarios.

mod agreement;
mod assets;
mod clock;
mod error;
mod journal;
mod page;
mod server;

pub use agreement::Agreement;
pub use clock::{Clock, is_rfc3339, rfc3339, system_clock};
pub use error::ReviewError;
pub use journal::{Decisions, Journal, Opinions, ReviewLine, candidate_digest, is_reviewer};
pub use server::{ReviewOptions, ReviewServer};
