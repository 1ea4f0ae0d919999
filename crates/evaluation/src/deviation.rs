//! Deviations of AVs: their labels, and the points that poses are of.

pub(crate) mod labels;
pub(crate) mod pose;
