//! Curation: how a set of deviated AVs is made, filed and told.

mod avoidance;
mod filters;
mod hand;
mod road;
mod rules;
mod store;
mod taxonomy;
