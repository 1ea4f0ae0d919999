//! Events counted by metrics, so that every number can be traced to frames.

use super::Case;

/// One counted event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Id of the metric that counted the event.
    pub metric: &'static str,
    /// First step of the event, from 1.
    pub step: usize,
    /// Last step of the event (the same for events of one step).
    pub last_step: usize,
    /// Id of the agent.
    pub agent: String,
    /// Id of the partner, if any.
    pub partner: Option<String>,
    /// Reason why the event counts or not, such as `front_bumper`.
    pub reason: Option<&'static str>,
    /// Whether the event counts in the metric's value (a collision without fault is listed but does not
    /// count).
    pub counted: bool,
    /// Named values at the event, such as `ttc` or `acceleration`.
    pub values: Vec<(&'static str, f64)>,
}

impl Event {
    /// Returns an event of an object that counts, without partner, reason and values.
    /// [`Metrics`](super::Metrics) add the id of the metric.
    pub(super) fn of(case: &Case<'_>, object: usize, step: usize, last_step: usize) -> Self {
        let agent = case.id(object);
        Self {
            metric: "",
            step,
            last_step,
            agent,
            partner: None,
            reason: None,
            counted: true,
            values: Vec::new(),
        }
    }
}

/// Names and units of the values of events; a value without a unit is a number of steps or an index of the
/// map.
pub const EVENT_UNITS: &[(&str, &str)] = &[
    ("acceleration", "m/s²"),
    ("av_speed", "m/s"),
    ("curvature", "1/m"),
    ("delta_v", "m/s"),
    ("driven", "m"),
    ("excess", "m/s²"),
    ("heading_error", "rad"),
    ("lane", ""),
    ("log_distance", "m"),
    ("lost", "m"),
    ("peak", "m/s²"),
    ("progress", "m"),
    ("reference", "m"),
    ("reference_peak", "m/s²"),
    ("speed", "m/s"),
    ("ttc", "s"),
    ("ttc_step", ""),
    ("x", "m"),
    ("y", "m"),
];
