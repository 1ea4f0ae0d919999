//! What every generated scenario obeys, and what the generator promises of all of them.

mod digests;
mod motion;
mod people;
mod realism;
mod replay;
mod right_of_way;
mod sample;
mod settings;
mod vanishing;
