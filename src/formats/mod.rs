//! Files: every format that scenarios and rollouts are read from and written to.

pub mod document;
