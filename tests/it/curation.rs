//! Curation: how a set of deviated AVs is made.

mod avoidance;
