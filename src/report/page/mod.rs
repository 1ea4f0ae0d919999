//! Runs as one page: tables, figures, the list of scenarios, and a viewer that shows what simulators did.
//!
//! A [`Gallery`] holds finished runs and, where there are any, their scenarios and rollouts. [`Gallery::write`] makes a file that needs
//! nothing else: scripts, styles, numbers and chosen scenes are part of it. [`Gallery::serve`] shows the same page with every scene,
//! each loaded when it is asked for. All texts of a run reach the page as JSON, which scripts put in as text, never as markup.

mod choice;
mod data;
mod document;
mod error;
mod gallery;
mod scene;
mod site;
mod tracks;

pub use error::PageError;
pub use gallery::{Gallery, Member};
