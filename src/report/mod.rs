//! What people read: tables and pictures. Knows results; never decides what is run.

pub mod birdseye;
