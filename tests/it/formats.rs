//! Formats: round trips, damage, odd input.
