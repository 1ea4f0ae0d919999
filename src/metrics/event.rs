//! Events counted by metrics, so that every number can be traced to frames.

/// One counted event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Id of the metric that counted the event.
    pub metric: &'static str,
    /// First step of the event, 1 to 80.
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
