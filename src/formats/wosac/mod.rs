//! Files of the Waymo Open Sim Agents Challenge: recorded scenarios as its metrics read them, and
//! submissions.

mod log;
mod log_message;
mod message;
mod rollouts;

pub use log::WosacLogs;
pub use rollouts::{decode_rollouts, encode_rollouts, read_rollouts};
