//! Generated road maps: parametric, random within engineering ranges, checked.

pub mod validate;

use super::Layout;
use crate::rollout::Stream;

/// A kind of map.
pub struct MapType {
    /// Name, such as `signalised-junction`.
    pub id: &'static str,
    /// What it is, in a line.
    pub title: &'static str,
    /// Share of it among the scenarios of the preset `train`, as a weight.
    pub weight: f64,
    /// Draws one. The result depends on the stream only.
    pub draw: fn(&mut Stream) -> Layout,
}

/// All map types.
pub const MAP_TYPES: &[MapType] = &[];
