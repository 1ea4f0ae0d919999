//! The published network against golden data.
