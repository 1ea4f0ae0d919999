//! Laws that every generated scenario obeys, and promises of the generator for all of them.

mod digests;
mod levels;
mod motion;
mod people;
mod replay;
mod right_of_way;
mod sample;
mod settings;
mod vanishing;
