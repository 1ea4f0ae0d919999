//! Input of the network.

use super::PlannerConfig;

/// Numbers of a neighbour at a frame, of a static object, and of a point of a lane.
pub(crate) const AGENT: usize = 11;
pub(crate) const STATIC: usize = 10;
pub(crate) const POINT: usize = 12;

/// A scene, normalised, in the frame of the AV's rear axle: x ahead, y to the left. Absent rows are zeros.
///
/// Normalised are x, y as (x - 10 m, y) / 20 m, all other lengths and speeds by 20 m and 20 m/s, but for the
/// sizes of static objects, which are in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannerInput {
    /// The nearest agents: `[agents, history, 11]`: x, y, cosine and sine of the heading, velocity x, y,
    /// width, length, and whether it is a vehicle, a pedestrian, a bicycle.
    pub agents: Vec<f32>,
    /// Static objects: `[statics, 10]`: x, y, cosine and sine of the heading, width, length, and whether it
    /// is a sign of a construction zone, a barrier, a cone, something else.
    pub statics: Vec<f32>,
    /// Lanes: `[lanes, points, 12]`: x, y, the way to the next point (0 at the last), the ways to the left
    /// and the right boundary, and whether the light is green, yellow, red, unknown.
    pub lanes: Vec<f32>,
    /// Their speed limits; `None` if unknown.
    pub limits: Vec<Option<f32>>,
    /// Lanes of the route, as `lanes`: `[route, points, 12]`.
    pub route: Vec<f32>,
    /// Current states of the AV and the neighbours whose motion is predicted, `[1 + predicted, 4]`: x, y,
    /// cosine, sine.
    pub current: Vec<f32>,
}

impl PlannerInput {
    /// Returns by neighbour whether its motion can be predicted: it is there now.
    pub(super) fn predicted(&self, config: &PlannerConfig) -> Vec<bool> {
        (1..=config.predicted).map(|i| self.current[4 * i..4 * i + 4].iter().any(|v| *v != 0.0)).collect()
    }
}
