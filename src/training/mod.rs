//! The learning loop: what is the same for every network that is trained here. Knows no particular one.
