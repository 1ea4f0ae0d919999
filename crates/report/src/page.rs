//! Runs as one HTML page: tables, figures, the list of scenarios, and a viewer of rollouts.
//!
//! A [`Gallery`] holds finished runs and, if available, their scenarios and rollouts.
//! [`Gallery::write`] writes a self-contained file with scripts, styles, numbers and chosen scenes.
//! [`Gallery::serve`] shows the same page with every scene, loaded on request. All texts of a run reach
//! the page as JSON, and scripts insert them as text, never as markup.

mod choice;
mod data;
mod document;
mod error;
mod gallery;
mod review;
mod scene;
mod site;
mod tracks;

pub use error::PageError;
pub use gallery::{Gallery, Member, folder_names, members};
pub use review::write_review;
